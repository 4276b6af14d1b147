"""Never so busy that the kernel throttles the scan thread."""

from __future__ import annotations

from etd.engine.duty import WINDOW_NS, BusyClock
from etd.engine.plan import BUSY_PART
from etd_hal.fake.clock import SteppedClock

MS = 1_000_000


def clocks() -> tuple[SteppedClock, BusyClock]:
    stepped = SteppedClock()
    return stepped, BusyClock(stepped)


def test_the_share_is_four_fifths_of_every_100_ms() -> None:
    assert (BUSY_PART, WINDOW_NS) == (0.8, 100 * MS)


def test_time_that_is_not_slept_is_busy() -> None:
    stepped, clock = clocks()
    stepped.spend(79 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is None
    stepped.spend(1 * MS)
    assert clock.pause_until_ns(clock.now_ns()) == clock.now_ns() + 20 * MS


def test_sleep_is_not_busy_but_for_what_is_spun_at_its_end() -> None:
    stepped, clock = clocks()
    for _ in range(79):
        clock.sleep_until_ns(clock.now_ns() + 50_000)
        stepped.spend(950_000)
    assert clock.pause_until_ns(clock.now_ns()) is None
    stepped.spend(1 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is not None


def test_long_sleeps_leave_room() -> None:
    stepped, clock = clocks()
    for _ in range(9):
        clock.sleep_until_ns(clock.now_ns() + 5_050_000)
        stepped.spend(5 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is None


def test_a_deadline_that_has_passed_is_no_sleep() -> None:
    stepped, clock = clocks()
    stepped.spend(50 * MS)
    clock.sleep_until_ns(clock.now_ns() - 40 * MS)
    stepped.spend(30 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is not None


def test_a_new_window_begins_from_zero_and_the_last_one_is_told() -> None:
    stepped, clock = clocks()
    stepped.spend(60 * MS)
    clock.sleep_until_ns(clock.now_ns() + 40 * MS + 50_000)
    assert clock.pause_until_ns(clock.now_ns()) is None
    assert round(clock.busy_percent, 1) == 60.0
    stepped.spend(79 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is None
    stepped.spend(1 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is not None


def test_it_tells_the_time_of_the_clock_it_counts_for() -> None:
    stepped, clock = clocks()
    clock.sleep_until_ns(stepped.now_ns() + 7)
    assert clock.now_ns() == stepped.now_ns()
