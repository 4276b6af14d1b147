"""What is asked is what is fired over a person's session, or the reply of that frame says so."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings

from engine_rig import LEASE, EngineRig
from engine_scenes import MS, felt_ua, only, phases, scans
from etd.protocol.link import Answer, ArmBoard, ClearHalt, DisarmBoard, StopNow
from etd_body.electrode import skin
from person_scripts import CAP_UA, STEP_UA, Frames, N, armed_for, check_script, scripts

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]


def test_twenty_trials_with_pauses_fire_what_was_asked(make_rig: MakeRig) -> None:
    """The lease lapses in each pause, and is opened and armed anew."""
    rig = armed_for(make_rig(electrodes=N))
    frames = Frames(rig)
    frames.open_to(2_500)
    for trial in range(20):
        rig.run_ms(1_500)
        assert rig.engine.supervisor.lease is None
        armed_for(rig)
        since_ns, number = rig.clock.now_ns(), len(frames.told)
        wanted_ua = 500 + 100 * trial
        frames.show(only(N, e3=wanted_ua), 0.2)
        assert not any(clamped for _, _, clamped in frames.told[number:])
        trial_ua = [phase.current_ua for phase in phases(rig, since_ns)]
        assert len(trial_ua) >= 10
        assert all(wanted_ua - STEP_UA <= fired_ua <= wanted_ua for fired_ua in trial_ua)
    frames.check()


def test_a_frame_that_the_soft_start_cuts_is_told_so_and_when_it_will_not_be(
    make_rig: MakeRig,
) -> None:
    rig = armed_for(make_rig(electrodes=N))
    asked = {"current_ua": only(N, e3=2_000), "rate_hz": 50.0}
    since_ns = rig.clock.now_ns()
    (clamp,) = rig.show(**asked).clamped
    assert (clamp.electrode, clamp.wanted_ua, clamp.allowed_ua) == (3, 2_000, 0)
    assert clamp.reason == "soft_start"
    rig.hold(1_000, **asked)
    whole_ns = next(
        phase.from_ns for phase in phases(rig, since_ns) if phase.current_ua > 2_000 - STEP_UA
    )
    assert clamp.ends_in_ms == pytest.approx((whole_ns - since_ns) / MS, abs=30)
    assert not rig.show(**asked).clamped


def test_strict_refuses_what_the_soft_start_would_cut_and_nothing_is_fired(
    make_rig: MakeRig,
) -> None:
    rig = armed_for(make_rig(electrodes=N))
    since_ns = rig.clock.now_ns()
    answer = rig.show(current_ua=only(N, e3=2_000), strict=True)
    assert answer.error == "over_limit"
    assert "soft_start" in answer.reason
    assert "open_to" in answer.reason
    rig.run_ms(100)
    assert not phases(rig, since_ns)


# --- what ends it ---------------------------------------------------------------------------------


def close_lease(rig: EngineRig) -> None:
    armed_for(rig)


def pause(seconds: float) -> Callable[[EngineRig], None]:
    def paused(rig: EngineRig) -> None:
        rig.run_ms(1_000 * seconds)
        armed_for(rig)

    return paused


@pytest.mark.parametrize("interlude", [close_lease, pause(50)])
def test_a_lease_or_a_pause_of_less_than_a_minute_ends_no_opening(
    make_rig: MakeRig, interlude: Callable[[EngineRig], None]
) -> None:
    rig = armed_for(make_rig(electrodes=N))
    Frames(rig).open_to(2_000)
    interlude(rig)
    since_ns = rig.clock.now_ns()
    assert not rig.show(current_ua=only(N, e5=2_000), rate_hz=60.0).clamped
    rig.run_ms(50)
    assert felt_ua(rig, since_ns)[5] > 2_000 - STEP_UA


def disarm(rig: EngineRig) -> None:
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    assert rig.ask(ArmBoard).error is None


def stop(rig: EngineRig) -> None:
    rig.ask(StopNow, client="operator")
    rig.ask(ClearHalt)
    armed_for(rig)


def other_person(rig: EngineRig) -> None:
    armed_for(rig, "P02")


def let_go(rig: EngineRig) -> None:
    for electrode in range(N):
        rig.fake.world.lift(electrode)
    rig.hold(100, current_ua=(500,) * N, rate_hz=50.0)
    for electrode in range(N):
        rig.fake.world.touch(electrode, skin())


def let_go_in_a_pause(rig: EngineRig) -> None:
    for electrode in range(N):
        rig.fake.world.lift(electrode)
    rig.run_ms(1_500)
    armed_for(rig)
    for electrode in range(N):
        rig.fake.world.touch(electrode, skin())


@pytest.mark.parametrize(
    "interlude", [disarm, stop, other_person, let_go, let_go_in_a_pause, pause(61)]
)
def test_what_may_bring_another_hand_begins_the_opening_anew_and_is_told(
    make_rig: MakeRig, interlude: Callable[[EngineRig], None]
) -> None:
    rig = armed_for(make_rig(electrodes=N))
    Frames(rig).open_to(2_000)
    interlude(rig)
    since_ns = rig.clock.now_ns()
    (clamp,) = rig.show(current_ua=only(N, e3=2_000), rate_hz=60.0).clamped
    assert clamp.allowed_ua <= 300
    rig.run_ms(90)
    assert max(felt_ua(rig, since_ns).values()) <= 500
    # Not of this electrode alone, which was perhaps open: of all, and open ones get 300 uA.
    assert scans(rig)[-1].ceiling_ua <= 300 + 500


def test_an_electrode_that_was_open_before_a_pause_rises_by_itself_after_it(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(electrodes=N)
    rig.fake.world.lift(5)
    armed_for(rig)
    Frames(rig).open_to(2_000)
    rig.run_ms(1_500)
    rig.fake.world.touch(5, skin())
    armed_for(rig)
    since_ns, wanted_ua = rig.clock.now_ns(), only(N, e3=2_000, e5=2_000)
    (clamp,) = rig.show(current_ua=wanted_ua, rate_hz=60.0).clamped
    assert (clamp.electrode, clamp.reason) == (5, "recontact")
    rig.run_ms(90)
    felt = felt_ua(rig, since_ns)
    assert felt[3] > 2_000 - STEP_UA
    assert felt[5] <= 500


# --- any script: a few here, more in tests/models -----------------------------------------------


@settings(deadline=None, max_examples=5, suppress_health_check=[HealthCheck.too_slow])
@given(script=scripts)
def test_the_replies_of_a_script_tell_what_its_pulses_are(
    script: list[tuple[float, list[int], float, float]],
) -> None:
    check_script(script)


def test_the_answer_has_no_time_where_a_clamp_does_not_pass(make_rig: MakeRig) -> None:
    rig = armed_for(make_rig(electrodes=N))
    answer: Answer = rig.show(current_ua=only(N, e3=CAP_UA + 500), rate_hz=60.0)
    (clamp,) = answer.clamped
    assert clamp.reason == "soft_start"
    Frames(rig).open_to(CAP_UA)
    (clamp,) = rig.show(current_ua=only(N, e3=CAP_UA + 500), rate_hz=60.0).clamped
    assert (clamp.reason, clamp.allowed_ua, clamp.ends_in_ms) == ("cap", CAP_UA, None)
