"""What the benchmark of steadiness counts, on scans written down by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.steady_figures import figures
from bench.steady_run import Kept
from bench.steady_skin import BEFORE_S, FIRST_S, PIECE_S, SETTLING_S, Pieces, pieces_of, whole_of
from etd_body.course import Course, Script

SCANS = 41
PERIOD_S = 0.1


def kept(
    felt: list[list[float]],
    *,
    pain: list[list[float]] | None = None,
    attached: list[list[float]] | None = None,
) -> Kept:
    """One piece, a scan each tenth of a second."""
    strengths = np.array(felt)
    count = len(strengths)
    times = np.array([PERIOD_S * scan for scan in range(count)], dtype=np.float64)
    return Kept(
        felt=strengths,
        pain=np.zeros(strengths.shape) if pain is None else np.array(pain),
        attached=np.ones(strengths.shape) if attached is None else np.array(attached),
        piece=np.zeros(count),
        inside_s=times,
        body_s=times,
        counters={},
    )


def test_variation_over_time_and_over_electrodes_are_told_apart() -> None:
    apart = figures("x", [kept([[1.0, 3.0]] * SCANS)])
    assert apart.over_time == 0.0
    assert apart.over_electrodes == pytest.approx(0.5)
    swinging = figures("x", [kept([[1.0, 1.0], [3.0, 3.0]] * 20)])
    assert swinging.over_time == pytest.approx(0.5)
    assert swinging.over_electrodes == 0.0


def test_where_nothing_is_ever_felt_there_is_no_variation() -> None:
    found = figures("x", [kept([[0.0, 0.0]] * SCANS)])
    assert math.isnan(found.over_time)
    assert math.isnan(found.over_electrodes)
    assert found.below_threshold == 1.0


def test_what_is_not_felt_counts_only_where_there_is_contact() -> None:
    felt = [[2.0, 0.0]] * SCANS
    assert figures("x", [kept(felt)]).below_threshold == pytest.approx(0.5)
    off = [[1.0, 0.0]] * SCANS
    assert figures("x", [kept(felt, attached=off)]).below_threshold == 0.0


def test_pain_is_counted_from_one_on_and_told_apart_where_the_contact_is_firm() -> None:
    pain = [[0.99, 0.0]] * (SCANS - 2) + [[1.0, 0.0], [0.0, 1.2]]
    attached = [[1.0, 1.0]] * (SCANS - 1) + [[1.0, 0.4]]
    found = figures("x", [kept([[2.0, 2.0]] * SCANS, pain=pain, attached=attached)])
    assert found.scans_above_pain == 2
    assert found.firm_scans_above_pain == 1
    assert found.most_pain == 1.2


def test_a_step_is_the_most_felt_just_after_touching_over_the_steady_strength() -> None:
    attached = [[1.0]] * 40 + [[0.0]] * 5 + [[1.0]] * 31
    felt = [[2.0]] * 40 + [[0.0]] * 5 + [[1.0], [3.0]] + [[2.0]] * 29
    found = figures("x", [kept(felt, attached=attached)])
    assert (found.recontacts, found.recontacts_not_judged) == (1, 0)
    assert found.recontact_step == pytest.approx(1.5)


def test_what_is_felt_later_than_just_after_touching_is_no_step() -> None:
    attached = [[1.0]] * 40 + [[0.0]] * 5 + [[1.0]] * 31
    felt = [[2.0]] * 40 + [[0.0]] * 5 + [[1.0]] * 32 + [[3.0]] + [[2.0]] * 21
    found = figures("x", [kept(felt, attached=[*attached, *[[1.0]] * 23])])
    assert found.recontact_step == pytest.approx(0.5)
    assert (found.recontacts_above, found.recontacts_above_later) == (0, 1)
    early = [[2.0]] * 40 + [[0.0]] * 5 + [[1.0]] * 28 + [[3.0]] + [[2.0]] * 25
    found = figures("x", [kept(early, attached=[*attached, *[[1.0]] * 23])])
    assert found.recontact_step == pytest.approx(1.5)
    assert found.recontacts_above == 1


def test_what_is_felt_as_the_contact_comes_off_anew_is_no_step_of_the_return() -> None:
    attached = [[1.0]] * 40 + [[0.0]] * 5 + [[1.0]] * 35 + [[0.3]] + [[0.0]] * 5 + [[1.0]] * 20
    felt = [[2.0]] * 79 + [[9.0]] * 2 + [[2.0]] * 25
    found = figures("x", [kept(felt, attached=attached)])
    assert found.recontact_step == pytest.approx(1.0)
    soon = [[1.0]] * 40 + [[0.0]] * 5 + [[1.0]] * 20 + [[0.3]] + [[0.0]] * 5 + [[1.0]] * 35
    felt = [[2.0]] * 64 + [[9.0]] * 2 + [[2.0]] * 40
    found = figures("x", [kept(felt, attached=soon)])
    assert found.recontact_step == pytest.approx(1.0)


def test_a_return_without_a_steady_strength_on_either_side_is_not_judged() -> None:
    for before, after in ((15, 41), (40, 25)):
        attached = [[1.0]] * before + [[0.0]] * 5 + [[1.0]] * after
        found = figures("x", [kept([[2.0]] * (before + 5 + after), attached=attached)])
        assert (found.recontacts, found.recontacts_not_judged) == (0, 1)
        assert found.recontact_step is None


def test_a_return_of_an_electrode_that_is_never_felt_is_counted_and_not_judged() -> None:
    attached = [[1.0, 1.0]] * 40 + [[0.0, 0.0]] * 5 + [[1.0, 1.0]] * 31
    found = figures("x", [kept([[2.0, 0.0]] * 76, attached=attached)] * 2)
    assert (found.recontacts, found.recontacts_not_judged) == (2, 2)


def test_the_steady_strength_is_of_scans_in_which_something_was_felt() -> None:
    attached = [[1.0]] * 40 + [[0.0]] * 5 + [[1.0]] * 31
    felt = [[0.0]] * 45 + [[1.1]] * 3 + [[0.0], [0.0], [1.1], [0.0]] * 7
    found = figures("x", [kept(felt, attached=attached)])
    assert found.recontact_step == pytest.approx(1.0)


def test_pieces_run_from_a_moment_before_each_peeling_and_hold_the_skin_before_that() -> None:
    pieces = Pieces((10.0, 300.0))
    assert pieces.at(SETTLING_S / 2)[0] == 10.0
    assert pieces.at(SETTLING_S + 1.0) == pytest.approx((11.0, 1.0))
    assert pieces.at(SETTLING_S + PIECE_S + 0.1)[0] == 300.0
    course = Course(Script(peels_per_min=6.0), [(0.0, 0.0), (5.0, 0.0), (0.0, 5.0)], seed=3)
    for start_s in pieces_of(course, 60.0, 3).starts_s:
        assert course.at(start_s).area.min() == 1.0
        assert course.at(start_s + BEFORE_S + 0.02).area.min() < 1.0


def test_the_whole_is_one_piece_from_the_first_peeling_on() -> None:
    course = Course(Script(peels_per_min=6.0), [(0.0, 0.0), (5.0, 0.0), (0.0, 5.0)], seed=3)
    whole = whole_of(course, 60.0, FIRST_S)
    assert whole.starts_s == pieces_of(course, 60.0, 3).starts_s[:1]
    at_s = [whole.at(elapsed_s)[0] for elapsed_s in (0.0, SETTLING_S, whole.engine_s - 1e-6)]
    assert at_s == pytest.approx([whole.starts_s[0], whole.starts_s[0], whole.starts_s[0] + 60.0])
    assert [whole.at(SETTLING_S + value)[1] for value in (1.0, 40.0)] == pytest.approx([1.0, 40.0])
