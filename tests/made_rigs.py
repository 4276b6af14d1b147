"""An engine for a test, which must leave its board safe: a fixture of several folders."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

import engine_rig
from engine_rig import EngineRig
from trace_rules import violations

MakeRig = Callable[..., EngineRig]


@pytest.fixture
def make_rig() -> Iterator[MakeRig]:
    """`engine_rig.make`; when the test is over, each board made must be at zero and its whole
    trace within the rules.
    """
    made: list[EngineRig] = []

    def make(board: str | None = None, **fields: object) -> EngineRig:
        rig = engine_rig.make(board, **fields)  # type: ignore[arg-type]
        made.append(rig)
        return rig

    yield make
    for rig in made:
        assert rig.close() == ()
        assert rig.fake.dac_code == 0
        rest_us = rig.engine.components.loaded.board.rest_us
        assert violations(rig.trace(), rest_us) == []
