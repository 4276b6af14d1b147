"""Why an answer did nothing, as the reply to it says."""

from __future__ import annotations

import datetime

import pytest

from engine_parts import calibration
from etd.engine.feeling import Feeling
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.felt import FeltDone
from etd.protocol.link import SayFelt
from etd.stabilize.offset_estimate import Answer

S = 1_000_000_000
DAY = datetime.date(2025, 1, 15)
WEAKER = MeasuredAdaptation(
    answers=20, weaker=16, stronger=1, use_s=600.0, weaker_from_s=None, date=DAY
)


#: When, in seconds, and of which electrodes; None: of all.
Said = tuple[int, Answer, tuple[int, ...] | None]


def last_of(*said: Said, may_raise: bool = False) -> tuple[FeltDone, float]:
    """The reply to the last of these, each of two electrodes that are in use all the time; and the
    first one's factor then.
    """
    feeling = Feeling(2, may_raise=may_raise)
    feeling.lease_begun((calibration(2, adaptation=WEAKER, date=DAY),))
    until_s, done = 0, FeltDone(did="nothing")
    for at_s, answer, electrodes in said:
        for second in range(until_s, at_s):
            for electrode in (0, 1):
                feeling.fired(electrode, 1.0, second * S, 1_000, 1_000, 1_000)
        until_s = at_s
        word = SayFelt(ref=1, answer=answer, electrodes=electrodes, lease="a")
        done = feeling.hear(word, at_s * S)
    return done, feeling.factor(0, until_s * S)


@pytest.mark.parametrize(
    "said",
    [
        ((40, "too_strong", None), (50, "too_strong", None), (60, "good", None)),
        # Weaker by one answer, of all, than several have said of this one.
        (
            (100, "too_strong", (0,)),
            (200, "too_weak", None),
            (270, "too_strong", (0,)),
            (275, "too_strong", (0,)),
            (280, "good", None),
            (320, "good", None),
            (390, "too_strong", (0,)),
            (430, "too_weak", None),
        ),
    ],
)
def test_a_deep_fall_that_stays_says_that_all_answers_count(said: tuple[Said, ...]) -> None:
    done, factor = last_of(*said)
    assert factor < 0.8
    assert done.did == "nothing"
    assert f"too_strong has left {factor:.0%} of it" in done.reason
    assert "only as far as all answers together say so" in done.reason
    assert "nothing is lowered" not in done.reason


def test_a_named_current_that_stays_below_its_own_strength_says_so() -> None:
    """What was too strong was a rise: the level is at its own strength, a named current below."""
    done, factor = last_of(
        (40, "too_weak", None),
        (110, "too_strong", None),
        (180, "good", None),
        (250, "good", None),
        may_raise=True,
    )
    assert factor >= 1.0
    assert done.did == "nothing"
    assert "of a current_ua that a frame names too_strong has left" in done.reason


@pytest.mark.parametrize("lowered", [None, (0,)])
def test_good_that_takes_of_a_rise_says_so(lowered: tuple[int, ...] | None) -> None:
    """Not what *too strong* left of it: where that was of one, the other one's rise goes back."""
    before: list[Said] = [(40, "too_weak", None), (50, "too_strong", lowered)]
    _, left = last_of(*before, may_raise=True)
    done, factor = last_of(*before, (114, "good", None), may_raise=True)
    assert done.did == ("lowered" if lowered is None else "gives_back")
    assert factor < left if lowered is None else left < factor == 1.0
    assert ("good takes what is not expected to be needed" in done.reason) == (lowered is None)
    assert ("say too_weak" in done.reason) == (lowered is None)


def test_of_a_rise_that_too_strong_has_left_good_gives_nothing_back() -> None:
    """Whether another electrode's goes back or not."""
    said: list[Said] = [(40, "too_weak", (0,)), (110, "too_weak", (0,)), (180, "too_strong", (0,))]
    _, left = last_of(*said, may_raise=True)
    assert left > 1.0
    for good in ((0,), None):
        done, factor = last_of(*said, (245, "good", good), may_raise=True)
        assert factor <= left, done


def test_good_of_what_is_whole_asks_for_nothing_more() -> None:
    assert last_of((40, "good", None))[0] == FeltDone(did="nothing")


def test_too_weak_of_what_is_whole_says_that_nothing_is_raised() -> None:
    done, _ = last_of((40, "too_weak", None))
    assert done.did == "nothing"
    assert "nothing is lowered that could come back" in done.reason


def limited(fired_ua: int = 1_000, wanted_ua: int = 3_000) -> tuple[Feeling, int]:
    """In use for a while, of which another limit leaves less than is asked for."""
    feeling = Feeling(2, may_raise=False)
    feeling.lease_begun()
    for second in range(30):
        for electrode in (0, 1):
            feeling.fired(electrode, 1.0, second * S, fired_ua, wanted_ua, wanted_ua)
    return feeling, 30 * S


def hear(feeling: Feeling, answer: Answer, now_ns: int, lease: str | None = "a") -> FeltDone:
    return feeling.hear(SayFelt(ref=1, answer=answer, lease=lease), now_ns)


@pytest.mark.parametrize("answer", ["good", "too_weak"])
@pytest.mark.parametrize("wanted_ua", [1_000, 3_000])
def test_where_nothing_is_left_nothing_comes_back_and_that_is_said(
    answer: Answer, wanted_ua: int
) -> None:
    feeling, now_ns = limited(wanted_ua=wanted_ua)
    for _ in range(2_000):
        hear(feeling, "too_strong", now_ns, lease=None)
    done = hear(feeling, answer, now_ns)
    assert done.did == "nothing"
    assert done.reason == "too strong has left 0% of the current, and only disarming brings it back"


def test_what_another_limit_holds_is_not_raised_and_that_is_said() -> None:
    feeling, now_ns = limited()
    done = hear(feeling, "too_weak", now_ns)
    assert done.did == "nothing"
    assert "another limit leaves less than is asked for" in done.reason
    assert hear(feeling, "good", now_ns) == FeltDone(did="nothing")


def test_a_ceiling_that_waits_says_so() -> None:
    feeling, now_ns = limited()
    hear(feeling, "too_strong", now_ns, lease=None)
    done = hear(feeling, "good", now_ns + 20 * S)
    assert done.did == "gives_back"
    assert done.reason.startswith("it rises in 40 s, if it is fired then")
    assert "nothing had passed 950 uA at electrode 0" in done.reason


def test_a_named_electrode_that_was_never_fired_is_told_from_others() -> None:
    feeling = Feeling(3, may_raise=False)
    feeling.fired(0, 1.0, 0, 1_000, 1_000, 1_000)
    word = SayFelt(ref=1, answer="too_strong", electrodes=(1, 2))
    done = feeling.hear(word, S)
    assert done.did == "nothing"
    assert "name the electrodes that fire" in done.reason
    assert feeling.factor(1, S) == pytest.approx(0.95), "and that is kept for later"
    word = SayFelt(ref=1, answer="too_strong", electrodes=(0, 1))
    assert feeling.hear(word, 90 * S) == FeltDone(did="lowered")
