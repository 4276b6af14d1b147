"""The end of a keyboard's input: no stop key can be pressed any more, or never could be."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import pytest

from etd.calibrate.answers import Question
from etd.calibrate.trial import Stopped
from etd.cli.keys import Keyboard
from etd.protocol.errors import FileError

#: What is polled or asked once something may have been presented.
READ: dict[str, Callable[[Keyboard], object]] = {
    "wants_stop": lambda keys: keys.wants_stop(),
    "answer": lambda keys: keys.answer(Question("strength", 3), lambda: None),
    "asked_to_end": lambda keys: keys.asked_to_end(),
    "ready": lambda keys: keys.ready(lambda: None),
}


class Closed:
    """A keyboard whose input has ended after `keys`, and how often that stopped the daemon."""

    def __init__(self, fd: int, keys: bytes) -> None:
        self.stops = 0
        os.write(fd, keys)
        os.close(fd)

    def stop(self) -> None:
        self.stops += 1


@pytest.fixture
def read_end() -> Iterator[tuple[int, int]]:
    theirs, ours = os.pipe()
    yield theirs, ours
    os.close(theirs)


def keyboard(ends: tuple[int, int], keys: bytes) -> tuple[Keyboard, Closed]:
    closed = Closed(ends[1], keys)
    return Keyboard(ends[0], lambda _: None, lambda _: None, closed.stop), closed


@pytest.mark.parametrize("read", list(READ))
@pytest.mark.parametrize("keys", [b"", b"x"])
def test_it_stops_the_daemon_and_says_why(
    read_end: tuple[int, int], read: str, keys: bytes
) -> None:
    """Also where no key was ever pressed: pulses come before the first question."""
    keyed, closed = keyboard(read_end, keys)
    with pytest.raises(Stopped, match=r"stopped \(the input was closed\): the daemon is halted"):
        READ[read](keyed)
    assert closed.stops == 1


def test_before_anything_is_presented_an_input_without_a_key_is_refused(
    read_end: tuple[int, int],
) -> None:
    keyed, closed = keyboard(read_end, b"")
    with pytest.raises(FileError, match="no key can be pressed; use a terminal"):
        keyed.asked_to_end(is_before_all=True)
    assert closed.stops == 0


def test_after_a_key_its_end_is_a_stop_though_nothing_was_presented(
    read_end: tuple[int, int],
) -> None:
    keyed, closed = keyboard(read_end, b"n")
    with pytest.raises(Stopped, match="the input was closed"):
        keyed.asked_to_end(is_before_all=True)
    assert closed.stops == 1


@pytest.mark.parametrize(("keys", "ending"), [(b"q ", "stop"), (b"\x1b", "stop")])
def test_a_stop_key_before_the_end_is_that_stop(
    read_end: tuple[int, int], keys: bytes, ending: str
) -> None:
    keyed, closed = keyboard(read_end, keys)
    assert keyed.asked_to_end(is_before_all=True) == ending
    assert closed.stops == 0
