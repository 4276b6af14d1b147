"""*Too strong* of a pulse that another limit had lowered already: what is felt falls at once, and
no soft start brings it back.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import calibration, clamps, only
from etd.protocol.link import Answer, CloseLease, SayFelt
from felt_scenes import CAP_UA, done, felt_rig, hold, last_ua, say

MakeRig = Callable[..., EngineRig]
N, FIRST = 16, 1


def show(rig: EngineRig, ms: int, current_ua: int) -> list[int]:
    """The currents of its pulses in turn, as they were asked of the source."""
    before = len(rig.body())
    for _ in range(ms // 100):
        rig.show(current_ua=only(N, e1=current_ua), rate_hz=40.0, ttl_ms=200)
        rig.run_ms(100)
    fired = [one["asked_ua"] for one in rig.body()[before:] if one["electrode"] == FIRST]
    probe_ua = rig.engine.supervisor.maxima.probe_current_ua
    return [ua for ua in fired if ua != pytest.approx(probe_ua, rel=0.05)]


def rising(make_rig: MakeRig) -> EngineRig:
    """Armed a moment ago: the soft start has not let through what is asked."""
    rig = make_rig(electrodes=N)
    assert rig.open_with(calibration(rig, (CAP_UA,) * N)).error is None
    rig.arm()
    return rig


def too_strong(rig: EngineRig, lease: str | None) -> Answer:
    return rig.ask(SayFelt, answer="too_strong", electrodes=None, lease=lease)


@pytest.mark.parametrize("lease", [LEASE, None])
def test_a_soft_start_does_not_pass_what_was_too_strong(
    make_rig: MakeRig, lease: str | None
) -> None:
    rig = rising(make_rig)
    fired_ua = show(rig, 300, CAP_UA)[-1]
    assert fired_ua < 0.6 * CAP_UA, "the soft start is under way"
    did, why = done(too_strong(rig, lease))
    assert did == "lowered"
    assert "no soft start either" in why
    after = show(rig, 3_000, CAP_UA)
    assert max(after) < fired_ua
    assert after[-1] == pytest.approx((0.95 if lease is None else 0.98) * fired_ua, abs=8)
    assert {clamp.reason for clamp in clamps(rig)[-3:]} == {"felt"}
    least_ua = show(rig, 1_000, int(0.5 * fired_ua))
    assert max(least_ua) <= 0.5 * fired_ua, "what is below it is not raised"


def test_the_reply_to_a_frame_tells_it(make_rig: MakeRig) -> None:
    rig = rising(make_rig)
    fired_ua = show(rig, 300, CAP_UA)[-1]
    too_strong(rig, None)
    (clamp,) = rig.show(current_ua=only(N, e1=CAP_UA), rate_hz=40.0, ttl_ms=200).clamped
    assert (clamp.reason, clamp.electrode) == ("felt", FIRST)
    assert clamp.allowed_ua < fired_ua


def test_good_gives_back_what_it_took_and_too_weak_goes_on_slowly(make_rig: MakeRig) -> None:
    rig = rising(make_rig)
    fired_ua = show(rig, 300, CAP_UA)[-1]
    too_strong(rig, None)

    def a_minute_after(answer: str) -> int:
        show(rig, 60_000, CAP_UA)
        assert done(say(rig, answer))[0] == "gives_back"
        return show(rig, 200, CAP_UA)[-1]

    # A word gives back 5 %, of 95 %.
    assert a_minute_after("good") == pytest.approx(0.9975 * fired_ua, abs=8)
    assert a_minute_after("good") == pytest.approx(fired_ua, abs=8)
    show(rig, 60_000, CAP_UA)
    assert done(say(rig, "good"))[0] == "nothing"
    assert show(rig, 200, CAP_UA)[-1] == pytest.approx(fired_ua, abs=8)
    assert a_minute_after("too_weak") == pytest.approx(1.05 * fired_ua, abs=12)


def test_under_a_cap_every_word_is_felt(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    assert rig.open_with(calibration(rig, (1_000,) * N)).error is None
    rig.arm()
    assert show(rig, 3_000, 2_000)[-1] == pytest.approx(1_000, abs=8)
    for left in (0.95, 0.95 * 0.8):
        too_strong(rig, None)
        assert show(rig, 500, 2_000)[-1] == pytest.approx(left * 1_000, abs=10)


def test_where_a_cap_left_less_of_a_rise_it_lowers_as_well(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, cap_ua=2_050, may_raise=True)
    hold(rig, 500, level=1.0)
    for _ in range(8):
        say(rig, "too_weak")
        hold(rig, 15_000, level=1.0)
    before_ua = last_ua(rig)
    assert before_ua == pytest.approx(2_050, abs=8)
    say(rig, "too_strong")
    hold(rig, 500, level=1.0)
    assert last_ua(rig) == pytest.approx(0.98 * before_ua, abs=8)


def test_where_the_charge_of_a_pulse_left_less_of_a_rise_it_lowers_as_well(
    make_rig: MakeRig,
) -> None:
    """500 nC in 100 us: the request itself is no higher than that."""
    rig = felt_rig(make_rig, cap_ua=5_500, may_raise=True, comfortable_ua=4_800)
    hold(rig, 3_000, level=1.0, rate_hz=10.0)
    for _ in range(8):
        say(rig, "too_weak")
        hold(rig, 15_000, level=1.0, rate_hz=10.0)
    before_ua = last_ua(rig)
    assert before_ua == pytest.approx(5_000, abs=8)
    say(rig, "too_strong")
    hold(rig, 500, level=1.0, rate_hz=10.0)
    assert last_ua(rig) == pytest.approx(0.98 * before_ua, abs=8)


def test_too_strong_takes_once_of_what_was_raised_and_tells_it_so(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, may_raise=True)
    own_ua = last_ua(rig)
    for _ in range(8):
        say(rig, "too_weak")
        hold(rig, 15_000)
    hold(rig, 1_000)
    raised_ua = last_ua(rig)
    assert raised_ua > 1.04 * own_ua
    say(rig, "too_strong")
    hold(rig, 500)
    assert last_ua(rig) == pytest.approx(0.98 * raised_ua, abs=8)
    for word in (None, None):
        say(rig, "too_strong", lease=word)
        hold(rig, 500)
        told = rig.engine.components.feeling.facts()
        assert told is not None
        assert last_ua(rig) == pytest.approx(told.factors[4] * own_ua, rel=0.01)


def test_disarming_begins_anew(make_rig: MakeRig) -> None:
    rig = rising(make_rig)
    show(rig, 300, CAP_UA)
    too_strong(rig, None)
    assert rig.ask(CloseLease, lease=LEASE).error is None
    assert rig.open_with(calibration(rig, (CAP_UA,) * N)).error is None
    rig.arm()
    found = show(rig, 5_000, CAP_UA)
    assert found == sorted(found)
    assert found[-1] == pytest.approx(CAP_UA, rel=0.02)
