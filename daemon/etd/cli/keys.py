"""One key, one answer: the terminal of the person being calibrated.

Owns: reading single keys without Enter, what each key means, and the line that says so. Must not
know: what is presented, daemons.

A key pressed before the question is dropped; the stop keys always count. The end of the input (a
closed terminal) is a stop, because no stop key could be pressed any more. Before anything is
presented, and without a key until then, there was no keyboard: that is refused, and stops nothing.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn, TextIO

from etd.calibrate.answers import ANSWERS, Answer, Ask, Question
from etd.calibrate.trial import Stopped
from etd.protocol.errors import FileError

KEYS: dict[str, Answer] = {
    "n": "not_felt",
    "f": "felt",
    "c": "comfortable",
    "t": "too_strong",
    "w": "weaker",
    "s": "same",
    "g": "stronger",
    "1": "first",
    "2": "second",
    "b": "both",
    "0": "neither",
    "v": "vibration",
    "p": "pressure",
    "k": "prickling",
    "o": "other",
    "u": "under",
    "a": "around",
    "e": "elsewhere",
    "q": "pause",
    " ": "stop",
    "\x1b": "stop",
    "\x03": "stop",
}
#: Why it was stopped, where the input has ended.
INPUT_CLOSED = "the input was closed"
_KEEP_S = 0.25
_COLUMNS = 80


def legend(ask: Ask) -> str:
    """`n not felt   f felt ...   SPACE STOP   q pause`"""
    by_answer = {answer: key for key, answer in KEYS.items()}
    parts = [f"{by_answer[answer]} {answer.replace('_', ' ')}" for answer in ANSWERS[ask]]
    said = [*parts, "SPACE STOP", "q pause"]
    line = "   ".join(said)
    return line if len(line) <= _COLUMNS - 2 else "  ".join(said)


class Keyboard:
    """Implements `Answerer`. `show` is called with each question before its key is read, `heard`
    with the meaning of each key: None for a key that is no answer to this question. `stop` is
    called at once where the input has ended. All that read keys raise then: Stopped.
    """

    def __init__(
        self,
        fd: int,
        show: Callable[[Question], None],
        heard: Callable[[Answer | None], None],
        stop: Callable[[], None],
    ) -> None:
        self._fd = fd
        self._show = show
        self._heard = heard
        self._stop = stop
        self._was_pressed = False

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        if self.wants_stop():
            return "stop"
        self._show(question)
        allowed = (*ANSWERS[question.ask], "pause", "stop")
        while True:
            pressed = self._pressed(_KEEP_S)
            for answer in allowed:
                if pressed == answer:
                    self._heard(answer)
                    return answer
            if pressed is not None:
                self._heard(None)
            keep()

    def wants_stop(self) -> bool:
        """Drops all other keys pressed so far."""
        while (answer := self._pressed(0.0)) is not None:
            if answer == "stop":
                return True
        return False

    def asked_to_end(self, *, is_before_all: bool = False) -> Answer | None:
        """`stop` or `pause` if pressed, while no question is open. Drops all other keys.
        `is_before_all`: nothing was presented yet. Raises: FileError, if there is no keyboard.
        """
        heard: Answer | None = None
        while (answer := self._pressed(0.0, is_before_all=is_before_all)) is not None:
            if answer == "stop":
                return "stop"
            heard = "pause" if answer == "pause" else heard
        return heard

    def ready(self, keep: Callable[[], None]) -> Answer | None:
        """Wait for any key; `stop` or `pause` where it means that. Drops those pressed before."""
        if (ending := self.asked_to_end()) is not None:
            return ending
        while (pressed := self._pressed(_KEEP_S)) is None:
            keep()
        return "stop" if pressed == "stop" else "pause" if pressed == "pause" else None

    def _pressed(self, timeout_s: float, *, is_before_all: bool = False) -> Answer | str | None:
        """The meaning of the next key ("" for an unknown one); None after the time-out."""
        ready, _, _ = select.select([self._fd], [], [], timeout_s)
        if not ready:
            return None
        data = os.read(self._fd, 1)
        if not data:
            self._ended(is_before_all=is_before_all)
        self._was_pressed = True
        if data == b"\x1b" and self._is_sequence():
            return ""
        return KEYS.get(data.decode(errors="replace").lower(), "")

    def _ended(self, *, is_before_all: bool) -> NoReturn:
        if is_before_all and not self._was_pressed:
            raise _no_keyboard()
        self._stop()
        raise Stopped("stop", INPUT_CLOSED)

    def _is_sequence(self) -> bool:
        """Whether that byte began an arrow, or another key that a terminal sends as several bytes
        at once, which is then read whole. Whatever else follows it was pressed: Escape is a stop.
        """
        if self._at_once() not in (b"[", b"O"):
            return False
        while (byte := self._at_once()) and byte in b"0123456789;":
            pass
        return b"@" <= byte <= b"~"

    def _at_once(self) -> bytes:
        return os.read(self._fd, 1) if select.select([self._fd], [], [], 0.0)[0] else b""


@contextmanager
def keyboard(
    show: Callable[[Question], None],
    heard: Callable[[Answer | None], None],
    stop: Callable[[], None],
) -> Iterator[Keyboard]:
    """Keys of the terminal, without Enter; of a pipe where there is no terminal. Raises: FileError,
    where there is neither.
    """
    if sys.stdin is None:
        raise _no_keyboard()
    fd = sys.stdin.fileno()
    with key_by_key(fd):
        yield Keyboard(fd, show, heard, stop)


def _no_keyboard() -> FileError:
    return FileError(
        "the standard input", "", "it is closed, so no key can be pressed", "use a terminal"
    )


@contextmanager
def key_by_key(fd: int) -> Iterator[None]:
    if not os.isatty(fd):
        yield
        return
    import termios
    import tty

    before = termios.tcgetattr(fd)
    tty.setcbreak(fd)
    try:
        yield
    finally:
        with contextlib.suppress(termios.error):
            termios.tcsetattr(fd, termios.TCSADRAIN, before)


@contextmanager
def keys_of(stream: TextIO) -> Iterator[Callable[[], str]]:
    """What was pressed since the last call; never anything where there is no terminal."""
    if not stream.isatty():
        yield lambda: ""
        return
    fd = stream.fileno()

    def pressed() -> str:
        ready, _, _ = select.select([fd], [], [], 0.0)
        return os.read(fd, 64).decode(errors="replace") if ready else ""

    with key_by_key(fd):
        yield pressed
