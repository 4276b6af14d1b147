"""A sleep that wakes up early enough to be exact, and never spins for long."""

from __future__ import annotations

import subprocess
import sys

from hypothesis import given
from hypothesis import strategies as st

from etd_hal.linux.clock import LinuxClock
from etd_hal.ports import SPIN_NS


class System:
    """A clock that moves by `step_ns` at each look, and a sleep that overshoots."""

    def __init__(self, step_ns: int, overshoot_ns: int) -> None:
        self.t_ns = 1_000_000
        self.step_ns = step_ns
        self.overshoot_ns = overshoot_ns
        self.slept_until_ns: list[int] = []

    def monotonic_ns(self) -> int:
        self.t_ns += self.step_ns
        return self.t_ns

    def sleep_s(self, seconds: float) -> None:
        assert seconds > 0
        self.t_ns += round(seconds * 1e9)
        self.slept_until_ns.append(self.t_ns)
        self.t_ns += self.overshoot_ns


@given(
    wait_ns=st.integers(-1_000_000, 10_000_000),
    step_ns=st.integers(50, 5_000),
    overshoot_ns=st.integers(0, 500_000),
)
def test_it_returns_at_the_deadline_or_later_and_spins_the_last_50_us_at_most(
    wait_ns: int, step_ns: int, overshoot_ns: int
) -> None:
    system = System(step_ns, overshoot_ns)
    deadline_ns = system.t_ns + wait_ns
    LinuxClock(system.monotonic_ns, system.sleep_s).sleep_until_ns(deadline_ns)
    assert system.t_ns >= deadline_ns
    awake_from_ns = system.slept_until_ns[0] if system.slept_until_ns else deadline_ns - wait_ns
    assert deadline_ns - awake_from_ns <= SPIN_NS + step_ns
    if not overshoot_ns:
        assert system.t_ns <= max(deadline_ns, awake_from_ns) + 2 * step_ns


def test_it_is_awake_before_the_deadline_when_the_sleep_is_exact() -> None:
    system = System(100, 0)
    deadline_ns = system.t_ns + 1_000_000
    LinuxClock(system.monotonic_ns, system.sleep_s).sleep_until_ns(deadline_ns)
    assert deadline_ns - SPIN_NS <= system.slept_until_ns[0] < deadline_ns


def test_a_doze_sleeps_all_of_it_and_is_never_early() -> None:
    system = System(100, 3_000)
    deadline_ns = system.t_ns + 1_000_000
    LinuxClock(system.monotonic_ns, system.sleep_s).doze_until_ns(deadline_ns)
    assert system.slept_until_ns == [deadline_ns]
    assert system.t_ns >= deadline_ns


def test_a_doze_ends_when_that_comes_for_which_it_waits_and_never_before_without_it() -> None:
    system = System(100, 0)
    begun_ns = system.t_ns
    waited_s: list[float] = []

    def wait(timeout_s: float) -> bool:
        waited_s.append(timeout_s)
        # Too early at first, as a wait that a signal ends.
        system.t_ns += 400_000
        return len(waited_s) == 2

    clock = LinuxClock(system.monotonic_ns, system.sleep_s)
    clock.doze_until_woken(begun_ns + 1_000_000, wait)
    assert begun_ns + 800_000 <= system.t_ns < begun_ns + 1_000_000
    assert 0.0 < waited_s[1] < waited_s[0] <= 0.001

    def wait_in_vain(timeout_s: float) -> bool:
        system.sleep_s(timeout_s)
        return False

    clock.doze_until_woken(begun_ns + 1_000_000, wait_in_vain)
    assert system.t_ns >= begun_ns + 1_000_000


def test_a_deadline_that_has_passed_returns_at_once() -> None:
    system = System(100, 0)
    LinuxClock(system.monotonic_ns, system.sleep_s).sleep_until_ns(system.t_ns - 1)
    assert system.slept_until_ns == []


def test_the_real_clock_rises() -> None:
    clock = LinuxClock()
    before_ns = clock.now_ns()
    clock.sleep_until_ns(before_ns + 2_000)
    assert clock.now_ns() >= before_ns + 2_000


def test_the_clock_needs_none_of_the_hardware_packages() -> None:
    program = (
        "import sys; import etd_hal.linux.clock;"
        "print([m for m in ('gpiod', 'spidev', 'smbus2') if m in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=_path()
    )
    assert found.stdout.strip() == "[]"


def _path() -> dict[str, str]:
    return {"PYTHONPATH": ":".join(filter(None, sys.path))}
