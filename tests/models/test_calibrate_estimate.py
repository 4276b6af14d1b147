"""Where a threshold lies, by the answers: whatever the share of false alarms and lapses."""

from __future__ import annotations

import random
from math import exp

import pytest

from etd.calibrate.answers import Answer
from etd.calibrate.estimate import ThresholdEstimate
from etd.calibrate.reach import LEAST_UA, Reach
from etd.calibrate.staircase import staircase
from etd.calibrate.trial import Unsettled, run


def staircases(guess: float, lapse: float, moves: float = 0.0, count: int = 40) -> list[float]:
    """By how much each is off the threshold of its end, as a part of it."""
    errors = []
    for seed in range(count):
        chance = random.Random(seed)
        at = [chance.uniform(300.0, 2_000.0)]

        def present(
            current_ua: int, chance: random.Random = chance, at: list[float] = at
        ) -> Answer:
            at[0] *= exp(chance.gauss(0.0, moves))
            if current_ua * exp(chance.gauss(0.0, 0.05)) < at[0]:
                return "felt" if chance.random() < guess else "not_felt"
            return "not_felt" if chance.random() < lapse else "felt"

        found = run(staircase(200), Reach(10_000, 200), present)
        assert found.is_felt
        errors.append(abs(found.current_ua / at[0] - 1.0))
    return sorted(errors)


@pytest.mark.parametrize(
    ("guess", "lapse", "moves"),
    [(0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.25, 0.08, 0.0), (0.0, 0.0, 0.01), (0.15, 0.05, 0.01)],
)
def test_a_staircase_finds_it_whatever_the_false_alarms(
    guess: float, lapse: float, moves: float
) -> None:
    errors = staircases(guess, lapse, moves)
    assert errors[20] < 0.05
    assert errors[35] < 0.15


def test_false_alarms_far_below_do_not_hold_it_there() -> None:
    estimate = ThresholdEstimate()
    for current_ua, is_felt in ((300, True), (300, False), (330, True), (330, False), (400, False)):
        estimate.update(current_ua, is_felt=is_felt)
    early = estimate.spread
    for current_ua in (500, 700, 900, 990) * 2:
        estimate.update(current_ua, is_felt=current_ua >= 900)
    assert 650 < estimate.threshold_ua < 950
    assert estimate.spread < early
    assert estimate.above(600) > 0.9 > 0.1 > estimate.above(1_100)


def test_it_follows_a_threshold_that_moves() -> None:
    estimate = ThresholdEstimate()
    for threshold_ua in (500.0, 700.0):
        for _ in range(30):
            for times in (0.85, 0.95, 1.05, 1.15):
                estimate.update(threshold_ua * times, is_felt=times > 1.0)
        assert estimate.threshold_ua == pytest.approx(threshold_ua, rel=0.05)


@pytest.mark.parametrize("answer", ["felt", "comfortable"])
def test_where_even_the_least_current_is_felt_nothing_is_found(answer: Answer) -> None:
    presented: list[int] = []

    def present(current_ua: int) -> Answer:
        presented.append(current_ua)
        return answer

    with pytest.raises(Unsettled):
        run(staircase(200), Reach(3_000, 200), present)
    assert min(presented) == LEAST_UA
