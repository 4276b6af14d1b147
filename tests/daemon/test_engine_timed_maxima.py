"""What this machine can time now: no wider and no narrower pulse is planned, fired or promised."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import (
    calibration,
    config,
    fully_open,
    only,
    open_calibrated,
    phases,
    states,
)
from etd.protocol.link import ArmBoard, CloseLease, DisarmBoard, EngineHello, OpenLease
from etd.protocol.messages import Limits, RefusedReport
from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate
from etd_hal.fake.faults import SlowWords

MakeRig = Callable[..., EngineRig]
N = 16
#: The guard reckons with so slow a bus that pulses of 200 us do not pass.
DOUBTFUL = {"guard_word_us": 60.0, "guard_delay_extra_us": 3.0}
SLOW = SlowWords(5)
#: The widest there, with slow words and without: more delays have a longer worst case.
WIDE_US, LESS_WIDE_US = 133, 123


def refusals(rig: EngineRig) -> list[RefusedReport]:
    return [report.refused for report in rig.reports if report.refused is not None]


def recalibrated(rig: EngineRig, **frame: Any) -> int:
    """Words become faster while a frame is held, until that is noticed; the time then."""
    rig.fake.world.take_out(SLOW)
    before = rig.engine.components.reporter.counters["recalibrated"]
    for _ in range(60):
        rig.show(**{"current_ua": only(N, e3=400), "rate_hz": 60.0, **frame})
        for _ in range(20):
            rig.step()
            if rig.engine.components.reporter.counters["recalibrated"] > before:
                return rig.clock.now_ns()
    raise AssertionError("never calibrated again")


@pytest.fixture
def slow_rig(make_rig: MakeRig) -> EngineRig:
    rig = make_rig(loaded=config(machine=DOUBTFUL), faults=[SLOW])
    assert rig.engine.supervisor.maxima.width_us == WIDE_US
    return fully_open_at(rig, WIDE_US)


def fully_open_at(rig: EngineRig, width_us: int) -> EngineRig:
    rig.open(width_us=width_us)
    rig.arm()
    rig.hold(150, current_ua=only(N, e3=400), width_us=50, rate_hz=60.0)
    return rig


def test_a_frame_that_stands_and_is_too_wide_now_ends_and_is_told(slow_rig: EngineRig) -> None:
    rig = slow_rig
    rig.reports.clear()
    since_ns = recalibrated(rig, width_us=WIDE_US)
    rig.run_ms(100)
    assert rig.state == "ARMED"
    assert phases(rig, since_ns) == []
    (refusal,) = refusals(rig)
    assert (refusal.error, refusal.seq, refusal.electrode) == ("over_maximum", rig.last_seq, 3)
    assert f"{LESS_WIDE_US} us" in refusal.reason


def test_after_it_frames_are_planned_by_what_there_is_now(slow_rig: EngineRig) -> None:
    rig = slow_rig
    recalibrated(rig, width_us=WIDE_US)
    frame = {"current_ua": only(N, e3=400), "pulses": 1}
    assert rig.show(width_us=LESS_WIDE_US + 1, **frame).error == "over_maximum"
    since_ns = rig.clock.now_ns()
    assert rig.show(width_us=LESS_WIDE_US, **frame).error is None
    rig.run_ms(40)
    assert len(phases(rig, since_ns)) == 1
    assert rig.state == "ARMED"


def test_what_is_told_follows(slow_rig: EngineRig) -> None:
    rig = slow_rig
    recalibrated(rig, width_us=100)
    rig.run_ms(1_100)
    greetings = [message for message in rig.others if isinstance(message, EngineHello)]
    assert [greeting.maxima.width_us for greeting in greetings] == [WIDE_US, LESS_WIDE_US]
    told = " ".join(states(rig)[-1].not_granted)
    assert f"more than {LESS_WIDE_US} us" in told
    assert str(WIDE_US) not in told


def test_a_frame_that_still_fits_goes_on(slow_rig: EngineRig) -> None:
    rig = slow_rig
    since_ns = recalibrated(rig, width_us=LESS_WIDE_US, ttl_ms=500)
    rig.run_ms(100)
    assert len(phases(rig, since_ns)) >= 5
    assert refusals(rig) == []


class AlwaysWider:
    """A stabilizer that asks for twice the width."""

    max_gain = MaxGain(width=2.0, charge=2.0)

    def reset(self) -> None:
        """Nothing to forget."""

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return PulseRequest(pulse_request.current_ua, 2 * pulse_request.width_us)


def test_stabilizers_get_no_more_room_than_there_is_now(make_rig: MakeRig) -> None:
    loaded = config(machine=DOUBTFUL)
    rig = make_rig(loaded=loaded, faults=[SLOW], stabilizers=[AlwaysWider()])
    fully_open_at(rig, WIDE_US)
    since_ns = recalibrated(rig, width_us=80, ttl_ms=500)
    rig.run_ms(100)
    fired = phases(rig, since_ns)
    assert len(fired) >= 5
    assert max(phase.width_us for phase in fired) <= LESS_WIDE_US
    assert rig.state == "ARMED"
    assert refusals(rig) == []


def test_what_becomes_possible_again_is_allowed_again(make_rig: MakeRig) -> None:
    rig = make_rig(loaded=config(machine=DOUBTFUL))
    assert rig.engine.supervisor.maxima.width_us == LESS_WIDE_US
    fully_open_at(rig, LESS_WIDE_US)
    rig.fake.world.put_in(SLOW)
    rig.hold(500, current_ua=only(N, e3=400), width_us=100, rate_hz=60.0)
    assert rig.engine.components.reporter.counters["recalibrated"] >= 1
    assert rig.engine.supervisor.maxima.width_us == WIDE_US
    assert rig.state == "ARMED"


def test_probes_are_no_wider_than_what_there_is_now(make_rig: MakeRig) -> None:
    machine = {"guard_word_us": 95.0, "guard_delay_extra_us": 12.0}
    rig = make_rig(loaded=config(machine=machine), faults=[SLOW])
    assert rig.engine.supervisor.maxima.probe_width_us == 50
    fully_open_at(rig, 50)
    recalibrated(rig, width_us=30)
    assert (
        rig.engine.supervisor.maxima.width_us == rig.engine.supervisor.maxima.probe_width_us == 45
    )
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    since_ns = rig.clock.now_ns()
    assert rig.ask(ArmBoard).error is None
    assert len(phases(rig, since_ns)) == N
    assert max(phase.width_us for phase in phases(rig, since_ns)) <= 45


# --- one word of the bus --------------------------------------------------------------------------

#: One word takes 20.96 us.
SLOWER = SlowWords(6)


def test_a_pulse_shorter_than_a_word_is_refused_and_halts_nothing(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N, faults=[SLOWER]), 500)
    answer = rig.show(current_ua=only(N, e3=400), width_us=20)
    assert answer.error == "board_cannot"
    assert "21 us" in answer.reason
    assert any("less than 21 us" in text for text in states(rig)[-1].not_granted)
    assert rig.show(current_ua=only(N, e3=400), width_us=21).error is None
    rig.run_ms(50)
    assert rig.state == "ARMED"


def test_limits_and_calibrations_of_such_pulses_are_refused_at_open(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N, faults=[SLOWER])
    limits = Limits(max_current_ua=1_000, width_us=20)
    answer = rig.ask(OpenLease, lease=LEASE, client="test", limits=limits)
    assert answer.error == "board_cannot"
    assert open_calibrated(rig, calibration(rig, [2_000] * N, width_us=20)).error == "board_cannot"
    assert rig.state == "SAFE"
    assert open_calibrated(rig, calibration(rig, [2_000] * N, width_us=21)).error is None
    assert rig.ask(CloseLease, lease=LEASE).error is None


def test_a_frame_that_stands_and_is_too_short_now_ends_and_is_told(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.reports.clear()
    rig.fake.world.put_in(SLOWER)
    for _ in range(40):
        rig.show(current_ua=only(N, e3=400), width_us=20, rate_hz=100.0)
        rig.run_ms(10)
    assert rig.engine.components.reporter.counters["recalibrated"] == 1
    assert [refusal.error for refusal in refusals(rig)] == ["board_cannot"]
    assert rig.state == "ARMED"
