"""The bench of what a person says, in its short form: one finger of each body, ten minutes of it.

A body on which the bound does not hold is named in the bench and on the page; there the harm has
the bound of a law's.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bench.steady_felt import (
    COMMON,
    LOOKED_AT,
    NOT_HELD,
    SEEDS,
    Compared,
    Manner,
    Person,
    bounds,
    compared,
    play,
)
from bench.steady_harm import MOST_TIMES
from etd_body.kinds import BodyKind

PAGE = Path(__file__).parents[2] / "docs" / "stabilization.md"
HELD = [body for body in BodyKind if body not in NOT_HELD]


@pytest.mark.parametrize("body", HELD)
def test_the_bound_holds_with_a_person_who_is_right_four_times_of_five(body: BodyKind) -> None:
    found = compared(body, LOOKED_AT, Manner())
    assert found.variation_times <= found.bound


@pytest.mark.parametrize("body", NOT_HELD)
def test_where_it_does_not_hold_the_harm_is_within_a_laws_bound(body: BodyKind) -> None:
    found = compared(body, LOOKED_AT, Manner())
    assert found.variation_times <= MOST_TIMES


@pytest.mark.parametrize("body", NOT_HELD)
def test_what_the_bench_excludes_the_page_says(body: BodyKind) -> None:
    section = PAGE.read_text(encoding="utf-8").split("\n## What the person says")[1]
    section = section.split("\n## ")[0]
    assert f"`{body.value}`" in section
    assert "does not hold" in section


def test_each_bound_can_say_no() -> None:
    found = Compared(BodyKind.AREA, 0.11, 0.1, 0.0, 0.0, 0, 0)
    assert [bound.is_met for bound in bounds([found])] == [False]
    assert [bound.is_met for bound in bounds([replace(found, variation=0.104)])] == [True]
    common = [replace(found, body=body, variation=0.09) for body in COMMON]
    assert not any(bound.is_met for bound in bounds(common))


def test_a_person_errs_as_often_as_they_are_said_to() -> None:
    person = Person(Manner(right=0.8), 1)
    said = [person.says(2.0) for _ in range(2_000)]
    assert said.count("too_strong") / 2_000 == pytest.approx(0.8, abs=0.03)
    assert said.count("good") / 2_000 == pytest.approx(0.1, abs=0.03)


def test_who_is_always_right_is_not_served_worse() -> None:
    """On the body where the drift is common to all."""
    (seed,) = LOOKED_AT
    right = play(BodyKind.ADAPTING, seed, Manner(right=1.0))
    erring = play(BodyKind.ADAPTING, seed, Manner())
    assert right.over_time <= 1.1 * erring.over_time


def test_the_fingers_of_the_page_are_not_those_that_are_looked_at() -> None:
    assert not set(SEEDS) & set(LOOKED_AT)
