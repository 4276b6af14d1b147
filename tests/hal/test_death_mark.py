"""The kernel's mark of a thread's death, for real."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import select
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from etd_hal.linux import death_mark
from etd_hal.linux.death_mark import DeathMark
from etd_hal.shared_memory import SharedMemory

WITHIN_S = 60.0


@contextmanager
def marked(after: Callable[[], object]) -> Iterator[tuple[int, DeathMark]]:
    """A process that takes a mark, does `after` and waits; its number, and the mark."""
    reading, writing = os.pipe()
    pid = os.fork()
    if not pid:
        # One is killed by SIGSEGV, which is no fault of the tests and not to be told as one.
        faulthandler.disable()
        try:
            fd = death_mark.take()
            after()
            os.write(writing, f"{fd}\n".encode())
            while True:
                signal.pause()
        finally:
            os._exit(1)
    os.close(writing)
    try:
        with os.fdopen(reading) as said:
            fd = int(said.readline())
        yield pid, DeathMark(os.open(f"/proc/{pid}/fd/{fd}", os.O_RDWR))
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV])
def test_it_is_set_when_its_process_was_killed_and_not_before(number: int) -> None:
    with marked(lambda: None) as (pid, mark):
        over = os.pidfd_open(pid)
        try:
            assert not mark.is_set
            os.kill(pid, signal.SIGSTOP)
            assert not mark.is_set
            os.kill(pid, number)
            os.kill(pid, signal.SIGCONT)
            assert select.select([over], (), (), WITHIN_S)[0]
            # What waits for the end is told of it later than the mark is set.
            assert mark.is_set
        finally:
            os.close(over)


def test_it_is_known_whether_it_was_taken() -> None:
    with marked(lambda: None) as (_, mark):
        assert mark.why_not_held is None
    memory = SharedMemory(4_096)
    assert "not held" in (DeathMark(os.dup(memory.fd)).why_not_held or "")


_CALLS = (
    "pthread_mutexattr_init",
    "pthread_mutexattr_setpshared",
    "pthread_mutexattr_setrobust",
    "pthread_mutex_init",
    "pthread_mutex_lock",
)


class Library:
    """In place of the C library's: what it is asked, and which call it refuses."""

    def __init__(self, refused: str = "") -> None:
        self.asked: list[tuple[str, ...]] = []
        self._refused = refused

    def __getattr__(self, name: str) -> Callable[..., int]:
        def call(*given: object) -> int:
            self.asked.append((name, *(str(one) for one in given if isinstance(one, int))))
            return int(name == self._refused)

        return call


@pytest.mark.parametrize("refused", _CALLS[:-1])
def test_what_a_library_refuses_is_not_taken(refused: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where it has no robust mutexes: one would be held, and no death would mark it."""
    library = Library(refused)
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    assert DeathMark(os.dup(death_mark.take())).why_not_held is not None
    assert [name for name, *_ in library.asked] == list(_CALLS[: _CALLS.index(refused) + 1])


def test_a_mutex_is_asked_for_that_is_shared_and_robust(monkeypatch: pytest.MonkeyPatch) -> None:
    library = Library()
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    death_mark.take()
    shared = {name: given for name, *given in library.asked}
    assert list(shared) == list(_CALLS)
    assert shared["pthread_mutexattr_setpshared"] == ["1"], "PTHREAD_PROCESS_SHARED"
    assert shared["pthread_mutexattr_setrobust"] == ["1"], "PTHREAD_MUTEX_ROBUST"


def test_this_thread_holds_what_it_took() -> None:
    assert DeathMark(os.dup(death_mark.take())).why_not_held is None


def end_a_child() -> None:
    child = os.fork()
    if not child:
        os._exit(0)
    os.waitpid(child, 0)


def test_a_child_that_ends_does_not_set_its_parents() -> None:
    with marked(end_a_child) as (_, mark):
        assert not mark.is_set


def test_each_that_a_process_takes_is_set() -> None:
    with marked(lambda: [death_mark.take() for _ in range(3)]) as (pid, mark):
        over = os.pidfd_open(pid)
        os.kill(pid, signal.SIGKILL)
        assert select.select([over], (), (), WITHIN_S)[0]
        os.close(over)
        assert mark.is_set
