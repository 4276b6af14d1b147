"""Never so busy that the kernel throttles the scan thread."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.engine.cpu_budget import WINDOW_NS, CpuBudget
from etd.planning.duty import MAX_BUSY_FRACTION
from etd_hal.fake.clock import SteppedClock
from etd_hal.ports import SPIN_NS

MS = 1_000_000


def clocks() -> tuple[SteppedClock, CpuBudget]:
    stepped = SteppedClock()
    return stepped, CpuBudget(stepped, stepped.wakeups)


def test_the_share_is_four_fifths_of_every_100_ms() -> None:
    assert (MAX_BUSY_FRACTION, WINDOW_NS) == (0.8, 100 * MS)


def test_time_that_is_not_slept_is_busy() -> None:
    stepped, clock = clocks()
    stepped.spend(80 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is None
    stepped.spend(1 * MS)
    assert clock.pause_until_ns(clock.now_ns()) == clock.now_ns() + 1 * MS + SPIN_NS


def test_sleep_is_not_busy_but_for_what_is_spun_at_its_end() -> None:
    stepped, clock = clocks()
    for _ in range(80):
        clock.sleep_until_ns(clock.now_ns() + SPIN_NS)
        stepped.spend(1 * MS - SPIN_NS)
    assert clock.pause_until_ns(clock.now_ns()) is None
    stepped.spend(1 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is not None


def test_long_sleeps_leave_room() -> None:
    stepped, clock = clocks()
    for _ in range(9):
        clock.sleep_until_ns(clock.now_ns() + 5_050_000)
        stepped.spend(5 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is None


def test_of_a_doze_that_is_woken_as_much_counts_as_there_was() -> None:
    stepped, clock = clocks()
    came: list[bool] = []
    for _ in range(100):
        came.clear()
        stepped.spend(MS // 2)
        stepped.at(stepped.now_ns() + MS // 2, lambda: came.append(True))
        clock.doze_until_woken(clock.now_ns() + MS, lambda _: bool(came))
    assert clock.busy_percent == 50.0
    assert clock.waited_ns == 50 * MS
    clock.doze_until_woken(clock.now_ns() + 30 * MS, lambda _: False)
    assert clock.busy_percent == 35.0


def test_a_deadline_that_has_passed_is_no_sleep() -> None:
    stepped, clock = clocks()
    stepped.spend(50 * MS)
    clock.sleep_until_ns(clock.now_ns() - 40 * MS)
    stepped.spend(31 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is not None


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)), min_size=1, max_size=60))
def test_whatever_is_done_no_100_ms_are_busier_than_four_fifths(
    work_ms: list[tuple[int, int]],
) -> None:
    stepped, clock = clocks()
    busy: list[tuple[int, int]] = []
    for spent_ms, slept_ms in work_ms:
        for _ in range(spent_ms):
            while (pause_ns := clock.pause_until_ns(clock.now_ns())) is not None:
                clock.sleep_until_ns(pause_ns)
            busy.append((stepped.now_ns(), stepped.now_ns() + 1 * MS))
            stepped.spend(1 * MS)
        clock.sleep_until_ns(clock.now_ns() + slept_ms * MS)
    for _, end_ns in busy:
        begin_ns = end_ns - WINDOW_NS
        inside_ns = sum(max(0, end - max(begin, begin_ns)) for begin, end in busy if end <= end_ns)
        assert inside_ns <= 81 * MS, "80 ms, and the piece of work that was let begin"


def test_the_busy_share_of_the_last_100_ms_is_told() -> None:
    stepped, clock = clocks()
    stepped.spend(60 * MS)
    clock.sleep_until_ns(clock.now_ns() + 40 * MS + SPIN_NS)
    clock.pause_until_ns(clock.now_ns())
    assert clock.busy_percent == pytest.approx(60.0, abs=0.2)
    clock.sleep_until_ns(clock.now_ns() + 60 * MS)
    clock.pause_until_ns(clock.now_ns())
    assert clock.busy_percent < 1.0


def test_it_tells_the_time_of_the_clock_it_counts_for() -> None:
    stepped, clock = clocks()
    clock.sleep_until_ns(stepped.now_ns() + 7)
    assert clock.now_ns() == stepped.now_ns()


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30), st.booleans()), min_size=1),
)
def test_on_a_core_that_is_left_alone_no_100_ms_are_busier_than_98_and_none_after_it_is_not(
    work_ms: list[tuple[int, int, bool]],
) -> None:
    """Whether it is left alone is looked at every 50 ms."""
    stepped = SteppedClock()
    alone = [True]
    clock = CpuBudget(stepped, stepped.wakeups, lambda _: alone[0])
    busy: list[tuple[int, int, bool]] = []
    changed_ns = stepped.now_ns()
    for spent_ms, slept_ms, is_alone in work_ms:
        if alone[0] != is_alone:
            alone[0], changed_ns = is_alone, stepped.now_ns()
        for _ in range(spent_ms):
            while (pause_ns := clock.pause_until_ns(clock.now_ns())) is not None:
                clock.sleep_until_ns(pause_ns)
            is_settled = not is_alone and stepped.now_ns() - changed_ns > 50 * MS
            busy.append((stepped.now_ns(), stepped.now_ns() + 1 * MS, is_settled))
            stepped.spend(1 * MS)
        clock.sleep_until_ns(clock.now_ns() + slept_ms * MS)
    for last, (_, end_ns, is_settled) in enumerate(busy):
        # What began 100 pieces of 1 ms before is over before the window.
        pieces = busy[max(0, last - 100) : last + 1]
        begin_ns = end_ns - WINDOW_NS
        inside_ns = sum(max(0, end - max(begin, begin_ns)) for begin, end, _ in pieces)
        assert inside_ns <= (81 if is_settled else 99) * MS


def test_what_is_spun_of_a_sleep_follows_the_clock() -> None:
    stepped = SteppedClock(wake_late_ns=lambda: 8_000)
    clock = CpuBudget(stepped, stepped.wakeups)
    for _ in range(100):
        clock.sleep_until_ns(clock.now_ns() + 1 * MS)
    assert stepped.wakeups.spin_ns == 12_000
    stepped.spend(100 * MS)
    clock.sleep_until_ns(clock.now_ns() + 20 * MS)
    clock.pause_until_ns(clock.now_ns())
    assert clock.busy_percent == pytest.approx(80.012, abs=0.001)


def test_on_a_core_that_is_left_alone_98_ms_may_be_busy() -> None:
    stepped = SteppedClock()
    clock = CpuBudget(stepped, stepped.wakeups, lambda _: True)
    stepped.spend(98 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is None
    stepped.spend(1 * MS)
    assert clock.pause_until_ns(clock.now_ns()) is not None
