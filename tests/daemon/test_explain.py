"""The paper's figures, made by the model behind the fake, against the paper's closed forms."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from itertools import pairwise
from math import exp, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etd import cli
from etd.cli.explain import NAMES, SHOWN
from etd.explain import FIGURES, svgplot
from etd.explain.figure import Axis, Curve, Figure
from etd.explain.strength import spread_rates
from etd_body.membrane import Membrane, NerveConstants
from etd_body.nerve import THRESHOLD_MV
from etd_body.tissue import RESISTIVITY_OHM_M, Floats

PLOTS = Path(__file__).parents[2] / "docs" / "plots"
#: Of the thick fibre, worked out here from the constants: equation 14's a and b.
THICK = NerveConstants.of_diameter(10.0)
A_PER_US = (THICK.inside_us + THICK.membrane_us) / THICK.capacitance_pf
B = THICK.inside_us / (THICK.inside_us + THICK.membrane_us)


def explained(name: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert cli.main(["explain", name, "--json"]) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


def checks(told: dict[str, Any]) -> dict[str, float]:
    return {entry["what"]: entry["modelled"] for entry in told["checks"]}


def curve(told: dict[str, Any], name: str) -> dict[float, float]:
    found = next(entry for entry in told["curves"] if entry["name"] == name)
    return dict(zip(found["x"], found["y"], strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_every_checked_number_is_its_closed_form_to_one_percent(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = explained(name, capsys)["checks"]
    assert len(found) >= 4
    for entry in found:
        assert entry["modelled"] == pytest.approx(entry["closed_form"], rel=0.01)
        assert entry["error_percent"] < 1.0


def test_the_verb_knows_all_figures_without_making_one() -> None:
    assert tuple(FIGURES) == NAMES


@pytest.mark.parametrize("width_us", [20, 50, 100, 200, 1_000])
def test_the_threshold_at_a_width_is_that_of_equation_16(
    width_us: int, capsys: pytest.CaptureFixture[str]
) -> None:
    expected = THRESHOLD_MV / B / (1.0 - exp(-A_PER_US * width_us))
    found = checks(explained("strength-duration", capsys))
    assert found[f"threshold at {width_us} us, mV"] == pytest.approx(expected, rel=0.01)


def test_the_rheobase_is_that_of_equation_17(capsys: pytest.CaptureFixture[str]) -> None:
    found = checks(explained("strength-duration", capsys))
    assert found["rheobase, mV"] == pytest.approx(THRESHOLD_MV / B, rel=0.01)


def test_the_fakes_fibres_too_need_more_current_for_shorter_pulses(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = explained("strength-duration", capsys)
    for name in ("touch, anodic", "touch, cathodic", "pain, anodic"):
        heights = list(curve(told, name).values())
        assert all(longer < shorter for shorter, longer in pairwise(heights))
        assert heights[-1] == pytest.approx(1.0, abs=0.1)


def test_the_least_energy_is_at_1_4_times_the_rheobase(capsys: pytest.CaptureFixture[str]) -> None:
    """Equation 18."""
    found = checks(explained("optimal-width", capsys))
    assert found["height there / rheobase"] == pytest.approx(1.398, rel=0.001)
    assert found["nerve of one node: width of least energy, us"] * A_PER_US == pytest.approx(
        1.2564, rel=0.001
    )


def test_a_hyperbolas_least_energy_is_at_twice_the_rheobase_at_d_over_c(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Equations 19 to 21."""
    found = checks(explained("optimal-width", capsys))
    assert found["height there / their rheobase"] == pytest.approx(2.0, rel=0.001)
    assert found["spread rates: width of least energy, us"] * A_PER_US == pytest.approx(
        0.6931, rel=0.001
    )
    assert found["where it needs twice its rheobase, us"] * A_PER_US == pytest.approx(
        0.6931, rel=0.001
    )


def test_membranes_of_spread_rates_have_a_hyperbola_for_their_curve() -> None:
    """Equation 19, at every width that is drawn."""
    d_over_c_us = 138.6
    membrane, drive = spread_rates(d_over_c_us, 10.0)
    for width_us in (20.0, 50.0, 138.6, 500.0, 2_000.0):
        threshold_mv = THRESHOLD_MV / float(membrane.step_response(drive, width_us).sum())
        hyperbola_mv = THRESHOLD_MV / B * (1.0 + d_over_c_us / width_us)
        assert threshold_mv == pytest.approx(hyperbola_mv, rel=1e-5)


