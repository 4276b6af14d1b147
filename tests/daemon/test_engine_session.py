"""The wearer's stop is tried once a session of a person, by the engine and its lines."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import calibration, moves, open_calibrated, states
from etd.protocol.calibration import Calibration
from etd.protocol.link import (
    Answer,
    ArmBoard,
    ClearHalt,
    CloseLease,
    DisarmBoard,
    MeasureContact,
    StopNow,
)
from etd.protocol.messages import SessionFacts

MakeRig = Callable[..., EngineRig]
REFERENCE = "reference-hv507"
N = 64
MINUTE_NS = 60_000_000_000


@pytest.fixture
def rig(make_rig: MakeRig) -> EngineRig:
    return make_rig(REFERENCE)


def of(rig: EngineRig, participant: str) -> Calibration:
    return calibration(rig, [2_000] * N, participant=participant)


def opened_for(rig: EngineRig, participant: str | None) -> None:
    """A lease with that person's calibration, or with limits alone."""
    if participant is None:
        rig.open()
    else:
        assert open_calibrated(rig, of(rig, participant)).error is None


def session_of(rig: EngineRig, participant: str | None) -> EngineRig:
    """Tried, armed, and closed again."""
    opened_for(rig, participant)
    rig.arm()
    assert rig.ask(CloseLease, lease=LEASE).error is None
    return rig


def armed_without_a_try(rig: EngineRig, participant: str | None) -> Answer:
    opened_for(rig, participant)
    return rig.ask(ArmBoard)


def test_the_same_person_is_not_asked_again(rig: EngineRig) -> None:
    session_of(rig, "P01")
    assert armed_without_a_try(rig, "P01").error is None


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("P01", "P02", "another person or calibration than the session of P01"),
        ("P01", None, "the session of P01"),
        (None, "P01", "another person or calibration than the session of a lease without"),
        (None, None, "no calibration"),
    ],
)
def test_whoever_may_be_another_person_tries_the_stop_first(
    rig: EngineRig, before: str | None, after: str | None, said: str
) -> None:
    session_of(rig, before)
    since_ns = rig.clock.now_ns()
    answer = armed_without_a_try(rig, after)
    assert answer.error == "arm_failed"
    assert "press and release it once" in answer.reason
    assert said in answer.reason
    assert 1 not in [value for _, value in moves(rig, "HV", since_ns)]
    rig.try_wearer_stop()
    assert rig.ask(ArmBoard).error is None


def test_a_try_after_the_refusal_counts_for_the_next_lease(rig: EngineRig) -> None:
    """A command that was refused is simply given again."""
    session_of(rig, None)
    assert armed_without_a_try(rig, None).error == "arm_failed"
    assert rig.ask(CloseLease, lease=LEASE).error is None
    rig.try_wearer_stop()
    assert armed_without_a_try(rig, None).error is None


def test_within_one_lease_it_is_tried_once(rig: EngineRig) -> None:
    rig.open()
    rig.arm()
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    assert rig.ask(ArmBoard).error is None


def test_a_measurement_begins_a_session_too(rig: EngineRig) -> None:
    assert open_calibrated(rig, of(rig, "P01")).error is None
    assert rig.ask(MeasureContact, lease=LEASE).error == "arm_failed"
    rig.try_wearer_stop()
    assert rig.ask(MeasureContact, lease=LEASE).error is None
    assert rig.ask(ArmBoard).error is None


def test_a_press_that_stopped_something_is_no_try_for_the_next_person(rig: EngineRig) -> None:
    opened_for(rig, "P01")
    rig.arm()
    rig.try_wearer_stop()
    assert rig.state == "HALTED"
    assert rig.ask(ClearHalt).error is None
    assert armed_without_a_try(rig, "P02").error == "arm_failed"


def test_after_the_wearers_stop_the_wearer_says_that_it_goes_on(rig: EngineRig) -> None:
    """For the same person too; what is pressed while it is halted says that it shall not."""
    opened_for(rig, "P01")
    rig.arm()
    rig.try_wearer_stop()
    rig.try_wearer_stop()
    assert rig.state == "HALTED"
    assert rig.ask(ClearHalt).error is None
    answer = armed_without_a_try(rig, "P01")
    assert answer.error == "arm_failed"
    assert "wearer_stop ended the session of P01" in answer.reason
    rig.try_wearer_stop()
    assert rig.ask(ArmBoard).error is None


def test_a_try_in_a_halt_that_no_stop_line_made_counts(rig: EngineRig) -> None:
    opened_for(rig, "P01")
    rig.ask(StopNow, client="operator")
    rig.try_wearer_stop()
    assert rig.ask(ClearHalt).error is None
    assert armed_without_a_try(rig, "P01").error is None


def test_an_emergency_stop_ends_the_session_too(rig: EngineRig) -> None:
    opened_for(rig, "P01")
    rig.arm()
    rig.fake.world.press("emergency_stop")
    rig.run_ms(5)
    rig.fake.world.release("emergency_stop")
    rig.run_ms(5)
    assert rig.ask(ClearHalt).error is None
    assert "emergency_stop ended" in armed_without_a_try(rig, "P01").reason


def test_ten_minutes_without_use_end_it(rig: EngineRig) -> None:
    session_of(rig, "P01")
    rig.clock.spend(10 * MINUTE_NS - 2_000_000_000)
    rig.run_ms(100)  # the rail is measured again
    assert armed_without_a_try(rig, "P01").error is None
    assert rig.ask(CloseLease, lease=LEASE).error is None
    rig.clock.spend(10 * MINUTE_NS)
    answer = armed_without_a_try(rig, "P01")
    assert answer.error == "arm_failed"
    assert "ended after 10 minutes without use" in answer.reason


def test_status_tells_whose_session_it_is_when_it_ends_and_what_is_to_be_tried(
    rig: EngineRig,
) -> None:
    rig.run_ms(5)
    assert (states(rig)[-1].session, states(rig)[-1].arming_refused) == (None, None)
    opened_for(rig, "P01")
    assert "press and release it once" in (states(rig)[-1].arming_refused or "")
    rig.arm()
    assert states(rig)[-1].session == SessionFacts(participant="P01", ends_in_s=None)
    assert states(rig)[-1].arming_refused is None
    assert rig.ask(CloseLease, lease=LEASE).error is None
    rig.run_ms(1_100)
    told = states(rig)[-1].session
    assert told is not None
    assert (told.participant, round(told.ends_in_s or 0)) == ("P01", 599)
    opened_for(rig, None)
    rig.run_ms(5)
    assert states(rig)[-1].session is None
    assert "no calibration" in (states(rig)[-1].arming_refused or "")
