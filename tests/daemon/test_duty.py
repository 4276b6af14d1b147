"""The period of a scan that lets the processor sleep, against the budget of the loop."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.engine.cpu_budget import CpuBudget
from etd.planning.duty import (
    ALONE_BUSY_FRACTION,
    BELOW_BRAKE,
    MAX_BUSY_FRACTION,
    shortest_period_us,
)
from etd_hal.fake.clock import SteppedClock


def test_a_scan_that_sleeps_enough_needs_no_more() -> None:
    assert shortest_period_us(20_000.0, 4_000.0, 50.0, 0.8) == 20_000.0


def test_a_busy_scan_is_followed_by_a_wait() -> None:
    assert shortest_period_us(10_000.0, 0.0, 0.0, 0.8) == pytest.approx(12_500.0)


def test_polls_in_the_wait_need_a_longer_one() -> None:
    assert shortest_period_us(10_000.0, 0.0, 100.0, 0.8) > 1.01 * shortest_period_us(
        10_000.0, 0.0, 0.0, 0.8
    )


def test_a_scan_that_has_to_pause_within_takes_the_mean() -> None:
    assert shortest_period_us(400_000.0, 0.0, 0.0, 0.8) == pytest.approx(500_000.0)


@given(
    slots_ms=st.floats(5.0, 78.0),
    slept_part=st.floats(0.0, 0.5),
    idle_us=st.floats(0.0, 100.0),
    fraction=st.sampled_from([MAX_BUSY_FRACTION, ALONE_BUSY_FRACTION]),
)
def test_at_that_period_the_loop_hardly_has_to_pause(
    slots_ms: float, slept_part: float, idle_us: float, fraction: float
) -> None:
    slots_us = slots_ms * 1e3
    period_us = shortest_period_us(slots_us, slept_part * slots_us, idle_us, fraction - BELOW_BRAKE)
    stepped = SteppedClock()
    clock = CpuBudget(stepped, stepped.wakeups, lambda _: fraction > 0.8)
    each_us, pulses, scans = slots_us / 64, 64, 30
    begun_ns = due_ns = clock.now_ns()
    for _ in range(scans):
        due_ns = max(due_ns, clock.now_ns()) + round(period_us * 1_000)
        for _ in range(pulses):
            while (pause_ns := clock.pause_until_ns(clock.now_ns())) is not None:
                clock.sleep_until_ns(pause_ns)
            stepped.spend(round(each_us * (1 - slept_part) * 1_000))
            clock.doze_until_ns(clock.now_ns() + round(each_us * slept_part * 1_000))
        while clock.now_ns() < due_ns:
            stepped.spend(round(idle_us * 1_000))
            clock.doze_until_ns(min(due_ns, clock.now_ns() + 1_000_000))
    assert clock.now_ns() - begun_ns <= 1.05 * scans * period_us * 1_000


def test_on_a_core_that_is_left_alone_only_a_fiftieth_is_waited() -> None:
    assert shortest_period_us(9_800.0, 0.0, 0.0, ALONE_BUSY_FRACTION) == pytest.approx(10_000.0)
