"""Small promises of the engine that no other file is about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from engine_rig import EngineRig
from engine_scenes import config, fully_open, only, phases
from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate

MakeRig = Callable[..., EngineRig]
N = 16


@dataclass
class Asks:
    """A stabilizer that always asks for the same."""

    request: PulseRequest

    max_gain = MaxGain()

    def reset(self) -> None:
        pass

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return self.request


@pytest.mark.parametrize(
    "pulse_request", [PulseRequest(-1, 100), PulseRequest(500, 0), PulseRequest(500, 19)]
)
def test_an_impossible_wish_is_counted_and_the_frames_own_pulse_is_given(
    make_rig: MakeRig, pulse_request: PulseRequest
) -> None:
    rig = fully_open(make_rig(electrodes=N, stabilizers=[Asks(pulse_request)]), 500)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=400), pulses=1)
    rig.run_ms(30)
    (fired,) = phases(rig, since_ns)
    assert fired.current_ua == pytest.approx(400, abs=2.5)
    assert rig.engine.components.reporter.counters["impossible_requests"] >= 1
    assert rig.state == "ARMED"


def test_a_wish_for_more_width_than_its_slot_is_cut_and_counted(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N, stabilizers=[Asks(PulseRequest(400, 200))]), 500)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=400), width_us=50, pulses=1)
    rig.run_ms(30)
    (fired,) = phases(rig, since_ns)
    assert fired.width_us <= 50.0
    assert rig.engine.components.reporter.counters["width_requests_cut"] >= 1


def test_probes_stay_within_the_limits_of_the_person(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.open(max_current_ua=50, width_us=20)
    since_ns = rig.clock.now_ns()
    rig.arm()
    fired = phases(rig, since_ns)
    assert len(fired) == N
    assert max(phase.current_ua for phase in fired) <= 50
    assert max(phase.width_us for phase in fired) <= 20


def test_a_stop_line_whose_edge_was_lost_is_seen_by_its_level(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig("reference-hv507"), 500)
    rig.show(current_ua=only(64, e3=400), ttl_ms=1_000)
    rig.run_ms(40)
    rig.fake.world.press("emergency_stop")
    rig.engine.components.board.stop_edges()
    rig.run_ms(40)
    assert rig.state == "HALTED"
    halt = rig.engine.supervisor.states.halt
    assert halt is not None
    assert (halt.cause, halt.detail) == ("emergency_stop", "the stop line is open")


def test_a_stop_line_whose_edge_was_lost_is_seen_without_a_frame(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig("reference-hv507"), 500)
    while rig.engine.components.active.schedule is not None:
        rig.run_ms(20)
    assert rig.state == "ARMED"
    rig.fake.world.press("emergency_stop")
    rig.engine.components.board.stop_edges()
    pressed_ns = rig.clock.now_ns()
    while rig.state == "ARMED":
        rig.step()
        assert rig.clock.now_ns() - pressed_ns < 10_000_000, "a check of the source in between"
    assert rig.state == "HALTED"


def test_a_frame_that_expires_while_relays_move_is_not_fired(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config("feetthrough-relay", N)), 500)
    rig.run_ms(250)
    since_ns = rig.clock.now_ns()
    answer = rig.show(current_ua=only(N, e3=400), rate_hz=10.0, ttl_ms=1)
    assert answer.error is None, answer.reason
    rig.run_ms(60)
    assert phases(rig, since_ns) == []


def test_an_accepted_frame_that_is_never_shown_is_told(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.show(current_ua=only(N, e3=400), rate_hz=5.0, ttl_ms=1_000)
    rig.run_ms(20)
    assert rig.show(current_ua=only(N, e3=400), rate_hz=5.0, ttl_ms=5).error is None
    rig.run_ms(60)
    (told,) = [report.refused for report in rig.reports if report.refused is not None]
    assert told.error == "expired"
    assert "5 ms" in told.reason


def test_what_the_guard_would_refuse_on_this_machine_is_refused_when_asked_for(
    make_rig: MakeRig,
) -> None:
    slow = {"guard_word_us": 60.0, "guard_delay_extra_us": 3.0}
    rig = make_rig(loaded=config(machine=slow))
    widest_us = rig.engine.supervisor.maxima.width_us
    assert 50 < widest_us < 200
    assert any(str(widest_us) in limitation for limitation in rig.engine.supervisor.limitations)
    rig.open(width_us=widest_us)
    rig.arm()
    rig.hold(130, current_ua=only(N, e0=20), rate_hz=20.0, width_us=50)
    refused = rig.show(current_ua=only(N, e3=400), width_us=widest_us + 1)
    assert refused.error == "over_maximum"
    since_ns = rig.clock.now_ns()
    assert rig.show(current_ua=only(N, e3=400), width_us=widest_us, pulses=1).error is None
    rig.run_ms(30)
    assert len(phases(rig, since_ns)) == 1
    assert rig.state == "ARMED"
