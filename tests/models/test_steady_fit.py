"""The fits that the benchmark's laws stand on: what they find, and what they leave out."""

from __future__ import annotations

import numpy as np
import pytest

from bench.steady_fit import fit_of
from bench.steady_skin import WIDTH_US


def test_a_law_is_found_again_and_what_lies_at_the_ends_is_counted() -> None:
    ratio = np.geomspace(0.5, 2.0, 9)
    width_us = WIDTH_US * ratio**-0.8
    width_us[[0, 7, 8]] = np.exp(np.log([200.0, 35.0, 35.0]))
    ratio[0] = 0.5**1.25
    charge, energy = 1.0 - 0.3 * (ratio - 1.0), 1.0 + 0.2 * (ratio - 1.0)
    found = fit_of(ratio, width_us, charge, energy)
    assert (found.samples, found.left_out, found.at_widest) == (7, 2, 1)
    assert found.k == pytest.approx(0.8)
    assert (found.charge_slope, found.energy_slope) == pytest.approx((-0.3, 0.2))
    assert found.r_squared == pytest.approx(1.0)
