"""Clocks that follow the load of the machine: SPI is divided from one of them."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bench import clock_steps
from engine_rig import EngineRig
from engine_scenes import fully_open, halts, only
from etd.protocol.link import StopNow
from etd_hal.fake.faults import ClockSteps, SpiJitter, SpiStall

MakeRig = Callable[..., EngineRig]
N = 16
ALL = (1_000,) * N


@pytest.mark.parametrize("factor", clock_steps.FACTORS)
@pytest.mark.parametrize("every_ms", clock_steps.EVERY_MS)
def test_nothing_halts_and_nine_pulses_in_ten_are_fired(factor: float, every_ms: int) -> None:
    found = clock_steps.measure(factor, every_ms, runs_s=2.0)
    assert found.state == "ARMED"
    assert found.fired_percent >= 90.0
    # A speed is calibrated once, and recognized from then on.
    assert found.recalibrated <= 5
    assert found.recognized >= 5


def test_an_engine_starts_beside_clocks_that_change() -> None:
    found = clock_steps.measure(2.5, 8, runs_s=0.5, are_at_start=True)
    assert found.state == "ARMED"
    # None, or one where the speed changes within what was calibrated: by when it begins.
    assert found.recalibrated <= 1
    assert found.fired_percent >= 90.0


def test_what_flows_longer_than_planned_is_charged_and_the_plan_follows_the_clock(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.fake.world.put_in(ClockSteps(2.5, 500))
    since_ns = rig.clock.now_ns()
    rig.hold(3_000, current_ua=ALL, width_us=100, rate_hz=30.0)
    pulses = [pulse for pulse in rig.body() if pulse["from_ns"] >= since_ns]
    too_wide = [one for one in pulses if one["to_ns"] - one["from_ns"] > 100_000]
    # One scan at each of the three steps to the slow speed, of some ninety scans.
    assert 0 < len(too_wide) <= 4 * N
    ledger, now_ns = rig.engine.components.ledger, rig.clock.now_ns()
    flowed_pc = [
        sum(
            (one["to_ns"] - one["from_ns"]) * one["asked_ua"] // 1_000
            for one in pulses
            if one["electrode"] == electrode and one["from_ns"] > now_ns - 1_000_000_000
        )
        for electrode in range(N)
    ]
    assert all(ledger.charge_pc(each, now_ns) >= flowed_pc[each] for each in range(N))


def test_clocks_that_change_are_told_with_what_to_do(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    assert not any("clocks" in told for told in rig.engine.supervisor.limitations)
    rig.fake.world.put_in(ClockSteps(1.3, 100))
    rig.hold(1_000, current_ua=ALL, rate_hz=30.0)
    assert rig.engine.components.reporter.counters["clock_steps"] > 0
    (told,) = rig.engine.supervisor.limitations
    assert "force_turbo, or the performance governor" in told


def test_a_calibration_that_fails_while_pulses_are_due_is_tried_again_after_a_pause(
    make_rig: MakeRig,
) -> None:
    """The heartbeat goes on, the frame stands, and nothing is fired meanwhile."""
    rig = fully_open(make_rig("reference-hv507", electrodes=N), 1_000)
    noise = SpiJitter(3, 20)
    rig.fake.world.put_in(noise)
    for message in range(1, 3_000):
        rig.fake.world.put_in(SpiStall(3, at_message=message))
    counters = rig.engine.components.reporter.counters
    while not counters["calibration_attempts_failed"]:
        rig.hold(60, current_ua=ALL, rate_hz=50.0)
    failed_ns, fired = rig.clock.now_ns(), counters["pulses"]
    rig.fake.world.take_out(noise)
    rig.hold(900, current_ua=ALL, rate_hz=50.0)
    assert counters["pulses"] == fired
    assert counters["not_fired_timing"] == 1
    rig.hold(600, current_ua=ALL, rate_hz=50.0)
    assert counters["pulses"] > fired
    assert (rig.state, counters["recalibrated"]) == ("ARMED", 1)
    assert rig.clock.now_ns() - failed_ns > 1_000_000_000


def test_a_calibration_that_fails_three_times_halts(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.fake.world.put_in(SpiJitter(3, 20))
    for _ in range(80):
        if rig.state == "HALTED":
            break
        rig.send(current_ua=ALL, rate_hz=50.0)
        rig.run_ms(60)
    (halt,) = halts(rig)
    assert "spread of a message" in halt.detail
    assert rig.engine.components.reporter.counters["calibration_attempts_failed"] == 3


def beside_one_step(make_rig: MakeRig, stop_ns: int | None) -> EngineRig:
    """A quarter of a second in which the clocks become slower once, and the engine is stopped."""
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.fake.world.put_in(ClockSteps(2.5, 1_000))
    if stop_ns is not None:
        stop = StopNow(ref=0, client="operator")
        rig.clock.at(stop_ns, lambda: rig.commands.send(stop))
    for _ in range(20):
        rig.send(current_ua=only(N, e3=1_000), rate_hz=50.0)
        rig.run_ms(60)
    return rig


def test_a_stop_within_a_calibration_is_heard_within_two_milliseconds(make_rig: MakeRig) -> None:
    rig = beside_one_step(make_rig, None)
    begun_ns = rig.engine.components.clock.now_ns() - 1_200_000_000
    # No pulse has so many transfers.
    long = [one["t_ns"] for one in rig.records if one.get("transfers") == 42]
    stop_ns = next(t_ns for t_ns in long if t_ns > begun_ns) + 4_000_000
    (halt,) = halts(beside_one_step(make_rig, stop_ns))
    assert (halt.cause, halt.source) == ("stop", "operator")
    assert 0 < halt.t_ns - stop_ns < 2_000_000
    assert stop_ns < max(long)
