"""The estimate of how much stronger or weaker it is wanted, of answers that may be wrong."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest
import scipy.stats
from hypothesis import example, given
from hypothesis import strategies as st

from etd.stabilize.offset_estimate import Answer, OffsetEstimate, likelihood
from etd_body.tissue import Floats

MINUTE = 60_000_000_000


def test_what_was_said_is_forgotten_in_the_estimate() -> None:
    estimate = OffsetEstimate()
    for minute in range(5):
        estimate.hear("too_weak", 0.0, minute * MINUTE)
    soon, late = estimate.mean(5 * MINUTE), estimate.mean(60 * MINUTE)
    assert soon > 0.1
    assert 0.0 < late < 0.01


@given(st.lists(st.tuples(st.sampled_from(get_args(Answer)), st.integers(0, 20 * MINUTE))))
def test_too_strong_never_raises_the_estimate_and_too_weak_never_lowers_it(
    said: list[tuple[Answer, int]],
) -> None:
    estimate, now_ns = OffsetEstimate(), 0
    for answer, after_ns in said:
        now_ns += after_ns
        before = estimate.mean(now_ns)
        estimate.hear(answer, 0.0, now_ns)
        change = estimate.mean(now_ns) - before
        assert {"too_strong": change <= 1e-9, "too_weak": change >= -1e-9, "good": True}[answer]


#: The figures of the model, once more and by other formulas: a chance of 0.7 that the strength is
#: within 0.05 of what was calibrated, else 0.35; good within 0.15, with edges of 0.05; four of five
#: answers right, the others alike; all forgotten within ten minutes.
GRID = np.linspace(-1.3, 1.3, 53)


def density(sigma: float) -> Floats:
    found = scipy.stats.norm.pdf(GRID, scale=sigma)
    return np.asarray(found / found.sum())


PRIOR = 0.7 * density(0.05) + 0.3 * density(0.35)


def chance(answer: Answer, offset: float) -> Floats:
    """That it is said of a strength at this offset, for each that may be wanted."""
    above = offset - GRID
    strong = 1.0 / (1.0 + np.exp(-(above - 0.15) / 0.05))
    weak = 1.0 / (1.0 + np.exp((above + 0.15) / 0.05))
    right = {"too_strong": strong, "too_weak": weak, "good": 1.0 - strong - weak}[answer]
    return np.asarray(0.8 * right + 0.1 * (1.0 - right))


offsets = st.one_of(st.floats(-0.9, 0.2), st.sampled_from([0.0, 0.05, -0.15]))


@given(
    st.lists(
        st.tuples(st.sampled_from(get_args(Answer)), offsets, st.integers(0, 20 * MINUTE)),
        max_size=6,
    ),
    st.integers(0, 5 * MINUTE),
)
@example([("too_weak", 0.0, MINUTE), ("good", 0.05, 10 * MINUTE)], MINUTE)
@example([("too_strong", 0.05, 0), ("too_strong", -0.15, MINUTE)], 0)
def test_it_is_what_bayes_theorem_says_of_these_answers(
    said: list[tuple[Answer, float, int]], later_ns: int
) -> None:
    estimate, now_ns = OffsetEstimate(), 7_000 * MINUTE
    believed, mean, said_ns = PRIOR, 0.0, now_ns
    for answer, offset, after_ns in said:
        now_ns += after_ns
        kept = np.exp(-(now_ns - said_ns) / 600e9)
        believed = (kept * believed + (1.0 - kept) * PRIOR) * chance(answer, offset)
        believed = believed / believed.sum()
        mean, said_ns = float(believed @ GRID), now_ns
        estimate.hear(answer, offset, now_ns)
        assert estimate.mean(now_ns) == pytest.approx(mean, abs=1e-9)
    # Before anything was said there is nothing to be forgotten.
    expected = mean * np.exp(-later_ns / 600e9) if said else 0.0
    assert estimate.mean(now_ns + later_ns) == pytest.approx(expected, abs=1e-9)


@given(
    answer=st.sampled_from(get_args(Answer)),
    offset=st.floats(-60.0, 60.0),
    minutes=st.integers(0, 30),
)
def test_it_goes_by_the_likelihood_of_the_answer(
    answer: Answer, offset: float, minutes: int
) -> None:
    """Against the plain form of the same: the mean after one word, and after another."""
    estimate, now_ns = OffsetEstimate(), minutes * 60_000_000_000
    wanted = [number * 0.05 for number in range(-26, 27)]
    near, far = ([math.exp(-0.5 * (one / sigma) ** 2) for one in wanted] for sigma in (0.05, 0.35))
    prior = [0.7 * a / sum(near) + 0.3 * b / sum(far) for a, b in zip(near, far, strict=True)]
    weights = prior
    for told_ns in (0, now_ns):
        estimate.hear(answer, offset, told_ns)
        kept = math.exp(-told_ns / 600e9)
        weights = [
            (kept * weight + (1.0 - kept) * before) * likelihood(answer, offset - one)
            for weight, before, one in zip(weights, prior, wanted, strict=True)
        ]
        total = sum(weights)
        weights = [weight / total for weight in weights]
        mean = sum(weight * one for weight, one in zip(weights, wanted, strict=True))
        assert estimate.mean(told_ns) == pytest.approx(mean, abs=1e-9)


@given(offsets=st.lists(st.sampled_from([-0.3, 0.0, 0.1]), min_size=1, max_size=8))
def test_each_of_many_hears_as_it_would_alone(offsets: list[float]) -> None:
    together = [OffsetEstimate() for _ in offsets]
    answers: tuple[Answer, ...] = ("too_strong", "good", "too_weak")
    for now_ns, answer in enumerate(answers):
        OffsetEstimate.hear_each(together, answer, offsets, now_ns)
    for one, offset in zip(together, offsets, strict=True):
        alone = OffsetEstimate()
        for now_ns, answer in enumerate(answers):
            alone.hear(answer, offset, now_ns)
        assert one.mean(3) == alone.mean(3)
