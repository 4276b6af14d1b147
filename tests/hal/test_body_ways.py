"""The network that current goes through, against sums done by hand."""

from __future__ import annotations

import numpy as np
import pytest

from etd_body.course import STILL, Course
from etd_body.electrode import OPEN_CONTACT, load
from etd_body.interface import Side, Sides
from etd_body.mesh import Gel, beside, neighbors
from etd_body.skin import Skin, SkinFigures
from etd_body.ways import Ways

PLACES = [(0.0, 0.0), (2.5, 0.0), (0.0, 2.5), (2.5, 2.5)]
S, G, O = Side.SOURCE, Side.GROUND, Side.OPEN  # noqa: E741 - one letter each, to be read as a row


def ways(figures: SkinFigures = SkinFigures()) -> tuple[Skin, Ways]:  # noqa: B008 - frozen
    skin = Skin(figures, Course(STILL, PLACES, seed=1), PLACES, seed=1)
    return skin, Ways(skin)


def mask(*chosen: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    found = np.zeros(4, dtype=bool)
    found[list(chosen)] = True
    return found


def test_neighbors_are_one_pitch_apart() -> None:
    expected = [[0, 1, 1, 0], [1, 0, 0, 1], [1, 0, 0, 1], [0, 1, 1, 0]]
    assert neighbors(PLACES).tolist() == expected


def test_bridges_between_the_sides_add_up() -> None:
    found = beside(neighbors(PLACES) * 1e-5, np.full(4, 2e-5), mask(0), mask(1, 2, 3))
    assert found.source_ground_s == pytest.approx(2e-5)
    assert (found.source_tissue_s, found.ground_tissue_s) == (0.0, 0.0)


def test_what_floats_is_a_star_between_source_ground_and_tissue() -> None:
    """Electrode 1 floats, bridged to 0 (source) and 3 (ground), with a skin of its own."""
    bridge_s, skin_s = 1e-5, 2e-5
    found = beside(neighbors(PLACES) * bridge_s, np.full(4, skin_s), mask(0), mask(2, 3))
    star_s = 2 * bridge_s + skin_s
    assert found.source_ground_s == pytest.approx(bridge_s + bridge_s**2 / star_s)
    assert found.source_tissue_s == pytest.approx(bridge_s * skin_s / star_s)
    assert found.ground_tissue_s == pytest.approx(bridge_s * skin_s / star_s)


@pytest.mark.parametrize("sides", [(S, G, G, G), (G, G, S, G), (G, S, S, S)])
def test_the_quick_way_is_what_the_whole_network_comes_to(sides: Sides) -> None:
    """The same electrodes, once as one against all, once with the sums taken one by one."""
    skin, quick = ways(SkinFigures(paste_bridge_ohm=50_000.0))
    fast = quick.of(sides)
    lone = sides.index(S) if sides.count(S) == 1 else sides.index(G)
    all_s = skin.conductance_at(0.0)
    others = [electrode for electrode in range(4) if electrode != lone]
    assert fast.lone == lone
    assert fast.direction == (1 if sides[lone] is S else -1)
    assert fast.weights[lone] == 1.0
    assert fast.weights[others] == pytest.approx(-all_s[others] / all_s[others].sum())
    assert 1.0 / fast.rest_ohm == pytest.approx(skin.conductance_at(1_000 / 3)[others].sum())
    assert fast.shunt_s == pytest.approx(2.0 / 50_000.0)


def test_a_ring_with_the_rest_open_shares_among_its_members_alone() -> None:
    skin, found = ways()
    way = found.of((S, G, O, G))
    all_s = skin.conductance_at(0.0)
    assert way.weights[2] == 0.0
    assert way.weights[[1, 3]] == pytest.approx(-all_s[[1, 3]] / all_s[[1, 3]].sum())
    assert not way.is_against_all


def test_two_against_two_is_a_resistance() -> None:
    skin, found = ways()
    way = found.of((S, S, G, G))
    all_s = skin.conductance_at(0.0)
    assert way.lone is None
    expected = 1.0 / all_s[:2].sum() + 1.0 / all_s[2:].sum()
    assert way.rest_ohm == pytest.approx(expected)
    assert way.weights.sum() == pytest.approx(0.0, abs=1e-12)
    assert way.weights[:2].sum() == pytest.approx(1.0)


def test_nobody_stands_alone_where_all_others_are_off_the_skin() -> None:
    skin, found = ways()
    for electrode in (1, 2, 3):
        skin.put(electrode, OPEN_CONTACT)
    skin.refresh(0.0)
    found.use_skin()
    way = found.of((S, G, G, G))
    assert (way.lone, way.direction) == (None, 0)
    assert not way.weights.any()


def test_a_load_is_no_skin_and_does_not_bend_with_current() -> None:
    skin, _ = ways()
    skin.put(1, load(10_000.0))
    skin.refresh(0.0)
    assert skin.conductance_at(0.0)[1] == pytest.approx(1e-4)
    assert skin.conductance_at(9_000.0)[1] == pytest.approx(1e-4)
    assert not skin.is_skin[1]


def test_a_gels_resistances_are_those_of_a_column_and_a_strip() -> None:
    gel = Gel(thickness_mm=1.0, resistivity_ohm_m=10.0)
    assert gel.series_ohm(1.0) == pytest.approx(10.0 * 1e-3 / (np.pi * 0.25e-6))
    assert gel.bridge_ohm(1.5, 1.0) == pytest.approx(10.0 * 1.5e-3 / (1e-3 * 1e-3))
