"""*Too strong* is said of what was felt lately: of frames that take turns, of a dot that moves on,
of what has not been fired for a while, and of no more than that.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import EngineRig
from engine_scenes import calibration, only
from etd.protocol.felt import FeltFacts
from etd.protocol.link import Answer, SayFelt
from felt_scenes import CAP_UA, done, say

MakeRig = Callable[..., EngineRig]
N = 16


def show(rig: EngineRig, ms: int, current_ua: int, electrode: int = 1, hz: float = 20.0) -> int:
    """The strongest of its pulses, as it was asked of the source; 0: none."""
    before = len(rig.body())
    for _ in range(ms // 100):
        rig.show(current_ua=only(N, **{f"e{electrode}": current_ua}), rate_hz=hz, ttl_ms=200)
        rig.run_ms(100)
    fired = [one["asked_ua"] for one in rig.body()[before:] if one["electrode"] == electrode]
    probe_ua = rig.engine.supervisor.maxima.probe_current_ua
    return max((ua for ua in fired if ua != pytest.approx(probe_ua, rel=0.05)), default=0)


def armed(make_rig: MakeRig, cap_ua: int = CAP_UA) -> EngineRig:
    """A moment ago: the soft start has let nothing through."""
    rig = make_rig(electrodes=N)
    assert rig.open_with(calibration(rig, (cap_ua,) * N)).error is None
    rig.arm()
    return rig


def too_strong(rig: EngineRig, electrodes: tuple[int, ...] | None = None) -> Answer:
    """By a program without the lease, as by a button."""
    return rig.ask(SayFelt, answer="too_strong", electrodes=electrodes, lease=None)


def facts(rig: EngineRig) -> FeltFacts:
    found = rig.engine.components.feeling.facts()
    assert found is not None
    return found


def test_of_frames_that_take_turns_each_word_takes_of_the_strong_one(make_rig: MakeRig) -> None:
    """More than the cap, and less: the last pulse before the word was a weak one."""
    rig = armed(make_rig, cap_ua=1_000)
    assert show(rig, 3_000, CAP_UA) == pytest.approx(1_000, abs=8)
    for left in (0.95, 0.95 * 0.8, 0.95 * 0.8 * 0.5):
        show(rig, 300, 600)
        assert done(too_strong(rig))[0] == "lowered"
        strong_ua, weak_ua = show(rig, 200, CAP_UA), show(rig, 200, 600)
        assert strong_ua == pytest.approx(left * 1_000, abs=8)
        assert weak_ua == pytest.approx(left * 600, abs=8)


@pytest.mark.parametrize("about", [None, (1, 2, 3)])
def test_a_dot_that_moves_on_is_no_stronger_where_it_comes(
    make_rig: MakeRig, about: tuple[int, ...] | None
) -> None:
    """The soft start is under way. What is said of all is also of those that were not fired yet;
    what is said of some is of those.
    """
    rig = armed(make_rig)
    before = [show(rig, 100, CAP_UA, electrode) for electrode in (1, 2, 3)]
    too_strong(rig, about)
    after = [show(rig, 100, CAP_UA, electrode) for electrode in range(4, 12)]
    if about is None:
        for ua in after:
            assert ua == pytest.approx(0.95 * max(before), abs=8)
    else:
        assert max(after) == pytest.approx(CAP_UA, rel=0.02)
    again = [show(rig, 100, CAP_UA, electrode) for electrode in (1, 2, 3)]
    for ua, before_ua in zip(again, before, strict=True):
        assert ua == pytest.approx(0.95 * before_ua, abs=8), "of each as it was fired"


def test_of_all_it_is_as_well_where_the_last_pulse_was_whole(make_rig: MakeRig) -> None:
    """A weak electrode beside the one that the soft start still lowers."""
    rig = armed(make_rig)
    fired_ua = show(rig, 300, CAP_UA)
    assert show(rig, 100, 200, electrode=2) == pytest.approx(200, abs=8)
    too_strong(rig)
    assert show(rig, 1_000, CAP_UA, electrode=5) == pytest.approx(0.95 * fired_ua, abs=8)
    assert show(rig, 1_000, CAP_UA, electrode=2) == pytest.approx(0.95 * fired_ua, abs=8)
    too_strong(rig)
    for electrode in (1, 5, 9):
        part_ua = 0.8 * 0.95 * fired_ua
        assert show(rig, 300, CAP_UA, electrode) == pytest.approx(part_ua, abs=8)


@pytest.mark.parametrize("about", [None, (1,)])
def test_a_late_word_takes_of_what_was_fired(
    make_rig: MakeRig, about: tuple[int, ...] | None
) -> None:
    rig = armed(make_rig, cap_ua=1_000)
    fired_ua = show(rig, 3_000, CAP_UA)
    show(rig, 61_000, 300, electrode=5, hz=2.0)
    assert done(too_strong(rig, about)) == ("lowered", "")
    assert show(rig, 1_000, CAP_UA) == pytest.approx(0.95 * fired_ua, abs=8)


def test_too_weak_of_weaker_pulses_raises_no_ceiling(make_rig: MakeRig) -> None:
    rig = armed(make_rig)
    show(rig, 300, CAP_UA)
    too_strong(rig)
    ceiling_ua = show(rig, 1_000, CAP_UA)
    for _ in range(4):
        show(rig, 61_000, 400, hz=2.0)
        did, why = done(say(rig, "too_weak"))
        assert did in ("gives_back", "nothing")
        assert "nothing" not in why or "passe" not in why, "of a ceiling that does not bind"
    assert show(rig, 1_000, CAP_UA) == ceiling_ua


def test_a_ceiling_does_not_rise_where_it_was_not_fired_for_a_minute(make_rig: MakeRig) -> None:
    """*Too weak* is said of it in time; its room comes in a pause."""
    rig = armed(make_rig, cap_ua=1_000)
    show(rig, 3_000, CAP_UA)
    too_strong(rig)
    ceiling_ua = show(rig, 1_000, CAP_UA)
    show(rig, 50_000, 300, electrode=5, hz=2.0)
    assert done(say(rig, "too_weak", electrodes=(1,)))[0] == "gives_back"
    show(rig, 80_000, 300, electrode=5, hz=2.0)
    assert show(rig, 1_000, CAP_UA) == ceiling_ua


def test_what_a_cap_holds_does_not_rise_and_the_reply_says_so(make_rig: MakeRig) -> None:
    rig = armed(make_rig, cap_ua=1_000)
    show(rig, 3_000, CAP_UA)
    too_strong(rig, (1,))
    replies = []
    for _ in range(3):
        show(rig, 61_000, CAP_UA, hz=2.0)
        replies.append(done(say(rig, "too_weak")))
    fired_ua = show(rig, 1_000, CAP_UA)
    assert fired_ua == pytest.approx(1_000, abs=8)
    assert replies[0][0] == "gives_back"
    did, why = replies[-1]
    assert did == "nothing"
    assert "another limit leaves less than is asked for" in why
    assert " passe" not in why


def test_factors_tell_what_is_left_of_what_is_asked(make_rig: MakeRig) -> None:
    rig = armed(make_rig)
    show(rig, 300, CAP_UA)
    too_strong(rig)
    fired_ua = show(rig, 1_000, CAP_UA)
    assert facts(rig).factors[1] == pytest.approx(fired_ua / CAP_UA, abs=0.002)
    assert facts(rig).factors[2] == pytest.approx(0.95)
    show(rig, 300, 400)
    assert facts(rig).factors[1] == pytest.approx(0.95), "its ceiling does not bind"


def test_of_a_return_it_says_that_nothing_is_lowered(make_rig: MakeRig) -> None:
    rig = armed(make_rig)
    fired_ua = show(rig, 3_000, CAP_UA)
    did, why = done(too_strong(rig, (2,)))
    assert did == "nothing"
    assert "name the electrodes that fire, or none for all" in why
    assert show(rig, 300, CAP_UA) == fired_ua
    assert done(too_strong(rig, (1, 2)))[0] == "lowered"
    assert show(rig, 300, CAP_UA) == pytest.approx(0.95 * fired_ua, abs=8)
