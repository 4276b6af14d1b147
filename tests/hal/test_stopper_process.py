"""The stopper's loop in this process, on real descriptors: what it waits for, and how it ends.

The system calls that wait, act on lines and end a process are handed in place of the system's own:
each is recorded, and what `select` returns is told beforehand.
"""

from __future__ import annotations

import ctypes
import fcntl
import gc
import os
import select
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from etd_hal.cutlatch import ALIVE_NS, LOOKED_NS, POWER, SIZE, WINDOW_NS
from etd_hal.linux import side_process, stopper_process, uapi
from etd_hal.linux.death_mark import DeathMark
from etd_hal.shared_memory import SharedMemory
from etd_hal.stopper import PERIOD_NS, Stopper
from etd_hal.supply_note import SupplyNote

SAFE = bytes(range(16))
#: As the kernel marks a mutex whose owner died (linux/futex.h).
OWNER_DIED = (0x4000_0000).to_bytes(4, "little")
#: By a thread of the driving process, by its number.
HELD = (4_711).to_bytes(4, "little")
_PR_SET_DUMPABLE = 4
#: More than any mutex has.
_MARK_BYTES = 4_096


class Over(BaseException):
    """The process would have ended here."""


class Scene:
    """Descriptors as a driving process hands them over, and the other ends of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.mine, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.control = its.detach()
        self.latch = SharedMemory(SIZE)
        self.mark = SharedMemory(_MARK_BYTES)
        self.mark.bytes[:4] = HELD
        #: In place of a pidfd: it can be read once the other end is closed.
        self.engine, self.engine_end = os.pipe()
        self.lines = os.open(os.devnull, os.O_RDWR)
        #: Each call for lines: file descriptor, number, and what the kernel would read.
        self.calls: list[tuple[int, int, bytes]] = []
        self.pauses_s: list[float | None] = []
        self.does_with_a_call: Callable[[], object] = int
        self._monkeypatch = monkeypatch
        self._connections: list[socket.socket] = []

    def close(self) -> None:
        for connection in (self.mine, *self._connections):
            connection.close()
        if not self._connections:
            os.close(self.control)
        for fd in (self.engine, self.engine_end, self.lines):
            with suppress(OSError):
                os.close(fd)

    @property
    def words(self) -> memoryview[int]:
        return self.latch.words

    def run(self, note: Path | None = None) -> None:
        """All of it, until the process would end; lines take the call for lines."""
        descriptors = (self.control, os.dup(self.latch.fd), self.lines, self.engine)
        where = None if note is None else str(note)
        make = socket.socket

        def made(fileno: int) -> socket.socket:
            self._connections.append(make(fileno=fileno))
            return self._connections[-1]

        with self._monkeypatch.context() as patch:
            patch.setattr(os, "_exit", self._over)
            patch.setattr(fcntl, "ioctl", self._ioctl)
            patch.setattr(socket, "socket", made)
            with pytest.raises(Over):
                stopper_process.main(*descriptors, os.dup(self.mark.fd), SAFE, where, None, None)

    def watch(self, ready: list[list[str]], stopper: Stopper) -> None:
        """The loop alone; what is ready at each wait, by name."""
        left = iter(ready)
        mark = DeathMark(os.dup(self.mark.fd))
        with (
            socket.socket(fileno=os.dup(self.control)) as connection,
            self._monkeypatch.context() as patch,
        ):
            of_name: dict[str, object] = {"told": connection, "engine": self.engine}

            def waited(reads: object, _: object, __: object, pause_s: float | None) -> object:
                assert reads == (connection, self.engine)
                self.pauses_s.append(pause_s)
                return [of_name[name] for name in next(left)], [], []

            patch.setattr(select, "select", waited)
            stopper_process.watch(connection, stopper, self.engine, mark)
        assert list(left) == []

    def stopper(self) -> Stopper:
        return Stopper(self.words, lambda: 1 + self.words[LOOKED_NS], lambda: None)

    def _over(self, status: int) -> None:
        assert status == 0
        failed = sys.exc_info()[1]
        raise Over if failed is None else AssertionError("not by itself") from failed

    def _ioctl(self, fd: int, number: int, buffer: bytearray) -> int:
        self.calls.append((fd, number, bytes(buffer)))
        self.does_with_a_call()
        return 0


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    """What the process sets for itself is put back: signals, its memory, the collector."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGABRT)
    before = {number: signal.getsignal(number) for number in numbers}
    made = Scene(monkeypatch)
    yield made
    made.close()
    for number, handler in before.items():
        signal.signal(number, handler)
    ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 1, 0, 0, 0)
    gc.enable()


