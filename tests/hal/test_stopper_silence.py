"""What the stopper takes for silence, for every course of polls and checks."""

from __future__ import annotations

import errno
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

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
WINDOW = 20 * MS


class Watched:
    """A stopper on memory, with its time by hand."""

    def __init__(self, note: SupplyNote | None = None) -> None:
        self.latch = CutLatch()
        self.words = self.latch.words
        self.now_ns = 1_000 * MS
        self.cuts_ns: list[int] = []
        self.stopper = Stopper(self.words, lambda: self.now_ns, self._cut, note)
        self.words[WINDOW_NS] = WINDOW
        self.words[POWER] = 1
        self.poll()
        self.stopper.check()

    def _cut(self) -> None:
        self.cuts_ns.append(self.now_ns)

    def poll(self) -> None:
        self.words[ALIVE_NS] = self.now_ns

    def check_for(self, duration_ns: int, every_ns: int = PERIOD_NS) -> None:
        until_ns = self.now_ns + duration_ns
        while self.now_ns < until_ns:
            self.now_ns += every_ns
            self.stopper.check()


@given(gaps_us=st.lists(st.integers(1, 30_000), max_size=40))
def test_it_cuts_for_each_gap_that_is_longer_than_the_window_and_for_no_other(
    gaps_us: list[int],
) -> None:
    made = Watched()
    for gap_us in gaps_us:
        begun_ns, before = made.now_ns, made.words[CUTS]
        made.check_for(gap_us * 1_000)
        gap_ns = made.now_ns - begun_ns
        has_cut = made.words[CUTS] > before
        assert has_cut <= (gap_ns > WINDOW)
        assert has_cut >= (gap_ns > WINDOW + 2 * PERIOD_NS)
        assert made.words[CUTS] - before <= 1, "a silence is counted once"
        if has_cut:
            assert made.words[CAUSE] == SILENT
            assert min(t for t in made.cuts_ns if t > begun_ns) - begun_ns <= WINDOW + MS
        made.latch.see()
        made.now_ns += 1
        made.poll()


@given(stalls_ms=st.lists(st.integers(5, 5_000), min_size=1, max_size=3))
def test_a_machine_that_stood_still_as_a_whole_is_no_silence(stalls_ms: list[int]) -> None:
    made = Watched()
    for stall_ms in stalls_ms:
        made.now_ns += stall_ms * MS
        made.stopper.check()
    assert len(stalls_ms) * COUNTED_NS < WINDOW
    assert made.words[CUTS] == 0


def test_it_repeats_its_call_until_that_is_seen_and_judges_the_next_silence_anew() -> None:
    made = Watched()
    made.check_for(30 * MS)
    calls = len(made.cuts_ns)
    assert calls > 10
    assert made.words[CUTS] == 1
    made.latch.see()
    made.check_for(100 * MS)
    assert len(made.cuts_ns) == calls
    made.poll()
    made.check_for(30 * MS)
    assert made.words[CUTS] == 2


def test_without_supply_or_window_silence_is_allowed() -> None:
    for word, value in ((POWER, 2), (WINDOW_NS, 0)):
        made = Watched()
        made.words[word] = value
        made.check_for(1_000 * MS)
        assert made.words[CUTS] == 0


def test_an_engine_that_has_never_polled_is_silent_too() -> None:
    made = Watched()
    made.words[ALIVE_NS] = 0
    made.check_for(30 * MS)
    assert made.words[CUTS] == 1


def test_silence_before_the_supply_rose_does_not_count() -> None:
    made = Watched()
    made.words[POWER] = 2
    made.check_for(500 * MS)
    made.words[POWER] = 3
    made.check_for(19 * MS)
    assert made.words[CUTS] == 0


def test_the_first_cause_stands_until_it_is_seen() -> None:
    made = Watched()
    made.words[DUE_NS] = made.now_ns - OVERDUE_NS - 1
    made.check_for(30 * MS)
    assert (made.words[CUTS], made.words[CAUSE]) == (2, OVERDUE)
    made.latch.see()
    made.poll()
    made.check_for(30 * MS)
    assert (made.words[CUTS], made.words[CAUSE]) == (3, SILENT)


def test_the_note_follows_the_supply_and_what_fails_is_told(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "supply.json"
    made = Watched(SupplyNote(path))
    assert (made.words[NOTED], made.words[NOTE_ERROR]) == (1, errno.ENOENT)
    path.parent.mkdir()
    made.words[POWER] = 3
    made.stopper.check()
    assert (made.words[NOTED], made.words[NOTE_ERROR]) == (3, 0)
    assert path.exists()
    made.words[POWER] = 4
    made.stopper.check()
    assert (made.words[NOTED], made.words[NOTE_ERROR]) == (4, 0)
    assert not path.exists()
