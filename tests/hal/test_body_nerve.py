"""The membrane's exact solution against small steps, and the quick reckoning against it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etd_body.membrane import NerveConstants, least_height, minimum, simplified_response
from etd_body.nerve import (
    KINDS,
    NOMINAL_RADIUS_MM,
    PAIN_PARALLEL,
    RADII_MM,
    SITES,
    TAU_US,
    THRESHOLD_MV,
    TOUCH_PARALLEL,
    FibreKind,
    Nerves,
    NerveSpread,
    disk_potential,
)
from etd_body.tissue import activating_function, disk_mm, potential_per_ua, ring_mm

PLACES = [(2.5 * (i % 3), 2.5 * (i // 3)) for i in range(9)]
MIDDLE = 4
NO_SPREAD = NerveSpread(depth_sigma=0.0, threshold_sigma=0.0)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_membranes_modes_are_what_small_steps_come_to(kind: FibreKind) -> None:
    """Equation 7, stepped by Euler's method at 0.05 us."""
    constants = NerveConstants.of_diameter(kind.diameter_um)
    size = np.ones(kind.nodes)
    if kind.is_vertical:
        size[0] = kind.ending
    outside_mv = disk_potential(kind.line_mm(), NOMINAL_RADIUS_MM) * 1_000.0
    drive = outside_mv @ kind.drive_per_mv()
    volts = np.zeros(kind.nodes)
    for _ in range(2_000):
        along = np.diff(np.concatenate([volts[:1], volts, volts[-1:]]), n=2)
        change = constants.inside_us * along - constants.membrane_us * size * volts + drive
        volts += 0.05 * change / (constants.capacitance_pf * size)
    exact = kind.membrane().step_response(drive, 100.0)
    assert np.allclose(exact, volts, rtol=0.005, atol=0.002 * np.abs(volts).max())


def test_the_simplified_nerve_is_equation_14() -> None:
    nerve = NerveConstants(0.02, 0.01, 6.0)
    expected = (0.02 / 0.03) * (1.0 - np.exp(-0.03 / 6.0 * 100.0)) * 50.0
    assert simplified_response(nerve, 50.0, 100.0) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", [TOUCH_PARALLEL, PAIN_PARALLEL], ids=lambda kind: kind.name)
def test_the_fakes_own_fibres_have_the_thresholds_of_equations_16_and_17(kind: FibreKind) -> None:
    """Driven by a wave of six nodes, whose second difference is minus itself, each node is the
    nerve of Figure 5: what its neighbors take from it is what G_a to ground would.
    """
    fibre = replace(kind, nodes=24)
    nerve = NerveConstants.of_diameter(kind.diameter_um)
    wave = np.cos(np.pi / 3.0 * (np.arange(fibre.nodes) + 0.5))
    drive = -nerve.inside_us * fibre.second_difference() @ wave
    top = int(wave.argmax())
    rheobase_mv = THRESHOLD_MV * (nerve.inside_us + nerve.membrane_us) / nerve.inside_us
    rate = (nerve.inside_us + nerve.membrane_us) / nerve.capacitance_pf
    for width_us in (20.0, 50.0, 100.0, 200.0, 1_000.0):
        grown = float(fibre.membrane().step_response(drive, width_us)[top] / wave[top])
        by_formula_mv = rheobase_mv / (1.0 - np.exp(-rate * width_us))
        assert least_height(grown, THRESHOLD_MV) == pytest.approx(by_formula_mv, rel=1e-6)
    at_last = float(fibre.membrane().final(drive)[top] / wave[top])
    assert least_height(at_last, THRESHOLD_MV) == pytest.approx(rheobase_mv, rel=1e-6)


