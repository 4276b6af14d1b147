"""The figures of `etd explain` and of docs/body.md, computed from the paper's equations by scipy.

Nothing that is expected here is a closed form or comes from the body's code: equations are
integrated in time, potentials over the current's way in, minima and thresholds are searched for.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from math import hypot
from pathlib import Path
from statistics import median

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

import paper_equations as paper
from etd.explain import FIGURES
from etd.explain.figure import Figure
from etd_body.course import STILL
from etd_body.living import LivingBody
from etd_body.nerve import KINDS, NOMINAL_RADIUS_MM, FibreKind, NerveSpread, disk_potential
from etd_body.sensation import Polarity
from etd_body.skin import SkinFigures

pytestmark = pytest.mark.slow

BODY = " ".join((Path(__file__).parents[2] / "docs" / "body.md").read_text("utf-8").split())
BY_KIND = {
    "touch, vertical": paper.TOUCH_VERTICAL,
    "touch, parallel": paper.TOUCH_PARALLEL,
    "pain, vertical": paper.PAIN_VERTICAL,
    "pain, parallel": paper.PAIN_PARALLEL,
}
FIBRES = {
    "touch, anodic": (paper.TOUCH_VERTICAL, 1.0),
    "touch, cathodic": (paper.TOUCH_PARALLEL, -1.0),
    "pain, anodic": (paper.PAIN_VERTICAL, 1.0),
}


@cache
def figure(name: str) -> Figure:
    return FIGURES[name]()


def told(name: str) -> dict[str, float]:
    """What `etd explain` prints under "modelled"."""
    return {check.what: check.modelled for check in figure(name).checks}


def drawn(name: str, curve: str) -> dict[float, float]:
    found = next(entry for entry in figure(name).curves if entry.name == curve)
    return dict(zip(found.x, found.y, strict=True))


def least(energy: Callable[[float], float], low_us: float, high_us: float) -> float:
    found = minimize_scalar(energy, (low_us, high_us), bounds=(low_us, high_us), method="bounded")
    return float(found.x)


@pytest.mark.parametrize("width_us", [20, 50, 100, 200, 1_000])
def test_thresholds_of_one_node_are_those_of_the_integrated_equations_9_and_10(
    width_us: int,
) -> None:
    expected = paper.step_threshold_mv(10.0, width_us)
    assert told("strength-duration")[f"threshold at {width_us} us, mV"] == pytest.approx(
        expected, rel=1e-5
    )


def test_the_rheobase_is_what_a_pulse_that_lasts_for_ever_needs() -> None:
    expected = paper.step_threshold_mv(10.0, paper.FOR_EVER_US)
    assert told("strength-duration")["rheobase, mV"] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("name", FIBRES)
def test_the_curves_of_the_fakes_fibres_are_those_of_the_integrated_equations_1_to_5(
    name: str,
) -> None:
    """At every sixth width that is drawn; the current enters evenly through a whole disk."""
    rheobase_ua = paper.fibre_threshold_ua(*FIBRES[name], paper.FOR_EVER_US / 2.0)
    for width_us, height in list(drawn("strength-duration", name).items())[::6]:
        expected = paper.fibre_threshold_ua(*FIBRES[name], width_us) / rheobase_ua
        assert height == pytest.approx(expected, rel=0.015), width_us


def test_the_least_energy_of_one_node_is_where_a_search_finds_it() -> None:
    """Equation 18, without its derivative."""
    response = paper.one_node(10.0, paper.FOR_EVER_US)
    rheobase_mv = paper.THRESHOLD_MV / response(paper.FOR_EVER_US)

    def height_mv(width_us: float) -> float:
        return paper.THRESHOLD_MV / response(width_us)

    best_us = least(lambda width_us: height_mv(width_us) ** 2 * width_us, 20.0, 2_000.0)
    twice_us = brentq(lambda width_us: height_mv(width_us) - 2.0 * rheobase_mv, 20.0, 2_000.0)
    found = told("optimal-width")
    assert found["nerve of one node: width of least energy, us"] == pytest.approx(best_us, rel=1e-3)
    assert found["height there / rheobase"] == pytest.approx(
        height_mv(best_us) / rheobase_mv, rel=1e-4
    )
    assert found["where it needs twice its rheobase, us"] == pytest.approx(twice_us, rel=1e-4)
    assert round(height_mv(best_us) / rheobase_mv, 1) == 1.4


def test_the_least_energy_of_a_hyperbola_is_where_a_search_finds_it() -> None:
    """Equations 19 and 20, with the chronaxie of the thick fibre, as the figure has."""
    found = told("optimal-width")
    d_over_c_us = found["where it needs twice its rheobase, us"]

    def energy(width_us: float) -> float:
        return (1.0 + d_over_c_us / width_us) ** 2 * width_us

    best_us = least(energy, 20.0, 2_000.0)
    assert found["spread rates: width of least energy, us"] == pytest.approx(best_us, rel=1e-3)
    assert found["height there / their rheobase"] == pytest.approx(
        1.0 + d_over_c_us / best_us, rel=1e-3
    )
    for width_us, relative in list(drawn("optimal-width", "hyperbola (eq. 20)").items())[::6]:
        assert relative == pytest.approx(energy(width_us) / energy(best_us), rel=1e-4)


def test_the_curves_of_one_node_are_those_of_the_integrated_equations() -> None:
    """Equations 16 and 18, at every eighth width that is drawn."""
    rheobase_mv = paper.step_threshold_mv(10.0, paper.FOR_EVER_US)

    def energy(width_us: float) -> float:
        return paper.step_threshold_mv(10.0, width_us) ** 2 * width_us

    least_energy = energy(least(energy, 20.0, 2_000.0))
    for width_us, height in list(drawn("strength-duration", "one node (eq. 16)").items())[::8]:
        expected = paper.step_threshold_mv(10.0, width_us) / rheobase_mv
        assert height == pytest.approx(expected, rel=1e-4), width_us
    for width_us, relative in list(drawn("optimal-width", "exponential (eq. 18)").items())[::8]:
        assert relative == pytest.approx(energy(width_us) / least_energy, rel=1e-3), width_us


def test_the_energy_of_the_touch_fibre_is_that_of_the_integrated_equations() -> None:
    _, best_us, _, _ = touch()
    least_energy = touch_needs_ua(best_us) ** 2 * best_us
    for width_us, relative in list(drawn("optimal-width", "touch, anodic").items())[::12]:
        expected = touch_needs_ua(width_us) ** 2 * width_us / least_energy
        assert relative == pytest.approx(expected, rel=0.03), width_us


def touch_needs_ua(width_us: float) -> float:
    return paper.fibre_threshold_ua(*FIBRES["touch, anodic"], width_us)


@cache
def touch() -> tuple[float, float, float, float]:
    """Of the vertical touch fibre: its rheobase in uA, the width of least energy, the height there
    over the rheobase, and its chronaxie.
    """
    needs = touch_needs_ua
    rheobase_ua = needs(paper.FOR_EVER_US / 2.0)
    best_us = least(lambda width_us: needs(width_us) ** 2 * width_us, 50.0, 1_000.0)
    twice_us = brentq(lambda width_us: needs(width_us) - 2.0 * rheobase_ua, 20.0, 2_000.0, xtol=0.1)
    return rheobase_ua, best_us, needs(best_us) / rheobase_ua, float(twice_us)


def test_the_touch_fibres_least_energy_is_where_the_figure_and_the_page_have_it() -> None:
    _, best_us, height, _ = touch()
    assert f"lies between: {height:.2f} times, at " in figure("optimal-width").says
    at_us = re.search(r"times, at (\d+) us", figure("optimal-width").says)
    assert at_us is not None
    assert float(at_us[1]) == pytest.approx(best_us, rel=0.01)
    assert f"with its optimum at {height:.2f} times its rheobase" in BODY


def test_the_width_of_a_fitted_hyperbola_costs_what_the_page_says() -> None:
    needs = touch_needs_ua
    widths_us = np.geomspace(20.0, 2_000.0, 60)
    charges = [needs(width_us) * width_us for width_us in widths_us]
    c, d = np.polyfit(widths_us, charges, 1)
    _, best_us, _, _ = touch()
    cost = needs(d / c) ** 2 * (d / c) / (needs(best_us) ** 2 * best_us)
    found = told("optimal-width")["touch, anodic: energy at its fitted d/c / least"]
    assert found == pytest.approx(cost, abs=1e-4)
    assert f"costs {100.0 * (cost - 1.0):.2f} % more than the minimum" in BODY


@pytest.mark.parametrize("diameter_um", [1.0, 2.5])
@pytest.mark.parametrize("width_us", [20, 100, 400])
def test_thin_fibres_need_as_much_more_as_the_integrated_equations_say(
    diameter_um: float, width_us: int
) -> None:
    thin, thick = (paper.step_threshold_mv(each, width_us) for each in (diameter_um, 10.0))
    found = told("thickness")[f"{diameter_um:g} um over 10 um at {width_us} us"]
    assert found == pytest.approx(thin / thick, rel=1e-5)


def test_the_curves_of_thin_fibres_are_those_of_the_integrated_equations() -> None:
    """Of each width, and of a pulse without an end, at every eighth diameter that is drawn."""
    curves = {"20 us": 20.0, "100 us": 100.0, "400 us": 400.0, "for ever": paper.FOR_EVER_US}
    assert {entry.name for entry in figure("thickness").curves} == set(curves)
    for name, width_us in curves.items():
        thick_mv = paper.step_threshold_mv(10.0, width_us)
        for diameter_um, over in list(drawn("thickness", name).items())[::8]:
            thin_mv = paper.step_threshold_mv(diameter_um, width_us)
            assert over == pytest.approx(thin_mv / thick_mv, rel=1e-4), (name, diameter_um)


@pytest.mark.parametrize("depth_mm", [0.75, 1.0, 1.25, 1.5, 2.0])
def test_the_activating_function_is_the_curvature_of_the_integrated_field(depth_mm: float) -> None:
    """Figure 3: under the cathode, and along what is drawn."""

    def along(x_mm: float) -> float:
        return paper.point_mv(hypot(x_mm, depth_mm), -1_000.0)

    under = told("activating-function")[f"under the cathode, {depth_mm:g} mm deep, mV/mm2"]
    assert under == pytest.approx(paper.curvature(along, 0.0), rel=2e-3)
    curve = drawn("activating-function", f"{depth_mm:g} mm deep")
    highest = max(curve.values())
    for x_mm, value in list(curve.items())[::16]:
        assert value == pytest.approx(paper.curvature(along, x_mm), abs=5e-3 * highest), x_mm


def test_beside_the_cathode_it_is_negative_as_the_integrated_field_says() -> None:
    found = told("activating-function")["2 mm beside it, 1 mm deep, mV/mm2"]
    expected = paper.curvature(lambda x_mm: paper.point_mv(hypot(x_mm, 1.0), -1_000.0), 2.0)
    assert found == pytest.approx(expected, rel=5e-3)


def _under_ring(ring_mm: float, depth_mm: float) -> float:
    """Figure 4: the cathode in the middle, the ring's current evenly over all of its circle."""

    def along(x_mm: float) -> float:
        back = paper.ring_mv(x_mm, depth_mm, ring_mm, 1_000.0)
        return paper.point_mv(hypot(x_mm, depth_mm), -1_000.0) + back

    return paper.curvature(along, 0.0)


