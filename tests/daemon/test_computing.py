"""What this machine computes for a pulse, as scans show it; and scans that come late."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.engine.computing import MeasuredComputing
from etd.engine.cpu_budget import CpuBudget
from etd.planning.lateness import Lateness
from etd_hal.fake.clock import SteppedClock

MS = 1_000_000


def scan(
    stepped: SteppedClock, clock: CpuBudget, computing: MeasuredComputing, computed_us: float
) -> None:
    """Ten pulses with 120 us on the wire, and rests of 200 us that computing may fill."""
    computing.begin(clock.now_ns())
    for _ in range(10):
        stepped.spend(120_000)
        rested_ns = clock.now_ns() + 200_000
        stepped.spend(round(computed_us * 1_000))
        clock.sleep_until_ns(rested_ns)
    computing.end(clock.now_ns(), 10, 10 * 120.0)


def made(filed_us: float = 180.0) -> tuple[SteppedClock, CpuBudget, MeasuredComputing]:
    stepped = SteppedClock()
    clock = CpuBudget(stepped, stepped.wakeups)
    return stepped, clock, MeasuredComputing(clock, filed_us)


class TestMeasuredComputing:
    def test_the_machine_file_is_believed_until_a_scan_was_measured(self) -> None:
        stepped, clock, computing = made(180.0)
        assert computing.pulse_us == 180.0
        scan(stepped, clock, computing, 70.0)
        assert computing.pulse_us == pytest.approx(70.0)

    @pytest.mark.parametrize("computed_us", [0.0, 30.0, 170.0, 700.0])
    def test_what_is_neither_waited_nor_on_the_wire_was_computed(self, computed_us: float) -> None:
        stepped, clock, computing = made()
        scan(stepped, clock, computing, computed_us)
        assert computing.pulse_us == pytest.approx(computed_us)

    def test_pauses_and_dozes_are_waited(self) -> None:
        stepped, clock, computing = made()
        computing.begin(clock.now_ns())
        stepped.spend(1_000_000)
        clock.doze_until_ns(clock.now_ns() + 30 * MS)
        clock.sleep_until_ns(clock.now_ns() + 20_000)
        computing.end(clock.now_ns(), 10, 0.0)
        assert computing.pulse_us == pytest.approx(100.0)

    def test_a_single_stall_changes_nothing(self) -> None:
        stepped, clock, computing = made()
        for computed_us in (50.0, 50.0, 9_000.0, 50.0):
            scan(stepped, clock, computing, computed_us)
        assert computing.pulse_us == pytest.approx(50.0)

    def test_it_follows_a_machine_that_has_become_slower(self) -> None:
        stepped, clock, computing = made()
        for computed_us in (50.0,) * 20 + (90.0,) * 6:
            scan(stepped, clock, computing, computed_us)
        assert computing.pulse_us == pytest.approx(90.0)

    def test_a_scan_of_few_pulses_says_nothing_of_others(self) -> None:
        stepped, clock, computing = made(180.0)
        computing.begin(clock.now_ns())
        stepped.spend(5 * MS)
        computing.end(clock.now_ns(), 3, 300.0)
        assert computing.pulse_us == 180.0

    def test_between_two_scans_it_is_a_pulse_until_it_was_measured(self) -> None:
        stepped, clock, computing = made(180.0)
        assert computing.between_us == 180.0
        scan(stepped, clock, computing, 70.0)
        assert computing.between_us == pytest.approx(70.0)

    @given(
        computed_us=st.floats(0.0, 900.0),
        waits_us=st.lists(st.floats(60.0, 3_000.0), max_size=8),
        stall_ms=st.integers(0, 50),
    )
    def test_what_is_computed_between_two_scans_is_measured_apart_and_one_stall_changes_nothing(
        self, computed_us: float, waits_us: list[float], stall_ms: int
    ) -> None:
        stepped, clock, computing = made(0.0)
        for number in range(9):
            scan(stepped, clock, computing, 0.0)
            computing.scan_ended(clock.now_ns(), 0)
            stepped.spend(round(computed_us * 1_000) + (number == 3) * stall_ms * MS)
            for wait_us in waits_us:
                clock.doze_until_ns(clock.now_ns() + round(wait_us * 1_000))
            computing.begin(clock.now_ns())
        assert computing.between_us == pytest.approx(computed_us, abs=0.01)
        assert computing.pulse_us == pytest.approx(0.0, abs=0.01)

    def test_polls_between_two_waits_are_not_the_scans_own(self) -> None:
        stepped, clock, computing = made()
        for _ in range(9):
            scan(stepped, clock, computing, 100.0)
            computing.scan_ended(clock.now_ns(), 0)
            stepped.spend(30_000)
            for _ in range(5):
                clock.doze_until_ns(clock.now_ns() + MS)
                stepped.spend(10_000)
            computing.begin(clock.now_ns())
        # The last of the five is the poll in which the scan begins.
        assert computing.between_us == pytest.approx(40.0)

    def test_a_frame_that_is_planned_between_two_scans_is_not_the_scans_own(self) -> None:
        stepped, clock, computing = made()
        for number in range(9):
            scan(stepped, clock, computing, 100.0)
            computing.scan_ended(clock.now_ns(), number * 5 * MS)
            stepped.spend(5_060_000)
            computing.begin(clock.now_ns(), (number + 1) * 5 * MS)
        assert computing.between_us == pytest.approx(60.0)

    def test_what_lies_between_two_frames_is_no_scans(self) -> None:
        stepped, clock, computing = made()
        for _ in range(9):
            scan(stepped, clock, computing, 100.0)
            computing.scan_ended(clock.now_ns(), 0)
            stepped.spend(20 * MS)
            computing.scans_ended()
        assert computing.between_us == pytest.approx(100.0)

    def test_lateness_stretches_plans_and_punctuality_takes_it_back_slowly(self) -> None:
        _, _, computing = made()
        computing.came_late(1.3)
        assert computing.stretch == 1.3
        computing.came_in_time()
        assert 1.2 < computing.stretch < 1.3
        for _ in range(9):
            computing.came_in_time()
        assert computing.stretch == 1.0


def ratios(taken_ms: list[float], period_ms: float = 20.0) -> list[float]:
    lateness, now_ns, found = Lateness(), 0, []
    for each_ms in (0.0, *taken_ms):
        now_ns += round(each_ms * MS)
        ratio = lateness.begun(now_ns, round(period_ms * MS))
        if ratio is not None:
            found.append(ratio)
    return found


class TestLateness:
    def test_once_a_second_it_says_how_late_scans_were(self) -> None:
        assert ratios([20.0] * 150) == pytest.approx([1.0] * 3)
        assert ratios([26.0] * 117) == pytest.approx([1.3] * 3)

    def test_less_than_a_second_says_nothing(self) -> None:
        assert ratios([26.0] * 38) == []

    def test_a_single_stall_is_no_lateness(self) -> None:
        assert ratios([20.0] * 30 + [300.0] + [20.0] * 5) == pytest.approx([1.0])

    def test_two_stalls_in_a_second_are_lateness(self) -> None:
        assert ratios([20.0] * 20 + [210.0] * 2 + [20.0] * 9)[0] == pytest.approx(790 / 600)

    def test_a_scan_that_takes_a_second_counts_by_itself(self) -> None:
        assert ratios([1_500.0, 1_500.0], 1_000.0) == pytest.approx([1.5, 1.5])

    def test_silence_is_no_lateness(self) -> None:
        lateness = Lateness()
        for number in range(40):
            assert lateness.begun(number * 20 * MS, 20 * MS) is None
        lateness.reset()
        assert lateness.begun(60_000 * MS, 20 * MS) is None
        assert lateness.begun(60_020 * MS, 20 * MS) is None

    @given(st.lists(st.floats(18.0, 22.0), min_size=60, max_size=200))
    def test_scans_that_are_late_by_less_than_a_tenth_are_never_late(
        self, taken_ms: list[float]
    ) -> None:
        assert all(ratio <= 1.1 for ratio in ratios(taken_ms))
