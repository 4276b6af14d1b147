"""A machine on which computing takes its time, up to ten times that of a PC: frames are slowed, and
the client is told; nothing else changes.
"""

from __future__ import annotations

import pytest

import engine_rig
from engine_rig import EngineRig
from engine_scenes import (
    MS,
    armed,
    ended_leases,
    felt_ua,
    halts,
    longest_gap_ns,
    opened_to,
    phases,
    shortfalls,
    states,
)
from etd.files.configuration import fake_config
from etd_hal.fake.machines import MACHINES, MachineModel
from etd_hal.fake.processor import STAGES_NS, StagedTime
from trace_rules import violations

SLOWNESS = [1.0, 4.0, 10.0]
ALL = (400,) * 64
WANTED = {"current_ua": ALL, "width_us": 100, "rate_hz": 120.0, "ttl_ms": 1_000}


def slow_rig(slowness: float, board: str = "kajimoto-hv507", electrodes: int = 64) -> EngineRig:
    rig = engine_rig.make(board, electrodes=electrodes, processor=StagedTime(slowness))
    armed(rig)
    opened_to(rig, 1_000)
    return rig


def mean_period_s(rig: EngineRig, since_ns: int) -> float:
    """Between two pulses of electrode 0."""
    begun_ns = [phase.from_ns for phase in phases(rig, since_ns) if phase.electrode == 0]
    return (begun_ns[-1] - begun_ns[0]) / (len(begun_ns) - 1) / 1e9


def pulse_us(slowness: float) -> float:
    return slowness * sum(STAGES_NS[stage] for stage in ("clear", "fire", "judge", "report")) / 1e3


@pytest.mark.parametrize("slowness", SLOWNESS)
def test_arming_measures_what_a_pulse_computes(slowness: float) -> None:
    rig = slow_rig(slowness)
    found_us = rig.engine.components.computing.pulse_us
    assert found_us == pytest.approx(pulse_us(slowness), rel=0.1, abs=2.0)
    assert rig.close() == ()


@pytest.mark.parametrize("slowness", SLOWNESS)
def test_a_frame_that_does_not_fit_is_slowed_to_what_the_machine_then_does(slowness: float) -> None:
    rig = slow_rig(slowness)
    refused = rig.show(**WANTED)
    assert refused.error == "too_fast"
    since_ns = rig.clock.now_ns()
    answer = rig.show(allow_slower=True, **WANTED)
    assert answer.rate_hz == pytest.approx(refused.achievable_hz, rel=0.02)
    rig.run_ms(950)
    assert answer.rate_hz is not None
    # Each pause of a scan puts off the next one, so that no electrode's interval becomes shorter.
    most = 0.05 if slowness < 10.0 else 0.15
    assert mean_period_s(rig, since_ns) == pytest.approx(1 / answer.rate_hz, rel=most)
    assert rig.close() == ()


def test_the_slower_the_machine_the_lower_the_rate() -> None:
    found_hz = []
    for slowness in (0.0, *SLOWNESS):
        rig = slow_rig(slowness)
        found_hz.append(rig.show(**WANTED).achievable_hz or 0.0)
        rig.close()
    assert found_hz == sorted(found_hz, reverse=True)
    assert found_hz[0] > 1.2 * found_hz[2] > 1.4 * found_hz[3]


@pytest.mark.parametrize(
    ("slowness", "bound_by"), [(0.0, "rest"), (4.0, "rest"), (10.0, "processor")]
)
def test_the_reply_says_which_part_binds(slowness: float, bound_by: str) -> None:
    rig = slow_rig(slowness)
    refused = rig.show(**WANTED)
    assert refused.bound_by == bound_by
    assert "the processor" in refused.reason
    slowed = rig.show(allow_slower=True, **WANTED).slowed
    assert [(each.reason, each.bound_by) for each in slowed] == [("rate", bound_by)]
    assert rig.close() == ()