@pytest.mark.parametrize("ring_mm", [1.0, 1.5, 2.0, 3.0])
def test_a_concentric_electrode_is_what_integrals_over_its_ring_say(ring_mm: float) -> None:
    found = told("concentric")
    for depth_mm in (1.0, 2.0):
        value = found[f"ring of {ring_mm:g} mm, {depth_mm:g} mm deep, mV/mm2"]
        assert value == pytest.approx(_under_ring(ring_mm, depth_mm), rel=2e-3)
    reached_mm = brentq(lambda depth_mm: _under_ring(ring_mm, depth_mm) - 15.0, 1.0, 5.0, xtol=1e-4)
    assert found[f"ring of {ring_mm:g} mm, depth reached at 15 mV/mm2, mm"] == pytest.approx(
        reached_mm, rel=1e-3
    )


@pytest.mark.parametrize("name", ["no ring", "ring of 1 mm", "ring of 3 mm"])
def test_the_curves_under_a_concentric_electrode_are_those_integrals(name: str) -> None:
    """At every twelfth depth that is drawn."""

    def alone(depth_mm: float) -> float:
        return paper.curvature(lambda x_mm: paper.point_mv(hypot(x_mm, depth_mm), -1_000.0), 0.0)

    for depth_mm, value in list(drawn("concentric", name).items())[::12]:
        if name == "no ring":
            expected = alone(depth_mm)
        else:
            expected = _under_ring(float(name.split()[2]), depth_mm)
        assert value == pytest.approx(expected, rel=5e-3), depth_mm


