"""Boards for the tests of this folder: each must end at zero, and without a broken rule."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from board_rig import BoardRig, board_rig

Boards = Callable[..., BoardRig]


@pytest.fixture
def boards() -> Iterator[Boards]:
    """Makes boards; `begun=False` leaves one as it is after power-up."""
    made: list[BoardRig] = []

    def make(name: str = "kajimoto-hv507", *, begun: bool = True, **how: Any) -> BoardRig:
        rig = board_rig(name, **how)
        made.append(rig)
        if begun:
            rig.begin()
        return rig

    yield make
    for rig in made:
        assert rig.fake.dac_code == 0
        assert rig.fake.violations == []
