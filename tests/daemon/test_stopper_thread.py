"""The stopper as a thread: when it checks, what it was not granted, and that it ends.

Real threads; where something must not happen, another thread that checks twice a millisecond is
what is waited for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from etd.engine.stopper import StopperThread
from etd_hal.cutlatch import CutLatch
from etd_hal.stopper import Stopper

#: Of real time; what is waited for takes none.
PATIENCE_S = 10.0


class Checked:
    """A stopper thread and its checks: each reads the clock once."""

    def __init__(self, prepare: Callable[[], str | None] = lambda: None) -> None:
        self.count = 0
        self._each = threading.Semaphore(0)
        stopper = Stopper(CutLatch().words, self._read, lambda: None)
        self.thread = StopperThread(stopper, prepare)

    def _read(self) -> int:
        self.count += 1
        self._each.release()
        return 0

    def wait_for(self, checks: int) -> None:
        for _ in range(checks):
            assert self._each.acquire(timeout=PATIENCE_S)


@pytest.fixture
def beside() -> Iterator[Checked]:
    """One that checks all the time."""
    checked = Checked()
    checked.thread.start()
    checked.thread.watch(True)
    yield checked
    checked.thread.end()
    assert not checked.thread.is_alive()


def test_while_the_supply_is_on_it_checks_without_being_told_again(beside: Checked) -> None:
    beside.wait_for(10)


def test_else_it_checks_once_each_time_it_is_told(beside: Checked) -> None:
    """So it has noted that the supply is off, and takes no processor time after that."""
    checked = Checked()
    checked.thread.start()
    beside.wait_for(20)
    assert checked.count == 0
    for told in (1, 2, 3):
        checked.thread.watch(False)
        checked.wait_for(1)
        beside.wait_for(20)
        assert checked.count == told
    checked.thread.end()
    assert not checked.thread.is_alive(), "one that waits ends as well"
    checked.thread.end()


def test_what_it_was_not_granted_is_waited_for(beside: Checked) -> None:
    def prepare() -> str:
        beside.wait_for(40)
        return "no priority was granted"

    checked = Checked(prepare)
    checked.thread.start()
    assert checked.thread.refusals == ("no priority was granted",)
    checked.thread.end()


def test_that_all_was_granted_is_known_at_once() -> None:
    checked = Checked()
    checked.thread.start()
    checked.thread.watch(False)
    checked.wait_for(1)
    told: list[tuple[str, ...]] = []
    asking = threading.Thread(target=lambda: told.append(checked.thread.refusals))
    asking.start()
    # Half of what is waited for one that does not begin.
    asking.join(1.0)
    assert told == [()]
    checked.thread.end()


def test_one_that_does_not_begin_is_not_waited_for_without_end() -> None:
    """Two seconds, none of them of the processor."""
    may_go_on = threading.Event()

    def hang() -> None:
        assert may_go_on.wait(PATIENCE_S)

    checked = Checked(hang)
    checked.thread.start()
    assert checked.thread.refusals == ()
    assert not may_go_on.is_set()
    may_go_on.set()
    checked.thread.end()


def test_one_that_hangs_keeps_no_process_from_ending() -> None:
    thread = Checked().thread
    assert thread.daemon
    assert thread.name == "etd-stopper", "as a dump of what hangs shows it"