def test_a_ring_adds_and_subtracts_where_the_page_says() -> None:
    """Over the middle alone, in radii; a point on the axis scales with the radius."""

    def gain(depth: float) -> float:
        alone = paper.curvature(lambda x_mm: paper.point_mv(hypot(x_mm, depth), -1_000.0), 0.0)
        return _under_ring(1.0, depth) / alone

    changes = brentq(lambda depth: gain(depth) - 1.0, 0.5, 1.0, xtol=1e-3)
    most = max(gain(depth) for depth in np.linspace(0.3, 0.7, 9))
    assert f"Down to a depth of about {changes:.1f} times its radius" in BODY
    assert f"the ring adds {100.0 * (most - 1.0):.0f} % at most" in BODY


def test_the_page_has_the_chronaxie_of_the_integrated_fibre_beside_the_arms() -> None:
    _, _, _, chronaxie_us = touch()
    assert f"The modelled touch fibre has a chronaxie of {chronaxie_us:.0f} us" in BODY
    assert "0.35 to 1.17 ms" in BODY


@pytest.mark.parametrize(("name", "factor"), [("touch, anodic", "2.7"), ("touch, cathodic", "3.2")])
def test_thresholds_fall_from_50_to_200_us_as_the_page_says(name: str, factor: str) -> None:
    short_ua, long_ua = (paper.fibre_threshold_ua(*FIBRES[name], w) for w in (50.0, 200.0))
    assert f"{short_ua / long_ua:.1f}" == factor
    assert f"by a factor of {factor}" in BODY


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_points_for_a_disk_put_a_threshold_off_by_what_the_page_says(kind: FibreKind) -> None:
    """The body's disk is 25 points: every fibre, the way that it answers to, 20 to 200 us."""
    fibre = BY_KIND[kind.name]
    way = 1.0 if kind.is_vertical else -1.0
    drive = way * disk_potential(kind.line_mm(), NOMINAL_RADIUS_MM) @ kind.drive_per_mv()
    off = []
    for width_us in (20.0, 50.0, 100.0, 200.0):
        reached_mv = float(kind.membrane().step_response(drive, width_us).max())
        by_body_ua = paper.THRESHOLD_MV / reached_mv
        off.append(100.0 * (by_body_ua / paper.fibre_threshold_ua(fibre, way, width_us) - 1.0))
    if kind.is_vertical:
        assert max(map(abs, off)) < 0.2
        assert "vertical fibres within 0.2 %" in BODY
    elif kind.hurts:
        assert f"up to {max(off):.1f} % for pain" in BODY
    else:
        assert f"{max(off):.1f} % too high for touch" in BODY


