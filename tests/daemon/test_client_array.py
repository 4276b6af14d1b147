"""Levels by electrode and as rows, and an array's geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from etd import Display, Refused
from etd.client.array import ElectrodeArray
from etd.protocol.facts import ArrayFacts
from gateway_rig import ServedRig


def display(rig: ServedRig) -> Display:
    return Display(address=rig.address, max_current_ua=3000, width_us=100, client="me")


@pytest.mark.parametrize(
    "levels",
    [
        {1: 0.5, 3: 1},
        {np.int64(1): 0.5, np.uint8(3): 1.0},
        [[0, 0.5, 0, 1]],
        np.array([[0, 0.5, 0, 1]]),
        list(np.array([[0, 0.5, 0, 1]])),
        np.array([0, 0.5, 0, 1]),
    ],
)
def test_levels_may_be_given_by_electrode_or_as_rows(levels: Any) -> None:
    with ServedRig() as rig, display(rig) as d:
        d.show(levels)
    assert rig.engine.frames[-1].frame.level == (0, 0.5, 0, 1)


def test_the_array_knows_its_grid_and_its_distances() -> None:
    with ServedRig() as rig, display(rig) as d:
        array = d.array
    assert array.shape == (1, 4)
    assert array.at(0, 2) == 2
    assert array.place(3) == (0, 3)
    assert array.nearest(5.9, 3.0) == 2
    assert array.distance_mm(0, 3) == 7.5
    with pytest.raises(Refused, match="rows 0 to 0 and columns 0 to 3"):
        array.at(1, 0)


def test_rows_are_counted_from_the_fingertip_and_columns_from_the_left() -> None:
    """Whatever the order of the electrodes' numbers."""
    facts = ArrayFacts(
        name="two-by-three",
        electrodes=6,
        x_mm=(0.0, 0.0, 2.5, 2.5, 5.0, 5.0),
        y_mm=(0.0, 2.0, 0.0, 2.0, 0.0, 2.0),
        diameter_mm=1.0,
    )
    array = ElectrodeArray(facts)
    assert array.shape == (2, 3)
    assert [[array.at(row, column) for column in range(3)] for row in range(2)] == [
        [1, 3, 5],
        [0, 2, 4],
    ]
    assert array.by_electrode([[1, 3, 5], [0, 2, 4]]) == [0, 1, 2, 3, 4, 5]


def test_electrodes_that_form_no_grid_have_no_rows() -> None:
    facts = ArrayFacts(
        name="three", electrodes=3, x_mm=(0.0, 1.0, 2.0), y_mm=(0.0, 1.0, 0.0), diameter_mm=1.0
    )
    array = ElectrodeArray(facts)
    assert array.shape is None
    assert array.by_electrode({2: 0.5}) == [0, 0, 0.5]
    with pytest.raises(Refused, match="form no grid"):
        array.by_electrode([[1, 2, 3]])
