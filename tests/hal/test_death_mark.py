"""The kernel's mark of a thread's death, for real."""

from __future__ import annotations

import ctypes
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


@pytest.mark.parametrize("fails", ["init", "setrobust"])
def test_what_a_library_refuses_is_not_taken(fails: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where it has no robust mutexes: a mutex that is held, but that no death marks."""

    class Library:
        def __getattr__(self, name: str) -> Callable[..., int]:
            return lambda *_: int(name.endswith(fails))

    monkeypatch.setattr(ctypes, "CDLL", lambda _: Library())
    locked: list[str] = []
    monkeypatch.setattr(Library, "pthread_mutex_lock", lambda *_: locked.append("it"), False)
    assert DeathMark(os.dup(death_mark.take())).why_not_held is not None
    assert locked == []


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