def test_every_number_of_every_figure_is_one_that_is_computed_here() -> None:
    """A number that is added has to be computed too: it goes on this list with its test."""
    computed = (
        r"threshold at (20|50|100|200|1000) us, mV|rheobase, mV",
        r"under the cathode, (0\.75|1|1\.25|1\.5|2) mm deep, mV/mm2",
        r"2 mm beside it, 1 mm deep, mV/mm2",
        r"ring of (1|1\.5|2|3) mm, ([12] mm deep, mV/mm2|depth reached at 15 mV/mm2, mm)",
        r"nerve of one node: width of least energy, us|height there / rheobase",
        r"where it needs twice its rheobase, us",
        r"spread rates: width of least energy, us|height there / their rheobase",
        r"touch, anodic: energy at its fitted d/c / least",
        r"(1|2\.5) um over 10 um at (20|100|400) us",
    )
    numbers = [what for name in FIGURES for what in told(name)]
    assert len(numbers) == 36
    for what in numbers:
        assert any(re.fullmatch(pattern, what) for pattern in computed), what


def test_the_pages_constants_are_the_models() -> None:
    """Typed a second time in `paper_equations`, and listed on the page."""
    for listed in (
        f"resistivity of the tissue | {paper.RESISTIVITY_OHM_M:g} ohm m",
        f"threshold of a membrane | {paper.THRESHOLD_MV:g} mV",
        f"G_m | {1e3 * paper.MEMBRANE_US_PER_UM:g} nS per um",
        f"G_a | {1e3 * paper.INSIDE_US_PER_UM2:g} nS per um2",
        f"C_m / G_m | {paper.MEMBRANE_TAU_US:g} us",
        f"every {paper.SPACING_MM:g} mm; {paper.TOUCH_VERTICAL.nodes} down,"
        f" {paper.TOUCH_PARALLEL.nodes} along",
        f"{paper.TOUCH_VERTICAL.ending:g} nodes' membrane",
        f"even over {2.0 * paper.ENTRY_RADIUS_MM:g} mm",
    ):
        assert listed in BODY