def test_the_fakes_touch_fibre_lies_between_the_nerve_of_one_node_and_the_hyperbola(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = explained("optimal-width", capsys)
    found = curve(told, "touch, anodic")
    assert 200.0 < min(found, key=lambda width_us: found[width_us]) < 260.0
    assert "1.74 times, at 230 us" in told["says"]


@pytest.mark.parametrize("name", ["strength-duration", "optimal-width", "thickness"])
def test_no_row_of_a_nerve_holds_when_the_membrane_is_another_one(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What stands under "modelled" comes from the code that the fake feels with, all of it."""

    def begins_late(self: Membrane, drive: Floats, t_us: float) -> Floats:
        grown = 1.1 * np.expm1(-self.rates * t_us) ** 2
        return np.asarray((self.shapes(drive) * grown[..., None, :]).sum(axis=-1))

    def goes_too_far(self: Membrane, drive: Floats) -> Floats:
        return np.asarray(1.1 * self.shapes(drive).sum(axis=-1))

    monkeypatch.setattr(Membrane, "step_response", begins_late)
    monkeypatch.setattr(Membrane, "final", goes_too_far)
    held = [
        entry["what"] for entry in explained(name, capsys)["checks"] if entry["error_percent"] < 1.0
    ]
    assert held == []


def test_a_cathode_depolarizes_a_parallel_fibre_and_the_deeper_the_less(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Figure 3: 1 mA, so K = rho / 2 pi, in V mm."""
    found = checks(explained("activating-function", capsys))
    for depth_mm in (0.75, 1.0, 1.5, 2.0):
        expected = RESISTIVITY_OHM_M * 1_000.0 / (2.0 * pi) / depth_mm**3
        value = found[f"under the cathode, {depth_mm:g} mm deep, mV/mm2"]
        assert value == pytest.approx(expected, rel=0.01)
        assert value > 0.0


def test_the_flanks_of_a_cathode_are_negative_beyond_the_depth_over_root_two(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = curve(explained("activating-function", capsys), "1 mm deep")
    crossing = min(x for x, y in found.items() if x > 0.0 and y < 0.0)
    assert crossing == pytest.approx(1.0 / sqrt(2.0), abs=0.06)


def test_a_wider_ring_stimulates_more_and_deeper(capsys: pytest.CaptureFixture[str]) -> None:
    """Figure 4."""
    found = checks(explained("concentric", capsys))
    rings = ("1", "1.5", "2", "3")
    at_two = [found[f"ring of {ring} mm, 2 mm deep, mV/mm2"] for ring in rings]
    reached = [found[f"ring of {ring} mm, depth reached at 15 mV/mm2, mm"] for ring in rings]
    assert at_two == sorted(at_two)
    assert reached == sorted(reached)
    assert reached[-1] > 1.2 * reached[0]


def test_thin_fibres_need_more_and_the_difference_shrinks_with_width(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Section 2.2.1."""
    told = explained("thickness", capsys)
    thin = [
        next(iter(curve(told, name).values())) for name in ("20 us", "100 us", "400 us", "for ever")
    ]
    assert all(longer < 0.9 * shorter for shorter, longer in pairwise(thin))
    assert thin[-1] > 1.0


@pytest.mark.parametrize("name", NAMES)
def test_a_plot_is_well_formed_and_names_its_curves(name: str, tmp_path: Path) -> None:
    file = tmp_path / "plot.svg"
    assert cli.main(["explain", name, "--plot", str(file)]) == 0
    root = ET.fromstring(file.read_text(encoding="utf-8"))
    texts = {element.text for element in root.iter() if element.tag.endswith("text")}
    figure = FIGURES[name]()
    assert {figure.title, figure.x.label, figure.y.label} <= texts
    assert {curve.name for curve in figure.curves} <= texts


@pytest.mark.parametrize("name", NAMES)
def test_the_plots_in_the_docs_are_those_of_the_model(name: str) -> None:
    drawn = svgplot.svg_of(FIGURES[name]())
    kept = (PLOTS / f"{name}.svg").read_text(encoding="utf-8")
    assert _without_digits(drawn) == _without_digits(kept), (
        f"run: etd explain {name} --plot docs/plots/{name}.svg"
    )


def _without_digits(svg: str) -> list[str]:
    """Processors may round the last digit of a coordinate differently: points are left out."""
    return [line for line in svg.splitlines() if not line.startswith("<polyline")]


def test_a_plot_lies_where_its_axes_say() -> None:
    line = Curve("line", (1.0, 10.0, 100.0), (0.0, 1.0, 2.0))
    figure = Figure("f", "a < b", "", Axis("x", "log"), Axis("y", most=2.0), (line,), ())
    root = ET.fromstring(svgplot.svg_of(figure))
    points = next(
        element.get("points", "") for element in root.iter() if element.tag.endswith("polyline")
    )
    places = [tuple(float(part) for part in text.split(",")) for text in points.split()]
    (left, bottom), (middle, half), (right, top) = places
    assert middle == pytest.approx((left + right) / 2.0, abs=0.1)
    assert half == pytest.approx((top + bottom) / 2.0, abs=0.1)
    assert bottom > top


def test_names_at_the_curves_ends_do_not_lie_on_one_another() -> None:
    curves = tuple(
        Curve(f"c{electrode}", (0.0, 1.0), (0.0, electrode / 1_000)) for electrode in range(6)
    )
    figure = Figure("f", "t", "", Axis("x"), Axis("y", most=1.0), curves, ())
    root = ET.fromstring(svgplot.svg_of(figure))
    at = [
        float(element.get("y", "0"))
        for element in root.iter()
        if element.tag.endswith("text") and (element.text or "").startswith("c")
    ]
    assert len(at) == 6
    assert all(abs(a - b) >= 15.9 for a, b in pairwise(sorted(at)))
    assert max(at) <= svgplot.HEIGHT


def test_the_paper_is_wide_enough_for_a_long_name_and_else_as_it_always_is() -> None:
    axis = Axis("x")
    for name, width in (("none", svgplot.WIDTH), ("contact + fitted + probe", 745)):
        curve = Curve(name, (0.0, 1.0), (0.0, 1.0))
        drawn = svgplot.svg_of(Figure("f", "t", "", axis, axis, (curve,), ()))
        root = ET.fromstring(drawn)
        assert root.attrib["width"] == str(width)


def test_the_table_says_how_far_the_model_is_off(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["explain", "optimal-width"]) == 0
    told = capsys.readouterr().out
    assert "The pulse of least energy" in told
    assert "0.00 %" in told


def test_a_plot_that_cannot_be_written_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "none" / "plot.svg"
    assert cli.main(["explain", "thickness", "--plot", str(file)]) == 1
    assert str(file) in capsys.readouterr().err


def test_a_plot_is_drawn_over_an_old_one_and_through_no_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, named = tmp_path / "plot.svg", tmp_path / "victim"
    for text in ("x" * 1_000_000, ""):
        file.write_text(text, encoding="utf-8")
        assert cli.main(["explain", "thickness", "--plot", str(file)]) == 0
        ET.fromstring(file.read_text(encoding="utf-8"))
    named.write_text("as it was", encoding="utf-8")
    file.unlink()
    file.symlink_to(named)
    assert cli.main(["explain", "thickness", "--plot", str(file)]) == 1
    assert f"{file}: a link is in the place of a file" in capsys.readouterr().err
    assert named.read_text(encoding="utf-8") == "as it was"


@pytest.mark.parametrize("name", ["plot.png", "plot", ".svg", "plot.svg.pdf"])
@pytest.mark.parametrize("options", [(), ("--json",)], ids=["plain", "json"])
def test_a_plot_of_another_kind_is_refused_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, options: tuple[str, ...]
) -> None:
    file = tmp_path / name
    with pytest.raises(SystemExit) as ended:
        cli.main(["explain", "thickness", "--plot", str(file), *options])
    assert ended.value.code == 2
    assert not file.exists()
    told, complaint = capsys.readouterr()
    assert "name a file that ends in .svg" in complaint
    if options:
        assert json.loads(told)["error"] == "used_wrongly"
        assert "ends in .svg" in json.loads(told)["reason"]


def test_the_ending_of_a_plot_may_be_in_capitals(tmp_path: Path) -> None:
    assert cli.main(["explain", "thickness", "--plot", str(tmp_path / "A.SVG")]) == 0


@pytest.mark.parametrize(
    ("given", "said"), [([], "no figure is named"), (["nope", "--json"], "unknown figure 'nope'")]
)
def test_where_no_figure_is_named_all_are(
    given: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["explain", *given])
    assert ended.value.code == 2
    assert f"{said}; name one of {', '.join(NAMES)}" in capsys.readouterr().err


def test_the_help_says_of_each_figure_what_is_to_be_seen(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        cli.main(["explain", "--help"])
    lines = capsys.readouterr().out.splitlines()
    for name, what in SHOWN.items():
        assert any(line.split() == [name, *what.split()] for line in lines)
