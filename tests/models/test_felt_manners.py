"""Persons that the estimate was not made for, as the page shows them."""

from __future__ import annotations

import pytest

from bench.felt_compared import MOST_TIMES
from bench.felt_manners import MANNERS, PERSONS, Finger, finger, of_body, table
from bench.felt_person import Manner
from bench.fresh_seeds import TESTED
from etd_body.kinds import BodyKind


def test_each_answers_in_their_own_manner_and_the_first_as_the_estimate_supposes() -> None:
    assert next(iter(MANNERS.values())) == Manner()
    found = finger(BodyKind.INDIFFERENT, TESTED[0], 10.0)
    assert found is not None
    assert {len(persons) for persons in found.said.values()} == {PERSONS}
    assert len({tuple(persons) for persons in found.said.values()}) > len(MANNERS) / 2
    assert sum(found.said["errs with *too strong* alone"]) > sum(
        found.said["errs with *too weak* alone"]
    )


def test_what_is_above_the_bound_of_the_others_stands_out() -> None:
    """Means are of all fingers together; who has no variation is left out."""
    fingers = [
        Finger(plain, {name: [times * plain] * PERSONS for name in MANNERS})
        for plain, times in ((0.1, 1.0), (0.3, 1.04))
    ]
    held = of_body(BodyKind.AREA, [*fingers, None])
    assert held.times["as supposed"] == pytest.approx((0.1 + 1.04 * 0.3) / 0.4)
    out = of_body(BodyKind.DUCTS, [Finger(0.1, {name: [0.1, 0.1, 0.12] for name in MANNERS})])
    row = table([held, out]).splitlines()[2]
    assert row == "| as supposed | 1.03 (1.04) | **1.07** (1.20) |"
    assert out.times["as supposed"] > MOST_TIMES
