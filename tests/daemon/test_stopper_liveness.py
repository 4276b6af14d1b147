"""What the engine makes of its stopper: when it is silent, what its cuts mean, and what it is told
of the supply.

The words that both share are set by hand, as the other side would set them.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from etd.engine.stopper import SILENT_NS, StopperLiveness
from etd_hal.cutlatch import (
    ALIVE_NS,
    CAUSE,
    CUTS,
    LOOKED_NS,
    NOTE_ERROR,
    NOTED,
    OVERDUE,
    POWER,
    SILENT,
    WINDOW_NS,
    CutLatch,
)
from etd_hal.supply_note import SupplyNote

MS = 1_000_000
BEGUN_NS = 1_000 * MS


class Judged:
    """A liveness that began at one second, its polls 5 ms apart, and no look of the stopper."""

    def __init__(self, note: SupplyNote | None = None, *, most_silent_ns: int = SILENT_NS) -> None:
        self.latch = CutLatch()
        self.words = self.latch.words
        self.liveness = StopperLiveness(self.latch, note, most_silent_ns=most_silent_ns)
        self.now_ns = BEGUN_NS
        self.liveness.begin(BEGUN_NS)

    def poll(self, after_ns: int = 5 * MS) -> bool:
        self.now_ns += after_ns
        return self.liveness.judge(self.now_ns)

    def look(self) -> None:
        """As the stopper does, at the time of the last poll."""
        self.words[LOOKED_NS] = self.now_ns

    def cut(self, cause: int = OVERDUE) -> None:
        self.words[CAUSE] = cause
        self.words[CUTS] += 1


# --- silence --------------------------------------------------------------------------------------


def test_half_a_second_without_a_look_is_borne_and_a_nanosecond_more_is_not() -> None:
    made = Judged()
    assert SILENT_NS == 500 * MS
    for _ in range(100):
        assert not made.poll()
    assert made.liveness.silent_ns == 500 * MS
    assert made.liveness.problem is None
    assert made.poll(1)
    assert made.liveness.problem == (
        "the stopper made no check for 500 ms, it has ended or hangs: restart the daemon"
        " (one with a fake board, on a busy machine: with a greater --timeout-factor)"
    )
    made.poll(9 * MS)
    assert made.liveness.problem is not None
    assert "for 509 ms" in made.liveness.problem


def test_a_fakes_may_be_silent_for_longer() -> None:
    made = Judged(most_silent_ns=3 * SILENT_NS)
    for _ in range(300):
        assert not made.poll()
    assert made.liveness.problem is None
    assert made.poll(1)
    assert made.liveness.problem is not None


def test_each_look_begins_its_silence_anew() -> None:
    made = Judged()
    for _ in range(100):
        made.poll()
    made.look()
    assert not made.poll()
    assert made.liveness.silent_ns == 0
    for _ in range(100):
        assert not made.poll()
    assert made.poll(1)
    made.look()
    assert not made.poll()
    assert made.liveness.problem is None


@pytest.mark.parametrize(
    ("gap_ns", "counted_ns"),
    [(1, 1), (9_999_999, 9_999_999), (10 * MS, 10 * MS), (60_000 * MS, 10 * MS)],
)
def test_of_the_time_between_two_polls_at_most_ten_ms_count(gap_ns: int, counted_ns: int) -> None:
    made = Judged()
    made.poll(2 * MS)
    made.poll(gap_ns)
    assert made.liveness.silent_ns == 2 * MS + counted_ns


def test_waking_it_again_forgets_what_was_silent_before() -> None:
    """It slept with the supply off, and what had been its last look is no sign of life."""
    made = Judged()
    made.look()
    assert made.liveness.has_looked
    for _ in range(200):
        made.poll()
    assert made.liveness.problem is not None
    made.liveness.begin(made.now_ns)
    assert made.liveness.problem is None
    assert made.liveness.silent_ns == 0
    assert not made.liveness.has_looked
    made.poll(3 * MS)
    assert made.liveness.silent_ns == 3 * MS
    made.words[LOOKED_NS] = made.now_ns - 3 * MS
    assert made.liveness.has_looked, "in the very nanosecond in which it was woken"


def test_of_one_that_was_never_woken_silence_counts_from_the_clocks_zero() -> None:
    """No arming has waited for it yet, and there is no look that it must have made."""
    liveness = StopperLiveness(CutLatch())
    assert liveness.silent_ns == 0
    assert liveness.has_looked
    assert not liveness.judge(3 * MS)
    assert liveness.silent_ns == 3 * MS


def test_each_poll_is_the_engines_sign_of_life() -> None:
    made = Judged()
    made.poll(7 * MS)
    assert made.words[ALIVE_NS] == BEGUN_NS + 7 * MS
    made.poll(1)
    assert made.words[ALIVE_NS] == BEGUN_NS + 7 * MS + 1


# --- its cuts -------------------------------------------------------------------------------------


def test_a_cut_is_told_at_each_poll_until_its_halt_is_cleared() -> None:
    made = Judged()
    assert not made.poll()
    assert not made.liveness.has_acted
    made.cut()
    for _ in range(3):
        assert made.poll()
        assert made.liveness.has_acted
    made.liveness.clear()
    assert not made.liveness.has_acted
    assert not made.poll()
    made.cut()
    assert made.poll()


def test_a_cut_is_no_silence() -> None:
    made = Judged()
    made.cut()
    assert made.poll()
    assert made.liveness.problem is None


def test_why_it_acted_is_the_cause_of_the_cut() -> None:
    made = Judged()
    made.words[WINDOW_NS] = 20 * MS
    made.cut(OVERDUE)
    assert made.liveness.why_acted == "an SPI message was overdue; its outputs were cut off"
    made.cut(SILENT)
    assert made.liveness.why_acted == (
        "the engine made no poll for more than 20 ms while the supply was on; outputs and supply"
        " were cut off"
    )


# --- the supply -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("power", "told"), [(0, 1), (1, 3), (2, 3), (3, 5)])
def test_a_supply_that_rises_is_told_by_another_odd_number(power: int, told: int) -> None:
    made = Judged()
    made.words[POWER] = power
    made.liveness.supply_rises()
    assert made.words[POWER] == told


@pytest.mark.parametrize(("power", "told"), [(0, 2), (1, 2), (2, 4), (3, 4)])
def test_a_halt_that_is_cleared_is_told_by_another_even_number(power: int, told: int) -> None:
    """Also with the supply off: what the last engine left is still noted."""
    made = Judged()
    made.words[POWER] = power
    made.liveness.clear()
    assert made.words[POWER] == told


@pytest.mark.parametrize(("power", "told"), [(0, 0), (1, 2), (2, 2), (3, 4)])
def test_a_board_that_was_made_safe_ends_its_power_up_once(power: int, told: int) -> None:
    made = Judged()
    made.words[POWER] = power
    made.liveness.made_safe(())
    made.liveness.made_safe(())
    assert made.words[POWER] == told


def test_a_board_that_could_not_be_made_safe_is_still_to_be_remembered() -> None:
    made = Judged()
    made.words[POWER] = 3
    made.liveness.made_safe(("set on the lines failed (io)",))
    assert made.words[POWER] == 3


@pytest.mark.parametrize(("power", "is_told"), [(0, False), (1, True), (2, False), (3, True)])
def test_the_supply_is_told_of_from_before_it_rises_until_the_board_is_safe(
    power: int, is_told: bool
) -> None:
    made = Judged()
    made.words[POWER] = power
    assert made.liveness.is_supply_told is is_told


def test_a_defect_is_noted_by_the_engine_itself(tmp_path: Path) -> None:
    made = Judged(SupplyNote(tmp_path / "supply.json"))
    made.liveness.note_defect()
    assert "ended by a defect of its own" in str(made.liveness.left)
    Judged().liveness.note_defect()


def test_what_it_was_told_is_noted_once_the_stopper_says_just_that() -> None:
    made = Judged()
    assert made.liveness.has_noted, "nothing was told"
    made.liveness.supply_rises()
    assert not made.liveness.has_noted
    made.words[NOTED] = 1
    assert made.liveness.has_noted
    made.liveness.made_safe(())
    assert not made.liveness.has_noted


def test_a_note_that_cannot_be_kept_is_told_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "supply.json"
    made = Judged(SupplyNote(path))
    assert made.liveness.note_problem is None
    made.words[NOTE_ERROR] = errno.EROFS
    assert made.liveness.note_problem is not None
    assert f"cannot be noted in {path} (Read-only file system)" in made.liveness.note_problem


def test_that_it_cannot_be_kept_is_found_by_trying(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = Judged(SupplyNote(tmp_path / "supply.json"))
    made.liveness.try_note()
    assert made.liveness.note_problem is None
    assert list(tmp_path.iterdir()) == []
    lost = Judged(SupplyNote(tmp_path / "absent" / "supply.json"))
    lost.liveness.try_note()
    assert lost.words[NOTE_ERROR] == errno.ENOENT

    def fail(_: int) -> None:
        raise OSError("of no number")

    monkeypatch.setattr(os, "fsync", fail)
    made.liveness.try_note()
    assert made.words[NOTE_ERROR] == errno.EIO
    without = Judged()
    without.liveness.try_note()
    assert without.liveness.note_problem is None


def test_a_note_that_must_not_be_kept_is_told_with_the_reason() -> None:
    made = Judged()
    made.liveness.refuse_note("/state: this folder belongs to somebody else")
    assert made.liveness.note_problem == (
        "that the supply is on cannot be noted: /state: this folder belongs to somebody else"
    )


def test_without_a_note_of_its_own_it_has_no_place_to_tell() -> None:
    made = Judged()
    assert made.liveness.left is None
    made.words[NOTE_ERROR] = errno.EIO
    assert made.liveness.note_problem is not None
    assert "cannot be noted (Input/output error)" in made.liveness.note_problem


def test_what_the_last_engine_left_is_what_the_note_says(tmp_path: Path) -> None:
    note = SupplyNote(tmp_path / "supply.json")
    made = Judged(note)
    assert made.liveness.left is None
    note.keep()
    assert made.liveness.left == (
        "the last engine was killed with the supply on, or could not make the board safe"
    )
