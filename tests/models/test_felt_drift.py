"""Whether a drift is common to all electrodes: the split, on courses that are made up and a finger.

Owns: which part of a variance is called what. Must not know: which body has which.
"""

from __future__ import annotations

import numpy as np
import pytest

from bench.felt_drift import course, drift, mean_of, parts
from bench.fresh_seeds import TESTED
from etd_body.kinds import BodyKind

TEN_MINUTES = np.arange(750)
MINUTE_OF = TEN_MINUTES * 10 // 750


def parts_of(deviation: np.ndarray) -> tuple[float, float, float]:
    deviation = deviation - np.nanmean(deviation, axis=0)
    return parts(deviation, course(deviation, TEN_MINUTES), course(deviation, MINUTE_OF))


def test_what_moves_all_alike_for_minutes_is_drift() -> None:
    falling = np.repeat(np.linspace(0.5, -0.5, 10), 75)
    assert parts_of(np.tile(falling[:, None], 8)) == pytest.approx((1.0, 0.0, 0.0))


def test_what_moves_all_alike_for_a_moment_is_none() -> None:
    pressing = np.random.default_rng(1).normal(size=750)
    drifting, moments, own = parts_of(np.tile(pressing[:, None], 8))
    assert drifting < 0.05
    assert (moments, own) == pytest.approx((1.0 - drifting, 0.0))


def test_what_each_electrode_does_alone_is_its_own_however_slow() -> None:
    """Of eight that have nothing in common an eighth looks common."""
    chance = np.random.default_rng(2)
    slow = np.repeat(chance.normal(size=(10, 400)), 75, axis=0)
    drifting, moments, own = parts_of(slow)
    assert own > 0.99
    assert drifting == pytest.approx(1.0 - own)
    assert moments == pytest.approx(0.0, abs=1e-9)


def test_a_contact_that_is_off_says_nothing() -> None:
    falling = np.tile(np.repeat(np.linspace(0.5, -0.5, 10), 75)[:, None], 8)
    falling[100:200, 3] = np.nan
    drifting, _, own = parts_of(falling)
    assert drifting > 0.98
    assert own < 0.02


def test_taking_what_is_common_leaves_less() -> None:
    (seed,) = TESTED
    found = drift(BodyKind.ADAPTING, seed)
    assert found.left_moments < found.left_minutes < found.left_at_most < 1.0


def test_of_several_fingers_it_is_the_mean() -> None:
    (seed,) = TESTED
    one, other = (drift(BodyKind.INDIFFERENT, number, 2.0) for number in (seed, seed + 1))
    assert mean_of([one, other]).own == pytest.approx((one.own + other.own) / 2.0)
