"""Frames in the engine: how long they are felt, and which are not taken."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import EngineRig
from engine_scenes import MS, armed, felt_ua, fully_open, only, phases, shown
from etd.protocol.frame import Frame
from etd.protocol.link import Alive, ArmBoard, KeepLease, NewFrame
from trace_decoder import visits

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
#: Every electrode at 1 mA.
ALL = (1_000,) * N


def last_pulse_ns(rig: EngineRig) -> int:
    return max(phase.to_ns for phase in phases(rig))


def test_a_frame_becomes_its_currents_on_its_electrodes(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 2_000)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=700, e9=1_500), width_us=80, pulses=3)
    rig.run_ms(100)
    found = list(visits(phases(rig, since_ns)))
    assert [visit[0].electrode for visit in found] == [3, 9, 3, 9, 3, 9]
    for (phase,) in found:
        assert phase.is_anodic
        asked_ua = {3: 700, 9: 1_500}[phase.electrode or 0]
        assert asked_ua - 10_000 / 4_095 < phase.current_ua <= asked_ua
        assert 79 < phase.width_us <= 80


@pytest.mark.parametrize("ttl_ms", [1, 37, 200, 1_000])
def test_a_frame_past_its_time_is_silent_within_one_pulse(make_rig: MakeRig, ttl_ms: int) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    sent_ns = rig.clock.now_ns()
    rig.show(current_ua=ALL, rate_hz=100.0, ttl_ms=ttl_ms)
    rig.run_ms(ttl_ms + 100)
    fired = [phase for phase in phases(rig, sent_ns) if phase.current_ua > 900]
    assert fired
    expires_ns = sent_ns + ttl_ms * MS
    assert max(phase.from_ns for phase in fired) < expires_ns + MS


def test_no_pulse_begins_once_its_frame_s_time_is_over(make_rig: MakeRig) -> None:
    """Wherever in a scan that is, also in the rest before a pulse: it is asked once more when all
    is connected, 20 us before the current flows.
    """
    rig = fully_open(make_rig(electrodes=N), 500)
    ends_within_us = 500
    fired = 0
    for early_us in range(0, ends_within_us, 20):
        sent_ns = rig.clock.now_ns() - early_us * 1_000
        rig.show(current_ua=(500,) * N, rate_hz=100.0, ttl_ms=12, sent_ns=sent_ns)
        rig.run_ms(60)
        begun_ns = [phase.from_ns for phase in phases(rig, sent_ns)]
        assert max(begun_ns) < sent_ns + 12 * MS + 20_000
        fired += len(begun_ns)
    assert fired > N * ends_within_us // 20


def test_the_age_of_a_frame_counts_from_sent_ns(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    sent_ns = rig.clock.now_ns() - 150 * MS
    rig.show(current_ua=ALL, rate_hz=100.0, ttl_ms=200, sent_ns=sent_ns)
    rig.run_ms(200)
    assert last_pulse_ns(rig) < sent_ns + 201 * MS


def test_a_frame_that_comes_too_late_is_refused_as_expired(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    since_ns = rig.clock.now_ns()
    answer = rig.show(current_ua=ALL, ttl_ms=200, sent_ns=since_ns - 201 * MS)
    assert answer.error == "expired"
    assert "201 ms" in answer.reason or "202 ms" in answer.reason
    assert "200 ms" in answer.reason
    rig.run_ms(50)
    assert {*felt_ua(rig, since_ns)} <= {0}


@pytest.mark.parametrize(("ahead_ms", "error"), [(90, None), (102, "bad_frame")])
def test_a_sent_ns_ahead_of_the_clock_gains_nothing_or_is_refused(
    make_rig: MakeRig, ahead_ms: int, error: str | None
) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.run_ms(250)
    now_ns = rig.clock.now_ns()
    answer = rig.show(current_ua=ALL, rate_hz=100.0, ttl_ms=50, sent_ns=now_ns + ahead_ms * MS)
    assert answer.error == error
    rig.run_ms(150)
    assert last_pulse_ns(rig) < now_ns + 60 * MS


def test_seq_must_rise_within_a_lease(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    assert rig.show(seq=50, current_ua=ALL).error is None
    assert rig.show(seq=50, current_ua=ALL).error == "old_seq"
    assert rig.show(seq=49, current_ua=ALL).error == "old_seq"
    assert rig.show(seq=51, current_ua=ALL).error is None


def test_a_refused_frame_does_not_use_its_seq(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    assert rig.show(seq=50, current_ua=(9_000,) * N).error == "over_maximum"
    assert rig.show(seq=50, level=(0.5,) * N).error == "level_needs_calibration"
    assert rig.show(seq=50, current_ua=ALL).error is None


def test_a_refused_frame_leaves_the_one_that_stands(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=only(N, e3=900), ttl_ms=500)
    rig.run_ms(50)
    since_ns = rig.clock.now_ns()
    assert rig.show(current_ua=(9_000,) * N).error == "over_maximum"
    rig.run_ms(100)
    assert {*felt_ua(rig, since_ns)} == {3}


@pytest.mark.parametrize("state", ["SAFE", "PROBE"])
def test_frames_are_taken_in_armed_only(make_rig: MakeRig, state: str) -> None:
    rig = make_rig("reference-hv507")
    rig.open()
    if state == "PROBE":
        rig.try_wearer_stop()
        rig.commands.send(ArmBoard(ref=rig.next_ref()))
        rig.run_ms(5)
    assert rig.state == state
    answer = rig.show(current_ua=(500,) * 64, rate_hz=10.0)
    assert answer.error == "not_armed"
    assert phases(rig) == []


def test_that_many_pulses_each_and_then_silence(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    since_ns = rig.clock.now_ns()
    rates = (50.0,) * 8 + (25.0,) * 8
    rig.show(current_ua=ALL, rate_hz=rates, pulses=4, ttl_ms=1_000)
    rig.run_ms(400)
    fired = [phase.electrode for phase in phases(rig, since_ns)]
    assert {electrode: fired.count(electrode) for electrode in range(N)} == dict.fromkeys(
        range(N), 4
    )
    assert rig.engine.components.active.schedule is None


def test_a_new_frame_takes_the_place_of_the_one_that_stands(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=only(N, e3=900), ttl_ms=1_000)
    rig.run_ms(40)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e5=900), ttl_ms=1_000)
    rig.run_ms(60)
    assert {*felt_ua(rig, since_ns)} == {5}


def test_a_new_frame_is_shown_at_once_when_idle(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.run_ms(300)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=900))
    rig.run_ms(10)
    assert phases(rig, since_ns)[0].from_ns - since_ns < 2 * MS


def test_a_silent_frame_is_shown_without_a_pulse(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=(0,) * N, ttl_ms=100, tag=77)
    rig.run_ms(200)
    assert phases(rig, since_ns) == []
    mine = [frame for frame in shown(rig) if frame.tag == 77]
    assert mine[-1].ended
    assert mine[-1].first_ns is None


# --- after a stall --------------------------------------------------------------------------------


def stall(rig: EngineRig, duration_ms: int, **frame: object) -> None:
    """Engine and stopper do not run for a while, and the gateway goes on sending."""
    for _ in range(duration_ms // 50):
        rig.commands.send(Alive())
        rig.stand_still_ms(50)
    rig.commands.send(Alive())


def test_a_frame_that_stood_before_a_stall_is_not_shown_after_it(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=ALL, ttl_ms=200)
    rig.run_ms(20)
    stall(rig, 300)
    since_ns = rig.clock.now_ns()
    rig.run_ms(100)
    assert phases(rig, since_ns) == []
    assert rig.state == "ARMED"


def test_a_lease_that_lapsed_in_a_stall_is_not_kept_by_what_lies_in_the_queue(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.commands.send(KeepLease(ref=0, lease="a-lease"))
    ref = rig.send(current_ua=ALL, ttl_ms=1_000)
    stall(rig, 1_200)
    rig.commands.send(KeepLease(ref=0, lease="a-lease"))
    since_ns = rig.clock.now_ns()
    assert rig.wait_for(ref).error == "no_lease"
    rig.run_ms(50)
    assert phases(rig, since_ns) == []
    assert rig.state == "SAFE"
    assert rig.engine.supervisor.lease is None


def test_a_frame_without_a_time_that_lay_in_the_queue_through_a_stall_is_not_shown(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.ask(KeepLease, lease="a-lease")
    rig.run_ms(250)
    ref = rig.send(current_ua=ALL, ttl_ms=200)
    stall(rig, 500)
    since_ns = rig.clock.now_ns()
    assert rig.wait_for(ref).error == "expired"
    rig.run_ms(50)
    assert phases(rig, since_ns) == []


def test_a_frame_with_a_long_time_survives_a_short_stall(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    ref = rig.send(current_ua=ALL, ttl_ms=1_000)
    stall(rig, 400)
    assert rig.wait_for(ref).error is None


def test_a_flood_of_frames_leaves_the_latest_standing(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    for seq in range(1_000, 1_060):
        frame = Frame(lease="a-lease", seq=seq, current_ua=only(N, e3=500), ttl_ms=500)
        rig.frames.send(NewFrame(ref=0, frame=frame))
    rig.run_ms(300)
    assert shown(rig)[-1].seq == 1_059