@pytest.mark.parametrize("width_us", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("name", ["touch, anodic", "touch, cathodic"])
def test_the_whole_body_needs_what_skin_and_nerve_integrated_need(
    name: str, width_us: float
) -> None:
    """Commanded thresholds on skin without spread, through source, leak, skin, tissue and nerve:
    to 3 %, in which are the disk's points, the returns' places and five exponentials.
    """
    places = [(2.5 * (n % 8), 2.5 * (n // 8)) for n in range(64)]
    still = LivingBody(
        places,
        leak_ohm=paper.LEAK_OHM,
        compliance_v=paper.COMPLIANCE_V,
        seed=1,
        script=STILL,
        figures=SkinFigures(area_sigma=0.0),
        spread=NerveSpread(0.0, 0.0),
    )
    still.look_at(1)
    skin_ua = paper.fibre_threshold_ua(*FIBRES[name], width_us)
    polarity: Polarity = "anodic" if FIBRES[name][1] > 0.0 else "cathodic"
    found_ua = still.commanded_threshold_ua(27, width_us, polarity)
    assert found_ua == pytest.approx(paper.commanded_ua(skin_ua, width_us, 63), rel=0.03)


def test_the_medians_of_the_page_are_those_of_fingertips() -> None:
    """Of four fingertips of 64 electrodes each, 100 us, as commanded."""
    places = [(2.5 * (n % 8), 2.5 * (n // 8)) for n in range(64)]
    bodies = [
        LivingBody(places, leak_ohm=paper.LEAK_OHM, compliance_v=paper.COMPLIANCE_V, seed=seed)
        for seed in range(4)
    ]
    found: dict[Polarity, tuple[float, float]] = {}
    for polarity in ("anodic", "cathodic"):
        pairs = [
            (
                body.commanded_threshold_ua(n, 100.0, polarity),
                body.commanded_pain_threshold_ua(n, 100.0, polarity),
            )
            for body in bodies
            for n in range(64)
        ]
        touch_ma = median(touch_ua for touch_ua, _ in pairs) / 1e3
        found[polarity] = touch_ma, median(pain_ua / touch_ua for touch_ua, pain_ua in pairs)
    (anodic, pain_anodic), (cathodic, pain_cathodic) = found["anodic"], found["cathodic"]
    assert f"{_to_twentieths(anodic)} mA anodic and {_to_twentieths(cathodic)} mA cathodic" in BODY
    assert f"{cathodic / anodic:.1f} times as much cathodic as anodic" in BODY
    assert f"about {pain_anodic:.0f} times the anodic threshold and" in BODY
    assert f"{pain_cathodic:.1f} times the cathodic threshold" in BODY


def _to_twentieths(milliamperes: float) -> str:
    return f"{round(20.0 * milliamperes) / 20.0:.2f}"
