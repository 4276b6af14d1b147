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


def test_good_of_what_is_whole_asks_for_nothing_more() -> None:
    assert last_of((40, "good", None))[0] == FeltDone(did="nothing")


def test_too_weak_of_what_is_whole_says_that_nothing_is_raised() -> None:
    done, _ = last_of((40, "too_weak", None))
    assert done.did == "nothing"
    assert "nothing is lowered that could come back" in done.reason