@pytest.mark.parametrize("board", ["kajimoto-hv507", "reference-hv507", "feetthrough-relay"])
@pytest.mark.parametrize("slowness", SLOWNESS)
def test_nothing_halts_lapses_or_drifts(board: str, slowness: float) -> None:
    count = 32 if board == "feetthrough-relay" else 64
    rig = slow_rig(slowness, board, count)
    since_ns = rig.clock.now_ns()
    for _ in range(8):
        wanted = {**WANTED, "current_ua": (400,) * count, "allow_slower": True}
        assert rig.show(**wanted).error is None
        rig.run_ms(200)
    assert rig.state == "ARMED"
    assert (halts(rig), ended_leases(rig)) == ([], [])
    counters = rig.engine.components.reporter.counters
    assert (counters["recalibrated"], counters["frames_refused"]) == (0, 0)
    assert set(felt_ua(rig, since_ns)) == set(range(count))
    loaded = rig.engine.components.loaded
    if loaded.board.guards.heartbeat != "absent":
        window_ns = loaded.board.guards.heartbeat.window_ms * MS
        assert longest_gap_ns(rig, since_ns, rig.clock.now_ns()) < window_ns
    assert rig.close() == ()
    assert violations(rig.trace(), loaded.board.rest_us) == []


@pytest.mark.parametrize("slowness", SLOWNESS)
def test_no_100_ms_are_busier_than_the_kernel_allows(slowness: float) -> None:
    rig = slow_rig(slowness)
    since_ns = rig.clock.now_ns()
    rig.show(allow_slower=True, **WANTED)
    rig.run_ms(900)
    busy = [state.busy_percent for state in states(rig) if state.now_ns > since_ns]
    assert max(busy, default=0.0) <= 81.0
    assert rig.close() == ()


def test_what_slows_down_while_it_runs_is_told_as_a_new_largest_rate() -> None:
    processor = StagedTime(1.0)
    rig = engine_rig.make("kajimoto-hv507", electrodes=64, processor=processor)
    armed(rig)
    opened_to(rig, 1_000)
    answer = rig.show(allow_slower=True, **WANTED)
    assert answer.rate_hz is not None
    processor.slowness = 6.0
    for _ in range(6):
        rig.show(**{**WANTED, "rate_hz": answer.rate_hz}, allow_slower=True)
        rig.run_ms(300)
    told = [each for each in shortfalls(rig) if each.reason == "rate"]
    assert told, "nothing was told"
    assert told[0].bound_by == "processor"
    assert told[0].rate_hz is not None
    assert told[0].rate_hz < 0.9 * answer.rate_hz
    since_ns = rig.clock.now_ns()
    slowed = rig.show(allow_slower=True, **WANTED)
    rig.run_ms(700)
    assert slowed.rate_hz is not None
    assert mean_period_s(rig, since_ns) < 1.1 / slowed.rate_hz
    assert rig.close() == ()


def test_a_frame_without_work_in_it_lapses_at_its_time_on_the_slowest_machine() -> None:
    rig = slow_rig(10.0)
    begun_ns = rig.clock.now_ns()
    rig.show(**{**WANTED, "rate_hz": 10.0, "ttl_ms": 300})
    rig.run_ms(500)
    last_ns = max(phase.to_ns for phase in phases(rig, begun_ns))
    assert last_ns - begun_ns < 301 * MS
    assert rig.close() == ()


@pytest.mark.parametrize("name", sorted(MACHINES))
def test_each_modelled_machine_is_armed_within_its_own_bounds(name: str) -> None:
    model: MachineModel = MACHINES[name]
    loaded = fake_config(board="kajimoto-hv507", electrodes=64, machine=name)
    rig = engine_rig.make(loaded=loaded, processor=StagedTime(model.slowness), machine=model)
    rig.open(width_us=150)
    rig.arm()
    opened_to(rig, 1_000)
    assert rig.show(allow_slower=True, **WANTED).error is None
    rig.run_ms(500)
    assert rig.state == "ARMED"
    assert rig.close() == ()