CUT = uapi.GPIO_V2_LINE_SET_VALUES


@pytest.mark.parametrize("ends", ["process", "socket", "mark"])
def test_it_cuts_once_with_the_safe_levels_and_lets_go_of_the_lines(
    scene: Scene, ends: str
) -> None:
    if ends == "process":
        os.close(scene.engine_end)
    elif ends == "socket":
        scene.mine.shutdown(socket.SHUT_WR)
    else:
        scene.mine.send(side_process.NEEDED)
        scene.mark.bytes[:4] = OWNER_DIED
    scene.run()
    assert scene.calls == [(scene.lines, CUT, SAFE)]
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(scene.lines)
    assert scene.words[LOOKED_NS] == 0, "nothing is checked any more"


def test_it_says_that_it_is_up_before_anything_else(scene: Scene) -> None:
    os.close(scene.engine_end)
    scene.run()
    assert scene.mine.recv(64) == b"up"


def test_it_says_that_no_mark_will_tell_of_the_engines_death(scene: Scene) -> None:
    scene.mark.bytes[:4] = bytes(4)
    os.close(scene.engine_end)
    scene.run()
    up, *refused = scene.mine.recv(1_024).decode().splitlines()
    assert (up, len(refused)) == ("up", 1)
    assert "the mark of the engine's death is not held" in refused[0]


def test_an_engine_that_is_silent_is_cut_while_it_is_needed(scene: Scene) -> None:
    """By the real clock: it checks again and again, without being told to."""
    scene.words[POWER], scene.words[WINDOW_NS], scene.words[ALIVE_NS] = 1, 2 * PERIOD_NS, 1
    scene.mine.send(side_process.NEEDED)

    def end_the_process_after_two_cuts() -> None:
        if len(scene.calls) == 2:
            os.close(scene.engine_end)

    scene.does_with_a_call = end_the_process_after_two_cuts
    scene.run()
    assert scene.calls[:3] == [(scene.lines, CUT, SAFE)] * 3, "silent, repeated, and at the end"


@pytest.mark.parametrize(("power", "is_left"), [(1, True), (2, False)])
def test_the_last_word_about_the_supply_is_noted(
    scene: Scene, tmp_path: Path, power: int, is_left: bool
) -> None:
    note = SupplyNote(tmp_path / "supply.json")
    note.keep()
    scene.words[POWER] = power
    os.close(scene.engine_end)
    scene.run(note.path)
    assert (note.left() is not None) == is_left


def test_it_waits_without_an_end_until_it_is_needed_and_again_when_it_is_not(scene: Scene) -> None:
    for said in (side_process.NEEDED, side_process.NOT_NEEDED):
        scene.mine.send(said)
    scene.watch([["told"], [], [], ["told"], ["engine"]], scene.stopper())
    period_s = PERIOD_NS / 1e9
    assert scene.pauses_s == [None, period_s, period_s, period_s, None]
    assert scene.words[LOOKED_NS] == 4, "each but the last is a check"
    assert not gc.isenabled()


def test_the_end_of_the_process_counts_before_what_it_said_last(scene: Scene) -> None:
    scene.mine.send(side_process.NEEDED)
    scene.watch([["told", "engine"]], scene.stopper())
    assert scene.words[LOOKED_NS] == 0


def test_the_mark_ends_it_also_where_nothing_is_ready(scene: Scene) -> None:
    scene.mark.bytes[:4] = OWNER_DIED
    scene.watch([[]], scene.stopper())
    assert scene.words[LOOKED_NS] == 0


def test_a_socket_that_is_closed_ends_it(scene: Scene) -> None:
    scene.mine.close()
    scene.watch([["told"]], scene.stopper())
    assert scene.words[LOOKED_NS] == 0
