"""The bench of what a person says, in its short form: one finger of each body, ten minutes of it.

Owns: the bounds of that, and that the bench can tell which bound a body has. Must not know: how
answers are heeded.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench import felt_docs
from bench.felt_compared import (
    MOST_TIMES,
    MOST_TIMES_COMMON,
    Compared,
    Figures,
    bounds,
    compared,
    not_asked,
)
from bench.felt_drift import COMMON, LEAST_SIZE, Drift
from bench.felt_foresight import Course, Foreseen, best
from bench.felt_laws import with_law
from bench.felt_person import ANSWERS_S, INSISTS_S, Manner, Person, times_wanted
from bench.felt_play import Unsaid, finger_of, play, scans
from bench.steady_felt import LOOKED_AT, SEEDS
from etd.stabilize.said import LOWERED_BY, MOST, RISE_A_MINUTE
from etd_body.kinds import BodyKind

PAGE = Path(__file__).parents[2] / "docs" / "stabilization.md"
MINUTE_NS = 60_000_000_000
#: The kinds whose thresholds move for minutes, all together: by use, and by sweat that stays.
DRIFTING = (BodyKind.ADAPTING, BodyKind.SOAKING)
PLAIN = Figures(0.1, 0.0, 0.0, 0.0, 0.0)
SHARED = Drift(COMMON, 0.4, 0.2, LEAST_SIZE, 0.5, 0.6, 0.7)
EACH_ITS_OWN = replace(SHARED, drift=0.99 * COMMON)
TOO_SMALL_TO_TELL = replace(SHARED, drift=0.9, size=0.99 * LEAST_SIZE)


@pytest.mark.parametrize("body", BodyKind)
def test_the_bound_holds_with_persons_who_are_right_four_times_of_five(body: BodyKind) -> None:
    found = compared(body, LOOKED_AT, Manner())
    assert found.variation_times <= found.bound
    assert found.drift.is_common == (body in DRIFTING)
    # Soaking skin begins far too strong: there is nothing to raise until it is late.
    assert found.is_out_of_reach == (body is BodyKind.SOAKING)


def test_the_page_says_of_which_body_the_lower_bound_is_not_asked() -> None:
    section = PAGE.read_text(encoding="utf-8").split("\n## What the person says")[1]
    section = section.split("\n## ")[0]
    assert "**Of `soaking` 0.8 is not asked**" in section


def made_up(times: float, drift: Drift, foreseen_times: float | None) -> Compared:
    said = replace(PLAIN, variation=times * PLAIN.variation)
    return Compared(BodyKind.AREA, said, PLAIN, times, drift, foreseen_times)


@pytest.mark.parametrize(
    ("drift", "foreseen_times", "bound"),
    [
        (EACH_ITS_OWN, None, MOST_TIMES),
        (TOO_SMALL_TO_TELL, None, MOST_TIMES),
        (SHARED, 0.5, MOST_TIMES_COMMON),
        (SHARED, MOST_TIMES_COMMON, MOST_TIMES_COMMON),
        (SHARED, 0.81, MOST_TIMES),
        (SHARED, None, MOST_TIMES_COMMON),
    ],
)
def test_each_bound_can_say_no(drift: Drift, foreseen_times: float | None, bound: float) -> None:
    for times, is_met in ((0.99 * bound, True), (1.01 * bound, False)):
        (found,) = bounds([made_up(times, drift, foreseen_times)])
        assert (found.bound, found.is_met) == (bound, is_met)


def test_a_bound_that_is_not_asked_is_told_and_why() -> None:
    held, far = made_up(0.7, SHARED, 0.5), made_up(1.0, SHARED, 0.92)
    assert not_asked([held, made_up(1.0, EACH_ITS_OWN, None)]) == []
    (said,) = not_asked([held, far])
    assert "0.8 is not asked" in said
    assert "reaches 0.92" in said


def test_the_page_has_the_table_between_its_marks(tmp_path: Path) -> None:
    copy = tmp_path / PAGE.name
    text = PAGE.read_text(encoding="utf-8")
    copy.write_text(text, encoding="utf-8")
    felt_docs.write(copy, [made_up(1.2, SHARED, 0.5)], "a run that was not made", ["why not"])
    before, _, rest = copy.read_text(encoding="utf-8").partition(felt_docs.BEGIN)
    part, _, after = rest.partition(felt_docs.END)
    assert "A run that was not made" in part
    assert "**1.20**" in part
    assert "- why not" in part
    assert text.startswith(before)
    assert text.endswith(after)
    assert after


# --- whom it serves ------------------------------------------------------------------------------


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
