"""The heartbeat within its window, and the loop never too busy."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import MS, armed, config, fully_open, halts, longest_gap_ns, moves, shortfalls
from etd.protocol.link import ArmBoard, DisarmBoard, StopNow
from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate
from etd_hal.backend import Backend
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.faults import SpiStall
from etd_hal.ports import Wait

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
REFERENCE = "reference-hv507"
WINDOW_NS = 20 * MS
ALL = (500,) * 64


def edges_ns(rig: EngineRig, since_ns: int = 0) -> list[int]:
    return [t_ns for t_ns, _ in moves(rig, "HEARTBEAT", since_ns)]


def supplied_from_ns(rig: EngineRig) -> int:
    return next(t_ns for t_ns, value in moves(rig, "HV") if value == 1)


def test_there_is_an_edge_in_every_window_from_the_supply_on(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(REFERENCE), 500)
    rig.hold(500, current_ua=ALL, rate_hz=30.0)
    rig.run_ms(300)
    assert longest_gap_ns(rig, supplied_from_ns(rig), rig.clock.now_ns()) <= WINDOW_NS // 2


def test_each_beat_is_an_edge(make_rig: MakeRig) -> None:
    rig = armed(make_rig(REFERENCE))
    rig.run_ms(200)
    levels = [value for _, value in moves(rig, "HEARTBEAT", supplied_from_ns(rig))]
    assert all(electrode != other for electrode, other in pairwise(levels))


def test_in_safe_and_in_halted_nothing_beats(make_rig: MakeRig) -> None:
    rig = make_rig(REFERENCE)
    rig.open()
    rig.run_ms(100)
    since_ns = rig.clock.now_ns()
    assert edges_ns(rig, 1_010 * MS) == []
    rig.arm()
    rig.ask(DisarmBoard, lease=LEASE)
    rig.run_ms(100)
    disarmed_ns = moves(rig, "HV")[-1][0]
    assert edges_ns(rig, since_ns)
    assert edges_ns(rig, disarmed_ns) == []
    assert rig.ask(ArmBoard).error is None
    rig.ask(StopNow, client="operator")
    rig.run_ms(100)
    halted_ns = halts(rig)[0].t_ns
    assert edges_ns(rig, halted_ns) == []


def test_a_loop_that_hangs_does_not_beat(make_rig: MakeRig) -> None:
    rig = armed(make_rig(REFERENCE))
    hung_ns = rig.clock.now_ns()
    rig.clock.spend(40 * MS)
    assert edges_ns(rig, hung_ns + MS) == []
    assert rig.fake.world.rail_v() > 0


def test_a_new_calibration_while_armed_does_not_miss_the_window(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(REFERENCE), 500)
    for message in range(1, 400):
        rig.fake.world.put_in(SpiStall(3, at_message=message))
    since_ns = rig.clock.now_ns()
    rig.hold(400, current_ua=ALL, rate_hz=30.0)
    assert rig.engine.components.reporter.counters["recalibrated"] >= 1
    assert longest_gap_ns(rig, since_ns, rig.clock.now_ns()) <= WINDOW_NS


# --- how busy -------------------------------------------------------------------------------------


@dataclass
class Sleeps:
    """A clock that keeps the times when its user was really asleep."""

    clock: SteppedClock
    asleep: list[tuple[int, int]] = field(default_factory=list)

    def now_ns(self) -> int:
        return self.clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        from_ns = self.clock.now_ns()
        self.clock.sleep_until_ns(deadline_ns)
        # At its end a sleep spins for 50 us.
        if self.clock.now_ns() - from_ns > 50_000:
            self.asleep.append((from_ns, self.clock.now_ns() - 50_000))

    def doze_until_ns(self, deadline_ns: int) -> None:
        from_ns = self.clock.now_ns()
        self.clock.doze_until_ns(deadline_ns)
        self.asleep.append((from_ns, self.clock.now_ns()))

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        from_ns = self.clock.now_ns()
        self.clock.doze_until_woken(deadline_ns, wait)
        self.asleep.append((from_ns, self.clock.now_ns()))

    def busy_part(self, from_ns: int, to_ns: int) -> float:
        slept_ns = sum(
            max(0, min(to_ns, until_ns) - max(from_ns, since_ns))
            for since_ns, until_ns in self.asleep
        )
        return 1.0 - slept_ns / (to_ns - from_ns)


@dataclass
class Thinks:
    """A stabilizer that asks for nothing, but takes its time."""

    us: int
    spend: Callable[[int], None] = lambda _: None

    max_gain = MaxGain()

    def reset(self) -> None:
        pass

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        self.spend(self.us * 1_000)
        return pulse_request


def busy_rig(
    make_rig: MakeRig, rest_us: int, think_us: int, board: str = REFERENCE
) -> tuple[EngineRig, Sleeps]:
    kept: list[Sleeps] = []

    def wrap(backend: Backend) -> Backend:
        assert isinstance(backend.clock, SteppedClock)
        kept.append(Sleeps(backend.clock))
        return dataclasses.replace(backend, clock=kept[0])

    thinks = Thinks(think_us)
    loaded = config(board, 64, rest_us=rest_us)
    rig = make_rig(loaded=loaded, wrap=wrap, stabilizers=[thinks])
    thinks.spend = rig.clock.spend
    return rig, kept[0]


def dense(rig: EngineRig) -> tuple[int, int]:
    """The densest plan there is, for nearly a second; from when to when."""
    since_ns = rig.clock.now_ns()
    assert rig.show(current_ua=ALL, rate_hz=100.0, allow_slower=True, ttl_ms=1_000).slowed
    rig.run_ms(950)
    return since_ns, rig.clock.now_ns()


@pytest.mark.parametrize("rest_us", [50, 200])
def test_the_densest_plan_leaves_a_fifth_of_every_100_ms(make_rig: MakeRig, rest_us: int) -> None:
    rig, sleeps = busy_rig(make_rig, rest_us, 0, "kajimoto-hv507")
    since_ns, until_ns = dense(fully_open(rig, 500))
    for from_ns in range(since_ns, until_ns - 100 * MS, 2 * MS):
        # The brake looks before each pulse: a pulse with its shift and two spun ends come on top.
        assert sleeps.busy_part(from_ns, from_ns + 100 * MS) < 0.81


@pytest.mark.parametrize("think_us", [80, 300])
def test_when_visits_take_longer_than_planned_the_scan_is_slowed_and_it_is_told(
    make_rig: MakeRig, think_us: int
) -> None:
    rig, sleeps = busy_rig(make_rig, 50, think_us, "kajimoto-hv507")
    since_ns, until_ns = dense(fully_open(rig, 500))
    assert sleeps.busy_part(since_ns, until_ns) < 0.82
    waking = [0, *(until for _, until in sleeps.asleep)]
    stretches = [asleep[0] - woke for asleep, woke in zip(sleeps.asleep, waking, strict=False)]
    assert max(stretches[1:]) < 81 * MS, "80 % of any 100 ms"
    assert (
        sum(shortfall.pulses for shortfall in shortfalls(rig) if shortfall.reason == "processor")
        >= 7
    )


def test_a_pause_is_told_and_the_heartbeat_goes_on_through_it(make_rig: MakeRig) -> None:
    rig, _ = busy_rig(make_rig, 50, 300)
    fully_open(rig, 500)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, rate_hz=100.0, allow_slower=True, ttl_ms=1_000)
    rig.run_ms(900)
    assert [shortfall for shortfall in shortfalls(rig) if shortfall.reason == "processor"]
    assert longest_gap_ns(rig, since_ns, rig.clock.now_ns()) <= WINDOW_NS // 2
    assert rig.state == "ARMED"


def test_a_stop_line_is_heard_in_a_pause(make_rig: MakeRig) -> None:
    rig, _ = busy_rig(make_rig, 50, 300)
    fully_open(rig, 500)
    rig.run_ms(250)
    rig.show(current_ua=ALL, rate_hz=100.0, allow_slower=True, ttl_ms=1_000)
    pressed_ns: list[int] = []

    def press(now_ns: int) -> None:
        if not pressed_ns and rig.engine.components.reporter.counters["not_fired_processor"]:
            pressed_ns.append(now_ns)

    for step in range(1, 200):
        at_ns = rig.clock.now_ns() + step * MS
        rig.clock.at(at_ns, lambda: press(rig.clock.now_ns()))
    rig.clock.at(rig.clock.now_ns() + 90 * MS, lambda: rig.fake.world.press("emergency_stop"))
    rig.run_ms(300)
    assert rig.state == "HALTED"
