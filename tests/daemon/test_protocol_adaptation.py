"""When what was measured of a person's use lets their answers raise."""

from __future__ import annotations

import datetime
from math import comb

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from etd.files.raises_in_words import raises_in_words
from etd.protocol.adaptation import (
    LEAST_ANSWERS,
    LEAST_WEAKER,
    MeasuredAdaptation,
    why_not_raised,
)

DAY = datetime.date(2026, 1, 15)
ADAPTS = MeasuredAdaptation(answers=20, weaker=12, stronger=2, use_s=600.0, date=DAY)


def test_three_of_five_answers_are_enough() -> None:
    assert ADAPTS.why_not_in(DAY, DAY) is None
    assert why_not_raised(ADAPTS, DAY) is None
    assert replace(ADAPTS, stronger=6).why_not_in(DAY) is None
    assert replace(ADAPTS, use_s=480.0).why_not_in(DAY) is None
    assert ADAPTS.why_not_in(DAY, DAY - datetime.timedelta(days=1)) is None, "midnight elsewhere"


@pytest.mark.parametrize("from_s", [600.0 / 42, 15.0, 600.0])
def test_it_may_be_weaker_from_the_first_answer_to_the_last(from_s: float) -> None:
    assert replace(ADAPTS, weaker_from_s=from_s).why_not_in(DAY, DAY) is None


def test_what_follows_is_said() -> None:
    assert raises_in_words("why", ADAPTS) == "the person's word raises nothing: why"
    told = replace(ADAPTS, weaker_from_s=105.0)
    said = raises_in_words(None, told)
    assert said.startswith("the person's word may raise levels, by at most 5 %")
    assert said.endswith("good makes up for 4.4% a minute of use")
    assert raises_in_words(None, replace(told, weaker_from_s=15.0)).endswith("5.0% a minute of use")
    assert "good raises nothing, since it is not told how fast" in raises_in_words(None, ADAPTS)
    assert told.in_words.endswith("2 stronger; it was weaker from 105 s on")
    assert "good raises nothing" in raises_in_words(None, None)
    assert ADAPTS.in_words.endswith("2 stronger")
    assert replace(told, weaker_from_s=600.0).in_words.endswith("weaker from 600 s on")
    assert replace(told, weaker_from_s=615.0).in_words.endswith("2 stronger"), "of none of them"


@pytest.mark.parametrize("count", [-1, 1_001])
def test_a_file_has_counts_of_answers(count: int) -> None:
    plain = {"answers": 20, "weaker": 0, "stronger": 0, "use_s": 600.0, "date": "2026-01-15"}
    assert msgspec.convert(plain, MeasuredAdaptation).weaker == 0
    assert msgspec.convert(plain | {"weaker": 1_000}, MeasuredAdaptation).weaker == 1_000
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(plain | {"weaker": count}, MeasuredAdaptation)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"weaker": 11}, "below 60% weaker"),
        ({"answers": 19, "weaker": 19, "stronger": 0}, "at least 20 answers are needed"),
        ({"use_s": 479.0}, "at least 480 s are needed"),
        ({"weaker": 15, "stronger": 6}, "more than there were"),
        ({"weaker_from_s": 14.0}, "weaker_from_s, 14 s, is before the first answer"),
        ({"weaker_from_s": 601.0}, "weaker_from_s, 601 s, is after the last of these answers"),
        ({"stronger": 7}, "more than 30% stronger: it goes up and down"),
        ({"date": DAY - datetime.timedelta(days=1)}, "before the calibration that it stands in"),
        ({"date": DAY + datetime.timedelta(days=2)}, "today is 2026-01-15: set the clock"),
    ],
)
def test_anything_less_is_refused_with_what_was_found(changed: dict[str, object], why: str) -> None:
    said = replace(ADAPTS, **changed).why_not_in(DAY, DAY)
    assert said is not None
    assert why in said


def test_a_refusal_has_what_was_found() -> None:
    said = why_not_raised(replace(ADAPTS, weaker=5), DAY)
    assert said is not None
    assert said.startswith(
        "in the second half of 600 s of use, 5 of 20 answers were weaker, 2 stro"
    )
    assert "below 60%" in said


def test_what_was_not_measured_raises_nothing_and_names_the_command() -> None:
    said = why_not_raised(None, DAY)
    assert said is not None
    assert "etd calibrate CODE --adaptation" in said


@given(st.integers(0, 100), st.integers(0, 100), st.floats(1.0, 5_000.0))
def test_more_that_is_weaker_never_takes_it_away(weaker: int, more: int, use_s: float) -> None:
    one = MeasuredAdaptation(answers=200, weaker=weaker, stronger=0, use_s=use_s, date=DAY)
    other = replace(one, weaker=weaker + more)
    assert one.why_not_in(DAY) is not None or other.why_not_in(DAY) is None


def test_the_chances_that_are_named_are_these() -> None:
    """Of who errs one time of five, to either side: feeling it as at first, and feeling less."""
    least = round(LEAST_WEAKER * LEAST_ANSWERS)

    def chance(weaker: float) -> float:
        return sum(
            comb(LEAST_ANSWERS, count) * weaker**count * (1.0 - weaker) ** (LEAST_ANSWERS - count)
            for count in range(least, LEAST_ANSWERS + 1)
        )

    assert chance(0.1) == pytest.approx(5.8e-8, rel=0.05)
    assert chance(0.8) == pytest.approx(0.990, abs=0.001)
