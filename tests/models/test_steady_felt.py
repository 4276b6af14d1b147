"""The bench of what a person says, in its short form: one finger of each body, ten minutes of it.

Owns: the bounds of that, and that the bench can tell which bound a body has. Must not know: how
answers are heeded.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from statistics import correlation

import numpy as np
import pytest

from bench import felt_adaptation, felt_docs, felt_harm, steady_skin
from bench.felt_adaptation import another_day
from bench.felt_compared import (
    MOST_TIMES,
    MOST_TIMES_COMMON,
    RAISED,
    Compared,
    Figures,
    again_where_common,
    bounds,
    compared,
    said_by,
    standard_error,
    unsaid,
)
from bench.felt_drift import COMMON, LEAST_SIZE, Drift
from bench.felt_laws import UNTOLD, WithLaw, with_law
from bench.felt_person import ANSWERS_S, INSISTS_S, Manner, Person, times_wanted
from bench.felt_play import (
    ELECTRODES,
    Said,
    Unsaid,
    finger_of,
    play,
    scans,
    wanted_alone,
    wanted_of,
)
from bench.fresh_seeds import FELT, FELT_COMMON, LOOKED_AT, STEADY, TESTED
from bench.run import Bound
from bench.steady_felt import asked
from bench.steady_figures import SteadyFigures
from bench.steady_laws import NONE
from etd.files.configuration import fake_config
from etd.protocol.calibration import Calibration
from etd_body.kinds import BodyKind
from etd_body.living import LivingBody
from etd_body.tissue import Floats

PAGE = Path(__file__).parents[2] / "docs" / "stabilization.md"
#: The kind whose thresholds move for minutes, all together: by use.
DRIFTING = (BodyKind.ADAPTING,)
PLAIN = Figures(0.1, 0.0, 0.0, 0.0, 0.0)
SHARED = Drift(COMMON, 0.4, 0.2, LEAST_SIZE, 0.5, 0.6, 0.7)
EACH_ITS_OWN = replace(SHARED, drift=0.99 * COMMON)
TOO_SMALL_TO_TELL = replace(SHARED, drift=0.9, size=0.99 * LEAST_SIZE)


@pytest.mark.parametrize("body", BodyKind)
def test_the_bounds_hold_with_persons_who_are_right_four_times_of_five(body: BodyKind) -> None:
    """As it ships, and where answers may raise; but one finger has too few scans above pain for
    what an excluded body is held to instead.
    """
    found = compared([body], TESTED, Manner(), persons=2)
    of_many = {f"{body}: scans above pain, of nothing said, where answers may raise"}
    left_out = of_many if body in felt_harm.EXCLUDED else set[str]()
    not_met = [bound for bound in asked(found) if not bound.is_met and bound.what not in left_out]
    assert not_met == []
    assert {each.drift.is_common for each in found} == {body in DRIFTING}


def test_a_finger_without_any_level_is_counted_and_has_no_variation() -> None:
    """At level 1 the whole array is too strong for it until nothing is left: pain is that near."""
    felt, unfelt = TESTED[0], 7317
    (both, *_) = compared([BodyKind.TENDER], (felt, unfelt), Manner(), 1.0, persons=1)
    (alone, *_) = compared([BodyKind.TENDER], (felt,), Manner(), 1.0, persons=1)
    assert (both.unfelt, alone.unfelt) == (1, 0)
    assert (both.variation_times, both.drift) == (alone.variation_times, alone.drift)
    assert both.plain.not_felt == pytest.approx((1.0 + alone.plain.not_felt) / 2.0)
    (none, *_) = compared([BodyKind.TENDER], (unfelt,), Manner(), 1.0, persons=1)
    assert [bound.is_met for bound in bounds([none])] == [False], "nothing was judged"


def made_up(
    times: float, drift: Drift, body: BodyKind = BodyKind.AREA, *, may_raise: bool = True
) -> Compared:
    said = replace(PLAIN, variation=times * PLAIN.variation)
    return Compared(body, may_raise, said, PLAIN, times, times, drift, raisers=int(may_raise))


def test_a_body_whose_drift_is_common_is_judged_on_other_fingers() -> None:
    """Both ways, with a person each; the rest stays as it was found."""
    found = [
        made_up(1.0, drift, body, may_raise=may_raise)
        for may_raise in (False, True)
        for drift, body in ((EACH_ITS_OWN, BodyKind.AREA), (SHARED, BodyKind.ADAPTING))
    ]
    again = again_where_common(found, (*TESTED, 44), Manner(), 1.0)
    assert [(each.body, each.may_raise) for each in again] == [
        (each.body, each.may_raise) for each in found
    ]
    assert [again[0], again[2]] == [found[0], found[2]]
    assert [(each.fingers, each.persons) for each in again[1::2]] == [(2, 2), (2, 2)]
    assert again_where_common(found[::2], TESTED, Manner(), 1.0) == found[::2]


def test_a_mean_of_few_fingers_has_the_error_that_more_of_them_would_show() -> None:
    """Against the spread of that mean over a thousand other handfuls of fingers."""
    chance = np.random.default_rng(31)
    plain = chance.uniform(0.5, 3.0, (1_000, 20))
    said = plain * chance.normal(0.8, 0.1, plain.shape)
    spread = float((said.sum(axis=1) / plain.sum(axis=1)).std())
    errors = [standard_error(*map(list, each)) for each in zip(said, plain, strict=True)]
    assert float(np.mean(errors)) == pytest.approx(spread, rel=0.1)
    assert np.isnan(standard_error([0.8], [1.0]))


@pytest.mark.parametrize(
    ("drift", "may_raise", "bound"),
    [
        (EACH_ITS_OWN, True, MOST_TIMES),
        (TOO_SMALL_TO_TELL, True, MOST_TIMES),
        (SHARED, True, MOST_TIMES_COMMON),
        (SHARED, False, MOST_TIMES),
    ],
)
def test_each_bound_can_say_no(drift: Drift, *, may_raise: bool, bound: float) -> None:
    for times, is_met in ((0.99 * bound, True), (1.01 * bound, False)):
        (found,) = bounds([made_up(times, drift, may_raise=may_raise)])
        assert (found.bound, found.is_met) == (bound, is_met)


@pytest.mark.parametrize("raisers", [0, 1])
def test_all_is_asked_as_it_ships_and_where_answers_may_raise(raisers: int) -> None:
    """The variation is asked twice only of a body with persons whose answers may raise."""
    hurts = replace(PLAIN, scans_above_pain=100.0)
    ways = [
        Compared(body, may_raise, hurts, hurts, 1.0, 1.0, EACH_ITS_OWN, raisers=raisers)
        for may_raise in (False, True)
        for body in BodyKind
    ]
    named = [bound.what for bound in asked(ways)]
    assert sum("variation" in what for what in named) == (1 + raisers) * len(BodyKind)
    assert sum("not felt" in what for what in named) == 2 * len(BodyKind)
    assert sum("pain" in what for what in named) == 2 * len(BodyKind)


def test_answers_raise_of_whom_it_was_measured_that_they_feel_less_in_use() -> None:
    """Nobody of a finger that feels alike all the time; on one that adapts, most."""
    manner, (seed,) = Manner(), TESTED
    raises = {
        body: [felt_adaptation.measured(body, seed, manner, it).raises for it in range(4)]
        for body in (BodyKind.INDIFFERENT, BodyKind.ADAPTING)
    }
    assert raises[BodyKind.INDIFFERENT] == [None] * 4
    adapting = [it for it in raises[BodyKind.ADAPTING] if it is not None]
    assert len(adapting) >= 3
    assert all(it.fades_a_minute > 0.02 for it in adapting)
    adapts = said_by(BodyKind.ADAPTING, seed, manner, 3.0, 0)
    assert adapts.may_raise
    assert adapts.raising is not None
    assert adapts.raising.figures != adapts.ships.figures
    stays = said_by(BodyKind.INDIFFERENT, seed, manner, 3.0, 0)
    assert not stays.may_raise


def test_what_the_measurement_took_down_is_what_is_played_after_it() -> None:
    """With and without answers: levels that were too strong on that day are gone for good."""
    manner, (seed,) = Manner(), TESTED
    for body in (BodyKind.INDIFFERENT, BodyKind.SOAKING):
        calibrated = finger_of(body, seed).calibration.electrode
        levels = felt_adaptation.measured(body, seed, manner, 0).levels
        pairs = list(zip(levels, calibrated, strict=True))
        assert all(left.comfortable_ua <= before.comfortable_ua for left, before in pairs)
        is_lower = levels != calibrated
        assert is_lower == (body is BodyKind.SOAKING)
        plain, plain_after = unsaid(body, seed, manner, 1.0)
        said = said_by(body, seed, manner, 1.0, 0)
        assert said.raising is not None
        assert (plain_after.figures == plain.figures) != is_lower
        assert (said.raising.figures == said.ships.figures) != is_lower
        if is_lower:
            assert plain_after.figures.mean_felt < plain.figures.mean_felt


def test_it_is_asked_of_the_same_finger_on_another_day_than_it_is_played() -> None:
    """Asked on the minutes that are judged, it would earn what they need."""
    (seed,) = TESTED
    played, asked_of = finger_of(BodyKind.BENT, seed), another_day(BodyKind.BENT, seed)
    played.course.begin(0.0)

    def own_area(body: LivingBody) -> Floats:
        now = body.skin.course.at(0.0)
        body.skin.refresh(0.0)
        return body.skin.gain / (now.area * now.sweat_gain)

    assert own_area(asked_of) == pytest.approx(own_area(played.body))
    assert asked_of.skin.figures == played.body.skin.figures
    minutes_s = range(0, 600, 5)
    before_s = played.pieces.starts_s[0]
    pressed = [
        [course.pressure_kpa(from_s + t_s) for t_s in minutes_s]
        for course, from_s in ((played.course, 0.0), (asked_of.skin.course, before_s))
    ]
    assert abs(correlation(*pressed)) < 0.5


def harmed(body: BodyKind, plain: Figures, said: Figures, *, may_raise: bool = True) -> Compared:
    return Compared(body, may_raise, said, plain, 1.0, 1.0, EACH_ITS_OWN)


@pytest.mark.parametrize("body", BodyKind)
def test_what_is_not_felt_has_a_bound(body: BodyKind) -> None:
    plain = replace(PLAIN, not_felt=0.1)
    for not_felt, is_met in ((0.119, True), (0.121, False)):
        found = [harmed(body, plain, replace(plain, not_felt=not_felt), may_raise=False)]
        held = [bound.is_met for bound in felt_harm.bounds(found) if "not felt" in bound.what]
        assert held == [is_met]


@pytest.mark.parametrize("body", BodyKind)
def test_nothing_is_above_pain_where_nothing_was_not_even_on_an_excluded_body(
    body: BodyKind,
) -> None:
    held = felt_harm.bounds([harmed(body, PLAIN, replace(PLAIN, scans_above_pain=1.0))])
    assert [bound.is_met for bound in held if "pain" in bound.what] == [False]
    assert felt_harm.excluded([harmed(body, PLAIN, replace(PLAIN, scans_above_pain=1.0))]) == []


@pytest.mark.parametrize("body", BodyKind)
def test_more_above_pain_is_out_of_bounds_or_an_exclusion_that_is_said(body: BodyKind) -> None:
    plain = replace(PLAIN, scans_above_pain=100.0)
    for count, is_in in ((119.0, True), (121.0, False)):
        found = [harmed(body, plain, replace(plain, scans_above_pain=count))]
        held = [bound.is_met for bound in felt_harm.bounds(found) if "pain" in bound.what]
        said = felt_harm.excluded(found)
        assert held == [is_in or body in felt_harm.EXCLUDED]
        assert len(said) == (body in felt_harm.EXCLUDED and not is_in)
        assert all(f"{body} is excluded" in each for each in said)


@pytest.mark.parametrize("body", felt_harm.EXCLUDED)
def test_an_exclusion_has_a_bound_of_its_own(body: BodyKind) -> None:
    plain = replace(PLAIN, scans_above_pain=100.0)
    most = felt_harm.EXCLUDED[body].most_times
    assert most > 1.2
    for times, is_met in ((0.99 * most, True), (1.01 * most, False)):
        found = [harmed(body, plain, replace(plain, scans_above_pain=100.0 * times))]
        held = [bound.is_met for bound in felt_harm.bounds(found) if "pain" in bound.what]
        assert held == [is_met]


@pytest.mark.parametrize("body", BodyKind)
def test_what_ships_has_no_exclusion(body: BodyKind) -> None:
    plain = replace(PLAIN, scans_above_pain=100.0)
    for count, is_met in ((119.0, True), (121.0, False)):
        said = replace(plain, scans_above_pain=count)
        found = [harmed(body, plain, said, may_raise=False)]
        held = [bound.is_met for bound in felt_harm.bounds(found) if "pain" in bound.what]
        assert held == [is_met]
        assert felt_harm.excluded(found) == []


def test_the_page_names_the_excluded_bodies_beside_the_numbers() -> None:
    section = PAGE.read_text(encoding="utf-8").split("\n### What it gives and takes")[1]
    section = section.split("\n## ")[0]
    *first, last = (f"`{body}`" for body in sorted(felt_harm.EXCLUDED))
    assert f"**Excluded: {', '.join(first)} and {last}**" in section


@pytest.mark.parametrize("may_raise", [False, True])
def test_the_page_has_each_table_between_its_marks(may_raise: bool, tmp_path: Path) -> None:
    copy = tmp_path / PAGE.name
    text = PAGE.read_text(encoding="utf-8")
    copy.write_text(text, encoding="utf-8")
    of_it = f"what is not{RAISED if may_raise else ''}"
    not_met = [
        Bound(of_it, 1.2, 1.05, is_met=False),
        Bound(f"of the other{'' if may_raise else RAISED}", 1.2, 1.05, is_met=False),
    ]
    found = [made_up(1.2, SHARED, may_raise=may_raise)]
    felt_docs.write(copy, found, "a run that was not made", not_met)
    begin = felt_docs.RAISING_BEGIN if may_raise else felt_docs.BEGIN
    before, _, rest = copy.read_text(encoding="utf-8").partition(begin)
    part, _, after = rest.partition(felt_docs.END)
    assert "A run that was not made" in part
    assert "| variation, times that without answers | **1.20** |" in part
    assert "| the worst person | **1.20** |" in part
    assert f"- Not met: {of_it}: 1.2 (bound 1.05)." in part
    assert "of the other" not in part
    assert text.startswith(before)
    assert text.endswith(after)
    assert after


# --- whom it serves ------------------------------------------------------------------------------


def test_the_fingers_of_the_page_are_not_those_that_are_looked_at() -> None:
    judged = (*FELT, *FELT_COMMON, *STEADY)
    assert not set(judged) & LOOKED_AT
    assert len(set(judged)) == len(judged)
    assert set(TESTED) <= LOOKED_AT


def test_who_is_always_right_is_not_served_worse() -> None:
    """On the body where the drift is common to all."""
    (seed,) = TESTED
    right = play(BodyKind.ADAPTING, seed, Manner(right=1.0)).figures
    erring = play(BodyKind.ADAPTING, seed, Manner()).figures
    assert right.over_time <= 1.1 * erring.over_time


def calibrated_alone(kind: BodyKind, seed: int) -> Calibration:
    loaded = fake_config(electrodes=ELECTRODES)
    return steady_skin.calibrated(seed, loaded.board, loaded.array, kind)


def test_who_insists_has_it_too_strong_for_less_of_the_time() -> None:
    """On a finger whose neighbors add, and whose array was never felt all together."""
    (seed,) = TESTED
    alone = calibrated_alone(BodyKind.SUMMING, seed)

    def too_strong(manner: Manner) -> float:
        finger = finger_of(BodyKind.SUMMING, seed)
        finger = replace(finger, calibration=alone, among=np.ones(ELECTRODES))
        _, times = scans(finger, Said(Person(manner, seed), raises=None))
        return float(np.mean([Person(manner, seed).judges(it) == "too_strong" for it in times]))

    assert too_strong(Manner(right=1.0, insists=True)) < 0.7 * too_strong(Manner(right=1.0))


def with_a_law(body: BodyKind, times: float, off_min: float | None) -> WithLaw:
    plain = SteadyFigures(NONE, 2.0, 0.1, 0.1, 0.05, 0.0, 0, 0, 0.9, None, None, 0, 0, 0, 0, 1_000)
    alone = replace(plain, over_time=times * plain.over_time)
    return WithLaw(body, "energy", 1, plain, alone, alone, off_min, of_each=False)


@pytest.mark.parametrize("body", BodyKind)
def test_a_law_that_does_harm_is_given_up_or_it_is_known_not_to_be_told(body: BodyKind) -> None:
    assert with_a_law(body, 1.19, None).is_held
    assert with_a_law(body, 1.21, 6.0).is_held
    unheeded = with_a_law(body, 1.21, None)
    assert unheeded.is_held == (body in UNTOLD)
    assert ("NOT MET" in unheeded.verdict) == (body not in UNTOLD)


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
    (seed,) = TESTED
    _, times = scans(finger_of(BodyKind.INDIFFERENT, seed, 3.0), Unsaid())
    assert np.median(times) == pytest.approx(1.0, abs=0.05)


def test_who_feels_the_whole_array_takes_down_what_neighbors_add() -> None:
    """Where they add nothing, the levels stay as each electrode has them."""
    (seed,) = TESTED
    taken = {}
    for kind in (BodyKind.SUMMING, BodyKind.INDIFFERENT):
        alone = calibrated_alone(kind, seed)
        both = zip(finger_of(kind, seed).calibration.electrode, alone.electrode, strict=True)
        taken[kind] = [one.comfortable_ua / other.comfortable_ua for one, other in both]
    assert taken[BodyKind.INDIFFERENT] == [1.0] * ELECTRODES
    assert 0.7 < np.median(taken[BodyKind.SUMMING]) < 0.9


def test_what_is_wanted_is_what_was_felt_among_neighbors() -> None:
    (seed,) = TESTED
    for kind, most in ((BodyKind.SUMMING, 1.6), (BodyKind.INDIFFERENT, 1.1)):
        finger = finger_of(kind, seed)
        alone = wanted_alone(finger)
        times = wanted_of(finger)[alone > 0.0] / alone[alone > 0.0]
        assert times.max() < most
        assert (np.median(times) > 1.3) == (kind is BodyKind.SUMMING)


def test_only_what_was_wanted_is_compared() -> None:
    assert times_wanted(np.array([[2.0, 5.0], [1.0, 5.0]]), np.array([1.5, 0.0])) == 1.0


def test_with_a_law_the_answers_reach_the_engine() -> None:
    """Who says nothing but too strong, again and again, gets less from what the law leaves."""
    (seed,) = TESTED
    manner = Manner(right=0.0, errs="too_strong", insists=True)
    found = with_law(BodyKind.INDIFFERENT, "energy", seed, manner, 1.5)
    assert found.said.mean_felt < 0.97 * found.alone.mean_felt
    assert found.off_min is None, "energy changes hardly anything, so nothing counts against it"


def test_who_is_asked_about_each_answers_for_that_one() -> None:
    (seed,) = TESTED
    manner = Manner(right=0.0, errs="too_strong")
    found = with_law(BodyKind.INDIFFERENT, "energy", seed, manner, 2.5, of_each=True)
    part = found.said.mean_felt / found.alone.mean_felt
    assert 0.97 < part < 0.999, "two of eight electrodes, 5 % each"
