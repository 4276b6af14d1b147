"""What is spun at the end of a sleep: as little as the machine's own wake-ups need."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_hal.fake.clock import LiveClock, SteppedClock
from etd_hal.fake.machines import MACHINES, MachineModel
from etd_hal.linux.clock import LinuxClock
from etd_hal.ports import SPIN_NS
from etd_hal.wakeups import LEAST_SPIN_NS, WakeUps

pytestmark = pytest.mark.slow

US = 1_000
MS = 1_000_000


def noted(*late_ns: int) -> WakeUps:
    wakeups = WakeUps()
    for each in late_ns:
        wakeups.note(each)
    return wakeups


def test_until_wake_ups_are_known_the_most_is_spun() -> None:
    assert noted().spin_ns == noted(*[8 * US] * 64).spin_ns == SPIN_NS
    assert noted(*[8 * US] * 97).spin_ns < SPIN_NS


@pytest.mark.parametrize(
    ("late_us", "spun_us"), [(0, 10), (4, 10), (8, 12), (20, 27), (38.4, 50), (45, 50), (400, 50)]
)
def test_it_is_the_lateness_and_a_margin_within_bounds(late_us: float, spun_us: int) -> None:
    assert noted(*[round(late_us * US)] * 256).spin_ns == spun_us * US


@given(st.lists(st.integers(0, 200 * US), max_size=600))
def test_it_is_never_less_than_10_us_nor_more_than_50(late_ns: list[int]) -> None:
    assert LEAST_SPIN_NS <= noted(*late_ns).spin_ns <= SPIN_NS


@given(
    late_ns=st.lists(st.integers(0, 38 * US), min_size=256, max_size=256),
    order=st.randoms(use_true_random=False),
)
def test_of_the_last_256_wake_ups_no_more_than_32_are_beyond_it(
    late_ns: list[int], order: Random
) -> None:
    order.shuffle(late_ns)
    spin_ns = noted(*late_ns).spin_ns
    assert sum(each > spin_ns for each in late_ns) <= 32


def test_one_stall_does_not_move_it_and_is_counted() -> None:
    wakeups = noted(*[8 * US] * 256, 900 * US)
    for _ in range(300):
        wakeups.note(8 * US)
        assert (wakeups.spin_ns, wakeups.late) == (12 * US, 1)


def test_a_machine_that_begins_to_wake_later_is_followed_within_two_blocks() -> None:
    wakeups = noted(*[8 * US] * 256)
    beyond = 0
    while wakeups.spin_ns < 30 * US:
        wakeups.note(30 * US)
        beyond += 1
    assert wakeups.late == beyond <= 33


def test_one_that_wakes_in_time_again_is_followed_when_the_late_ones_are_256_ago() -> None:
    wakeups = noted(*[30 * US] * 256, *[8 * US] * 257)
    assert wakeups.spin_ns == 12 * US


class System:
    """A clock that moves by each look, and a sleep that is late."""

    def __init__(self, late_ns: int) -> None:
        self.t_ns = 1_000_000
        self.late_ns = late_ns
        self.slept_ns = 0

    def monotonic_ns(self) -> int:
        self.t_ns += 50
        return self.t_ns

    def sleep_s(self, seconds: float) -> None:
        self.slept_ns = round(seconds * 1e9)
        self.t_ns += self.slept_ns + self.late_ns


@pytest.mark.parametrize("late_us", [0, 8, 20, 35])
def test_the_kernels_clock_spins_less_where_it_wakes_in_time_and_still_ends_exactly(
    late_us: int,
) -> None:
    system = System(late_us * US)
    clock = LinuxClock(system.monotonic_ns, system.sleep_s)
    late_ns = []
    for _ in range(300):
        deadline_ns = clock.now_ns() + 500 * US
        clock.sleep_until_ns(deadline_ns)
        late_ns.append(system.t_ns - deadline_ns)
    assert max(late_ns) <= 100
    assert system.slept_ns == pytest.approx(500 * US - max(10, late_us * 1.25 + 2) * US, abs=200)
    assert clock.wakeups.late == 0


@pytest.mark.parametrize("model", MACHINES.values(), ids=MACHINES)
@pytest.mark.parametrize("is_live", [False, True])
def test_on_a_modelled_machine_no_deadline_is_missed_for_it(
    model: MachineModel, is_live: bool
) -> None:
    stepped = SteppedClock(wake_late_ns=None if is_live else model.wake_late)
    clock = LiveClock(stepped, None, model.wake_late) if is_live else stepped
    for _ in range(300):
        deadline_ns = clock.now_ns() + 200 * US
        clock.sleep_until_ns(deadline_ns)
        assert clock.now_ns() == deadline_ns
    assert clock.wakeups.late == 0
    assert clock.wakeups.spin_ns == model.wake_late_ns * 5 // 4 + 2 * US


@given(
    worst_ns=st.integers(0, 80 * US),
    parts=st.lists(st.floats(0.8, 1.0), min_size=400, max_size=400),
)
def test_wake_ups_that_scatter_by_a_fifth_miss_a_deadline_by_no_more_than_with_50_us(
    worst_ns: int, parts: list[float]
) -> None:
    late_ns = [int(worst_ns * part) for part in parts]
    coming = iter(late_ns)
    clock = SteppedClock(wake_late_ns=lambda: next(coming))
    for each_ns in late_ns:
        deadline_ns = clock.now_ns() + 200 * US
        clock.sleep_until_ns(deadline_ns)
        assert clock.now_ns() - deadline_ns == max(0, each_ns - SPIN_NS)
