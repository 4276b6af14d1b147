"""What a person says of the strength, on the wires: who may say it, and what the skin gets then."""

from __future__ import annotations

import datetime
import re
from dataclasses import replace

import msgspec
import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import (
    clamps,
    only,
    opened_to,
    phases,
    states,
)
from etd.engine.feeling import Feeling
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.felt import FeltFacts
from etd.protocol.link import CloseLease, DisarmBoard, SayFelt
from etd.stabilize.law_settings import PowerLawSettings
from etd.stabilize.offset_estimate import Answer as FeltAnswer
from etd.stabilize.said_electrode import ANSWERED_LOWERED_BY, LOWERED_BY, MOST, RISE_A_MINUTE
from etd.stabilize.settings import Settings
from etd_body.electrode import skin
from felt_scenes import (
    ADAPTS,
    CAP_UA,
    MakeRig,
    N,
    done,
    felt_rig,
    hold,
    last_ua,
    of_four,
    only_level,
    ready,
    say,
)

#: So many answers in a row against laws are enough (`tests/stabilize/test_law_watch.py`).
TOO_MANY = 4


def facts(rig: EngineRig) -> FeltFacts:
    found = states(rig)[-1].felt
    assert found is not None
    return found


def test_too_strong_lowers_the_next_pulse_and_is_told_as_a_clamp(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    before_ua = last_ua(rig)
    assert say(rig, "too_strong").error is None
    rig.reports.clear()
    hold(rig, 200)
    assert last_ua(rig) == pytest.approx((1 - ANSWERED_LOWERED_BY) * before_ua, abs=5)
    told = {clamp.reason for clamp in clamps(rig)}
    assert told == {"felt"}
    assert clamps(rig)[-1].limited_by == 4
    assert clamps(rig)[-1].wanted_ua == pytest.approx(before_ua, abs=5)


def test_the_reply_to_a_frame_tells_it_and_a_strict_frame_is_refused(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    say(rig, "too_strong")
    answer = rig.show(level=only_level(0.5), rate_hz=20.0)
    assert [clamp.reason for clamp in answer.clamped] == ["felt"]
    refused = rig.show(level=only_level(0.5), rate_hz=20.0, strict=True)
    assert refused.error == "over_limit"
    assert "too strong" in refused.reason
    assert "only disarming" in refused.reason


def test_an_account_tells_it(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    say(rig, "too_strong")
    rig.show(level=only_level(0.5), rate_hz=20.0, account=True, pulses=3)
    seq = rig.last_seq
    rig.run_ms(400)
    account = rig.engine.components.reporter.accounts.of(seq)
    assert account is not None
    assert account.most_ua[4] < account.wanted_ua[4]
    assert [clamp.reason for clamp in account.clamped] == ["felt"]


def test_too_weak_raises_a_level_slowly_and_the_cap_stays(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, cap_ua=2_050, may_raise=True)
    before_ua = last_ua(rig)
    for _ in range(8):
        assert done(say(rig, "too_weak"))[0] == "raises"
        hold(rig, 15_000)
    risen = last_ua(rig) / before_ua
    assert 1.03 < risen <= 1.001 * RISE_A_MINUTE**2
    hold(rig, 2_000, level=1.0)
    assert last_ua(rig) <= 2_050
    assert facts(rig).factors[4] <= MOST


def test_as_it_ships_too_weak_gives_back_and_says_that_it_raises_nothing(
    make_rig: MakeRig,
) -> None:
    rig = felt_rig(make_rig)
    before_ua = last_ua(rig)
    did, why = done(say(rig, "too_weak"))
    assert did == "nothing"
    assert "felt_may_raise = false in the body site" in why
    assert "show a higher level" in why
    hold(rig, 3_000)
    assert last_ua(rig) == before_ua
    assert done(say(rig, "too_strong")) == ("lowered", "")
    did, why = done(say(rig, "too_weak"))
    assert did == "gives_back"
    assert "no more than that" in why
    hold(rig, 10_000)
    assert last_ua(rig) / before_ua == pytest.approx(1 - ANSWERED_LOWERED_BY, abs=0.002)
    hold(rig, 52_000)
    assert last_ua(rig) == before_ua


@pytest.mark.parametrize(
    ("adaptation", "why"),
    [
        (None, "it was not measured that this person feels less in use (etd calibrate CODE"),
        (msgspec.structs.replace(ADAPTS, weaker=11), "11 of 20 answers were weaker"),
        (msgspec.structs.replace(ADAPTS, date=datetime.date(2020, 1, 1)), "before the calibration"),
    ],
)
def test_too_weak_raises_nothing_of_a_person_of_whom_it_was_not_measured(
    make_rig: MakeRig, adaptation: MeasuredAdaptation | None, why: str
) -> None:
    rig = felt_rig(make_rig, may_raise=True, adaptation=adaptation)
    before_ua = last_ua(rig)
    did, said = done(say(rig, "too_weak"))
    assert did == "nothing"
    assert why in said
    assert "show a higher level" in said
    hold(rig, 3_000)
    assert last_ua(rig) == before_ua


def test_what_was_measured_of_one_person_raises_nothing_for_the_next(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, may_raise=True)
    assert done(say(rig, "too_weak"))[0] == "raises"
    rig.ask(CloseLease, lease=LEASE)
    ready(rig)
    hold(rig, 2_000)
    assert done(say(rig, "too_weak"))[0] == "nothing"


def test_who_lost_the_lease_is_heard_to_say_too_strong(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    before_ua = last_ua(rig)
    assert done(say(rig, "too_strong", lease="lapsed"))[0] == "lowered"
    hold(rig, 200)
    assert last_ua(rig) == pytest.approx((1 - LOWERED_BY) * before_ua, abs=2)
    assert facts(rig).lowers_only
    answer = say(rig, "too_weak", lease="lapsed")
    assert answer.error == "other_lease"


def test_the_first_pulse_after_a_minute_of_silence_is_not_raised(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, may_raise=True)
    before_ua = last_ua(rig)
    assert done(say(rig, "too_weak")) == ("raises", "")
    hold(rig, 200)
    assert last_ua(rig) > 1.04 * before_ua
    elsewhere = tuple(0.5 if electrode == 5 else 0.0 for electrode in range(N))
    rig.hold(62_000, level=elsewhere, rate_hz=20.0, ttl_ms=1_000)
    before = len(of_four(rig))
    hold(rig, 200)
    assert max(of_four(rig)[before:]) <= before_ua


def test_good_has_nothing_to_explain(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    assert done(say(rig, "good")) == ("nothing", "")
    hold(rig, 300)
    assert done(say(rig, "good")) == ("nothing", "")


def test_what_rises_later_says_when(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    say(rig, "too_strong", lease=None)
    hold(rig, 20_000)
    did, why = done(say(rig, "good"))
    assert did == "gives_back"
    when = "it rises in (39|40) s, if it is fired then: nothing does within a minute of too_strong"
    assert re.match(when, why)
    did, why = done(say(rig, "too_weak"))
    assert did == "gives_back"
    assert why.startswith("it rises in ")
    assert "no more than that" in why


def test_of_hardly_anything_it_is_told_that_it_does_not_come_back(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    for _ in range(8):
        say(rig, "too_strong")
        hold(rig, 300)
    for answer in ("good", "too_weak"):
        assert "only disarming brings it back" in done(say(rig, answer))[1]


def test_a_current_that_the_frame_names_is_never_raised(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, may_raise=True)
    frame = {"current_ua": only(N, e4=1_000), "rate_hz": 20.0, "ttl_ms": 1_000}
    rig.hold(500, **frame)
    before_ua = last_ua(rig)
    say(rig, "too_weak")
    rig.hold(20_000, **frame)
    assert last_ua(rig) == before_ua
    assert not [clamp for clamp in clamps(rig) if clamp.reason == "frame"]


def test_who_does_not_hold_the_lease_can_only_lower(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    for answer in ("good", "too_weak"):
        refused = say(rig, answer, lease=None)
        assert refused.error == "other_lease"
        assert "only its holder" in refused.reason
    assert say(rig, "too_strong", lease=None).error is None
    assert facts(rig).lowers_only
    assert facts(rig).factors[4] < 1.0


def test_without_a_lease_or_unarmed_nothing_can_be_said(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    assert say(rig, "too_weak", lease=None).error == "no_lease"
    assert say(rig, "good").error == "no_lease"
    assert say(rig, "too_strong", lease=None).error == "not_armed"
    rig.open()
    assert say(rig, "good").error == "not_armed"


def test_where_nothing_is_left_the_refusal_says_what_brings_it_back(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    for _ in range(40):
        assert say(rig, "too_strong").error is None
    hold(rig, 61_000)
    refused = say(rig, "too_weak")
    assert refused.error == "wrong_state"
    assert "left 0% of the current, and only disarming brings it back" in refused.reason


def test_what_was_not_fired_in_the_last_minute_cannot_be_good(make_rig: MakeRig) -> None:
    rig = ready(make_rig(electrodes=N))
    assert say(rig, "too_weak").error == "wrong_state"
    hold(rig, 300)
    assert say(rig, "too_weak").error is None
    refused = say(rig, "good", electrodes=(4, 5))
    assert (refused.error, refused.electrode) == ("wrong_state", 5)
    assert say(rig, "too_strong", electrodes=(N,)).error == "bad_message"
    assert say(rig, "too_strong", electrodes=(5,)).error is None
    assert facts(rig).factors[4] >= 1.0 > facts(rig).factors[5]


def test_disarming_forgets_all_of_it(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig)
    before_ua = last_ua(rig)
    say(rig, "too_strong")
    hold(rig, 200)
    rig.ask(DisarmBoard, lease=LEASE)
    assert states(rig)[-1].felt is None
    rig.arm()
    opened_to(rig, CAP_UA)
    hold(rig, 2_000)
    assert last_ua(rig) == before_ua


# --- laws ----------------------------------------------------------------------------------------


def with_law() -> LoadedConfig:
    loaded = fake_config(electrodes=N)
    settings = Settings(order=("power_law",), power_law=PowerLawSettings())
    return replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=settings))


def widened(make_rig: MakeRig) -> EngineRig:
    """A law by resistance gives much more than the frame, since the skin has become wet."""
    rig = make_rig(loaded=with_law())
    rig.fake.world.touch(4, skin(1_000.0, 30_000.0, 0.8))
    ready(rig)
    hold(rig, 4_000)
    rig.fake.world.touch(4, skin(800.0, 22_000.0, 0.8))
    hold(rig, 3_000)
    return rig


def last_us(rig: EngineRig) -> float:
    return [phase.width_us for phase in phases(rig) if phase.electrode == 4][-1]


def say_once(rig: EngineRig, answer: str) -> None:
    """As a first word, that takes little: another one goes before it, and the last one counts."""
    say(rig, "good")
    say(rig, answer)


def test_a_law_that_goes_against_the_person_is_switched_off_until_the_lease_ends(
    make_rig: MakeRig,
) -> None:
    rig = widened(make_rig)
    wide_us = last_us(rig)
    assert wide_us > 1.2 * 100
    for _ in range(TOO_MANY - 1):
        say_once(rig, "too_strong")
        hold(rig, 31_000)
    assert facts(rig).laws_off == ""
    assert last_us(rig) == pytest.approx(wide_us, abs=10)
    say_once(rig, "too_strong")
    hold(rig, 3_000)
    assert "said the opposite" in facts(rig).laws_off
    assert last_us(rig) == pytest.approx(100, abs=2)
    rig.ask(DisarmBoard, lease=LEASE)
    assert facts(rig).laws_off
    assert facts(rig).factors == (1.0,) * N


def test_one_complaint_that_is_insisted_on_is_one(make_rig: MakeRig) -> None:
    rig = widened(make_rig)
    for _ in range(2 * TOO_MANY):
        say(rig, "too_strong", electrodes=(4,))
        hold(rig, 500)
    assert facts(rig).laws_off == ""


class Played:
    """A feeling whose answers come each four minutes: what it takes is said, not insisted on."""

    def __init__(self) -> None:
        self.feeling = Feeling(N, may_raise=False)
        self.now_ns = 0

    def say(self, answer: FeltAnswer, gave: float, left: float) -> None:
        """Of pulses of which laws gave so much, and limits and words left so much."""
        self.now_ns += 240_000_000_000
        for electrode in range(N):
            self.feeling.laws_gave(electrode, gave)
            self.feeling.fired(electrode, left, self.now_ns, 1_000, 1_000, 1_000)
        self.feeling.hear(SayFelt(ref=1, answer=answer, lease=LEASE), self.now_ns + 1)


def test_what_a_word_took_is_not_held_against_a_law_where_more_is_asked_for() -> None:
    played = Played()
    for _ in range(2 * TOO_MANY):
        played.say("too_weak", 0.7, 0.7 * 0.4)
    assert played.feeling.laws_off == ""
    for _ in range(TOO_MANY):
        assert played.feeling.laws_off == ""
        played.say("too_weak", 0.7, 0.7)
    assert "said the opposite" in played.feeling.laws_off


def test_what_a_word_took_does_not_excuse_a_law_that_adds() -> None:
    """It is too strong even so, and what the law adds is in it."""
    played = Played()
    for _ in range(TOO_MANY):
        assert played.feeling.laws_off == ""
        played.say("too_strong", 1.3, 1.3 * played.feeling.factor(0, played.now_ns))
    assert "said the opposite" in played.feeling.laws_off


def test_what_a_cap_took_is_not_held_against_a_law() -> None:
    played = Played()
    for _ in range(2 * TOO_MANY):
        played.say("too_strong", 1.3, played.feeling.factor(0, played.now_ns))
    assert played.feeling.laws_off == ""


def test_the_word_of_somebody_else_switches_no_law_off(make_rig: MakeRig) -> None:
    rig = widened(make_rig)
    for _ in range(2 * TOO_MANY):
        say(rig, "too_strong", lease=None)
    assert facts(rig).laws_off == ""