@pytest.mark.parametrize("width_us", [20, 30, 50, 100, 150, 200])
@pytest.mark.parametrize("way", [1.0, -1.0], ids=["anodic", "cathodic"])
@pytest.mark.parametrize("index", range(len(KINDS)), ids=[kind.name for kind in KINDS])
def test_a_few_exponentials_say_what_all_modes_do(index: int, way: float, width_us: int) -> None:
    """Where a fibre is driven at all: within 2 percent of its most depolarized node."""
    kind = KINDS[index]
    nerves = Nerves(PLACES, seed=1, spread=NO_SPREAD)
    drive = disk_potential(kind.line_mm(), NOMINAL_RADIUS_MM) @ kind.drive_per_mv()
    exact = float(kind.membrane().step_response(way * drive, width_us).max())
    at = int(np.argmin(np.abs(RADII_MM - NOMINAL_RADIUS_MM)))
    rows = slice(index * SITES, (index + 1) * SITES)
    grown = -np.expm1(-width_us / TAU_US) @ nerves.own[MIDDLE, at][:, rows]
    assert float((way * grown).max()) * THRESHOLD_MV == pytest.approx(exact, rel=0.02)


def test_another_electrode_acts_on_a_fibre_as_a_point_does() -> None:
    kind = KINDS[0]
    nerves = Nerves(PLACES, seed=1, spread=NO_SPREAD)
    beside_mv = potential_per_ua(kind.line_mm(), np.array([[2.5, 0.0]]))[:, 0]
    volts = kind.membrane().step_response(beside_mv @ kind.drive_per_mv(), 100.0) / THRESHOLD_MV
    grown = -np.expm1(-100.0 / TAU_US)
    found = grown @ nerves.everywhere[MIDDLE + 1, :, :SITES, MIDDLE]
    for entry in found:
        assert np.abs(volts - entry).min() < 0.02 * np.abs(volts).max()


def test_what_lies_deeper_is_driven_less() -> None:
    deep = NerveSpread(depth_sigma=0.0, threshold_sigma=0.0, extra_depth_mm=0.5)
    shallow, deeper = (
        Nerves(PLACES, seed=1, spread=nerve_spread).own for nerve_spread in (NO_SPREAD, deep)
    )
    grown = -np.expm1(-100.0 / TAU_US)
    by_kind = [np.einsum("t,etk->ek", grown, one[:, 5]).max(axis=1) for one in (shallow, deeper)]
    assert (by_kind[1] < 0.7 * by_kind[0]).all()


def test_a_wide_way_in_acts_less_on_shallow_fibres_than_a_narrow_one() -> None:
    nerves = Nerves(PLACES, seed=1, spread=NO_SPREAD)
    grown = -np.expm1(-100.0 / TAU_US)
    touch, pain = (grown @ nerves.own[MIDDLE, :, :, row].T for row in (0, 2 * SITES))
    assert (np.diff(touch) < 0.0).all()
    assert (np.diff(pain) < 0.0).all()
    assert pain[0] / pain[-1] > 1.3 * touch[0] / touch[-1]


def test_a_disk_is_felt_on_its_axis_as_the_integral_over_it_says() -> None:
    """Of rho I / 2 pi r over an even disk: rho I / pi a2 (sqrt(a2 + z2) - z)."""
    line = np.array([[0.0, 0.0, z] for z in (0.5, 0.8, 1.5)])
    point = potential_per_ua(line, np.zeros((1, 2)))[:, 0]
    found = potential_per_ua(line, disk_mm(0.5, 400)).mean(axis=-1)
    z = line[:, 2]
    expected = point * z * 2.0 / 0.25 * (np.sqrt(0.25 + z**2) - z)
    assert found == pytest.approx(expected, rel=0.005)


def test_the_ring_and_the_middle_of_a_concentric_electrode_cancel_far_away() -> None:
    line = np.array([[x, 0.0, 30.0] for x in (-0.1, 0.0, 0.1)])
    sources = np.concatenate([np.zeros((1, 2)), ring_mm(1.0)])
    both = np.concatenate([[-1_000.0], np.full(24, 1_000.0 / 24)])
    alone = activating_function(line, sources[:1], both[:1])
    assert abs(activating_function(line, sources, both)[0]) < 0.01 * abs(alone[0])


def test_the_least_of_a_function_is_found() -> None:
    assert minimum(lambda x: (x - 3.0) ** 2, 0.1, 10.0) == pytest.approx(3.0, abs=1e-4)
