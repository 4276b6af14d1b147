"""The bench of what a person says, in its short form: one finger of each body, ten minutes of it.

A body on which the bound does not hold is named in the bench and on the page; there the harm has
the bound of a law's.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.felt_foresight import Course, Foreseen, best
from bench.felt_laws import with_law
from bench.felt_person import ANSWERS_S, INSISTS_S, Manner, Person, times_wanted
from bench.felt_play import Unsaid, finger_of, play, scans
from bench.steady_felt import (
    COMMON,
    LOOKED_AT,
    NOT_HELD,
    SEEDS,
    Compared,
    Figures,
    bounds,
    compared,
)
from bench.steady_harm import MOST_TIMES
from etd.stabilize.said import LOWERED_BY, MOST, RISE_A_MINUTE
from etd_body.kinds import BodyKind

PAGE = Path(__file__).parents[2] / "docs" / "stabilization.md"
HELD = [body for body in BodyKind if body not in NOT_HELD]
MINUTE_NS = 60_000_000_000


@pytest.mark.parametrize("body", HELD)
def test_the_bound_holds_with_persons_who_are_right_four_times_of_five(body: BodyKind) -> None:
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
    plain = Figures(0.1, 0.0, 0.0, 0.0, 0.0)
    found = Compared(BodyKind.AREA, replace(plain, variation=0.11), plain, 1.1)
    assert [bound.is_met for bound in bounds([found])] == [False]
    better = replace(found, said=replace(plain, variation=0.104))
    assert [bound.is_met for bound in bounds([better])] == [True]
    slightly = replace(found, said=replace(plain, variation=0.09))
    assert not any(bound.is_met for bound in bounds([replace(slightly, body=it) for it in COMMON]))


def test_the_fingers_of_the_page_are_not_those_that_are_looked_at() -> None:
    assert not set(SEEDS) & set(LOOKED_AT)


def test_who_is_always_right_is_not_served_worse() -> None:
    """On the body where the drift is common to all."""
    (seed,) = LOOKED_AT
    right = play(BodyKind.ADAPTING, seed, Manner(right=1.0)).figures
    erring = play(BodyKind.ADAPTING, seed, Manner()).figures
    assert right.over_time <= 1.1 * erring.over_time


def test_who_insists_has_it_too_strong_for_less_of_the_time() -> None:
    """On the body whose calibration is too strong for the whole array."""
    (seed,) = LOOKED_AT
    patient = play(BodyKind.SUMMING, seed, Manner(right=1.0))
    insisting = play(BodyKind.SUMMING, seed, Manner(right=1.0, insists=True))
    assert insisting.too_strong < 0.7 * patient.too_strong


# --- persons -------------------------------------------------------------------------------------


def test_a_person_errs_as_often_as_they_are_said_to_and_either_way() -> None:
    person = Person(Manner(right=0.8), 1)
    said = [person.says(2.0) for _ in range(2_000)]
    assert said.count("too_strong") / 2_000 == pytest.approx(0.8, abs=0.03)
    assert said.count("good") / 2_000 == pytest.approx(0.1, abs=0.03)


def test_who_errs_in_one_direction_says_nothing_else_in_error() -> None:
    person = Person(Manner(right=0.8, errs="too_weak"), 1)
    said = [person.says(1.0) for _ in range(2_000)]
    assert said.count("too_weak") / 2_000 == pytest.approx(0.2, abs=0.03)
    assert said.count("too_strong") == 0


def test_what_is_good_for_whom() -> None:
    narrow, wide = Person(Manner(), 1), Person(Manner(band=0.35), 1)
    assert [narrow.judges(it) for it in (0.8, 1.0, 1.25)] == ["too_weak", "good", "too_strong"]
    assert [wide.judges(it) for it in (0.7, 0.8, 1.25, 1.4)] == [
        *("too_weak", "good", "good", "too_strong")
    ]


def test_persons_of_a_finger_err_at_other_times() -> None:
    persons = [Person(Manner(right=0.5), 31, number) for number in range(4)]
    said = {tuple(person.says(1.0) for _ in range(20)) for person in persons}
    assert len(said) == len(persons)


def test_who_insists_answers_again_soon_and_only_of_too_strong() -> None:
    person = Person(Manner(insists=True), 1)
    assert person.again_s("too_strong") == INSISTS_S
    assert person.again_s("good") == ANSWERS_S
    assert Person(Manner(), 1).again_s("too_strong") == ANSWERS_S


def test_where_nothing_changes_it_is_as_strong_as_it_was_wanted() -> None:
    """A person who compared with anything else would call it too strong from the beginning."""
    (seed,) = LOOKED_AT
    _, times = scans(finger_of(BodyKind.INDIFFERENT, seed, 3.0), Unsaid())
    assert np.median(times) == pytest.approx(1.0, abs=0.05)


def test_only_what_was_wanted_is_compared() -> None:
    assert times_wanted(np.array([[2.0, 5.0], [1.0, 5.0]]), np.array([1.5, 0.0])) == 1.0


def test_with_a_law_the_answers_reach_the_engine() -> None:
    """Who says nothing but too strong, again and again, gets less from what the law leaves."""
    (seed,) = LOOKED_AT
    manner = Manner(right=0.0, errs="too_strong", insists=True)
    found = with_law(BodyKind.INDIFFERENT, "energy", seed, manner, 1.5)
    assert found.said.mean_felt < 0.97 * found.alone.mean_felt
    assert found.off_min is None, "energy changes hardly anything, so nothing counts against it"


# --- what could be reached -----------------------------------------------------------------------

parts = st.lists(st.floats(0.0, 1.0), min_size=9, max_size=9).map(np.array)


@settings(max_examples=50)
@given(parts, parts, st.lists(st.floats(0.2, 3.0), min_size=10, max_size=10), st.booleans())
def test_who_foresees_all_keeps_the_daemons_rates(
    falls: np.ndarray, rises: np.ndarray, times: list[float], heeds: bool
) -> None:
    foreseen = Foreseen(Course(falls, rises), heeds)
    before = 1.0
    for minute, strength in enumerate(times, 1):
        now_ns = minute * MINUTE_NS
        factor = foreseen.of(0, now_ns)
        assert factor <= min(MOST, before * RISE_A_MINUTE) + 1e-9
        foreseen.felt(strength, now_ns)
        before = foreseen.of(0, now_ns)
        assert before <= factor + 1e-9
        if heeds and strength > 1.2 and minute < len(times):
            assert before <= factor * (1.0 - LOWERED_BY) + 1e-9
            assert math.isclose(foreseen.of(0, now_ns + MINUTE_NS), before)


def test_what_is_foreseen_is_better_than_nothing_and_heeding_costs() -> None:
    (seed,) = LOOKED_AT
    plain = play(BodyKind.SUMMING, seed, None, 4.0).figures.over_time
    free = best(BodyKind.SUMMING, seed, heeds=False, minutes=4.0).figures.over_time
    heeding = best(BodyKind.SUMMING, seed, heeds=True, minutes=4.0).figures.over_time
    assert free <= 1.01 * plain
    assert free <= 1.01 * heeding
