"""The stopper's bounds, to the nanosecond: what is overdue, what is silence, and when it writes."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from etd_hal.cutlatch import (
    ALIVE_NS,
    CAUSE,
    CUTS,
    DUE_NS,
    NOTE_ERROR,
    NOTED,
    OVERDUE,
    POWER,
    SILENT,
    WINDOW_NS,
    CutLatch,
)
from etd_hal.stopper import COUNTED_NS, OVERDUE_NS, PERIOD_NS, Stopper
from etd_hal.supply_note import SupplyNote

MS = 1_000_000


class Timed:
    """A stopper on memory whose clock stands at zero, beside an engine that may be silent for
    20 ms.
    """

    def __init__(self, note: SupplyNote | None = None) -> None:
        self.latch = CutLatch()
        self.words = self.latch.words
        self.words[WINDOW_NS] = 20 * MS
        self.now_ns = 0
        self._stopper = Stopper(self.words, lambda: self.now_ns, lambda: None, note)

    def check(self, at_ns: int) -> int:
        """Returns how many cuts there are then."""
        self.now_ns = at_ns
        self._stopper.check()
        return self.words[CUTS]


def test_the_figures_are_those_of_the_documents() -> None:
    assert OVERDUE_NS == MS
    assert 2 * PERIOD_NS == MS
    assert COUNTED_NS == 5 * MS


# --- overdue --------------------------------------------------------------------------------------


@pytest.mark.parametrize("due_ns", [1, 7 * MS])
def test_a_message_is_overdue_a_nanosecond_after_the_millisecond(due_ns: int) -> None:
    made = Timed()
    made.words[DUE_NS] = due_ns
    assert made.check(due_ns + MS) == 0
    assert made.check(due_ns + MS + 1) == 1
    assert made.words[CAUSE] == OVERDUE


# --- silent ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("alive_ns", [1, 100 * MS])
def test_silence_is_a_nanosecond_more_than_the_window_from_the_poll_that_was_seen(
    alive_ns: int,
) -> None:
    made = Timed()
    made.words[POWER] = 1
    made.words[ALIVE_NS] = alive_ns
    for at_ms in (100, 104, 108, 112, 116, 120):
        assert made.check(at_ms * MS) == 0
    assert made.check(120 * MS + 1) == 1
    assert made.words[CAUSE] == SILENT


def test_of_the_time_between_two_checks_five_ms_count() -> None:
    """A minute between each: four count 20 ms, which is the window and no more."""
    made = Timed()
    made.words[POWER] = 1
    made.words[ALIVE_NS] = MS
    for minute in range(1, 6):
        assert made.check(minute * 60_000 * MS) == 0
    assert made.check(5 * 60_000 * MS + 1) == 1


def test_an_engine_that_has_never_polled_is_silent_from_the_beginning_on() -> None:
    """2 ms until the first check, and 18 after it."""
    made = Timed()
    made.words[POWER] = 1
    for at_ms in (2, 7, 12, 17, 20):
        assert made.check(at_ms * MS) == 0
    assert made.check(20 * MS + 1) == 1


# --- the note -------------------------------------------------------------------------------------


def test_what_is_noted_is_not_written_again_at_each_check(tmp_path: Path) -> None:
    """Each time would wait for the disk, 2 000 times a second."""
    path = tmp_path / "supply.json"
    made = Timed(SupplyNote(path))
    made.words[POWER] = 1
    made.check(MS)
    path.unlink()
    made.check(2 * MS)
    assert not path.exists()
    made.words[POWER] = 3
    made.check(3 * MS)
    assert path.exists()
    assert made.words[NOTED] == 3


class FullDisk(SupplyNote):
    """An error that has no number is still one."""

    def keep(self) -> None:
        raise OSError("the disk is full")


def test_an_error_without_a_number_is_told_as_one(tmp_path: Path) -> None:
    made = Timed(FullDisk(tmp_path / "supply.json"))
    made.words[POWER] = 1
    made.check(MS)
    assert (made.words[NOTED], made.words[NOTE_ERROR]) == (1, errno.EIO)
