"""The wire between SYNC and TRIGGER of a live fake board, and the queue that edges wait in."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest

from etd.files.resources import find
from etd_hal.backend import Backend
from etd_hal.boardfile import EdgeInput, load_board
from etd_hal.compose import open_fake
from etd_hal.linesetup import line_setup
from stepped_board import shipped_board, stepped_board

SYNC, TRIGGER = 12, 13


@pytest.fixture(params=["kajimoto-hv507", "reference-hv507"])
def backend(request: pytest.FixtureRequest) -> Iterator[Backend]:
    board = load_board(find("boards", request.param))
    opened = open_fake(board, electrodes=range(64), stepped=True)
    opened.gpio.edges()
    yield opened
    opened.close()


def test_an_edge_on_sync_is_one_on_trigger(backend: Backend) -> None:
    since_ns = backend.clock.now_ns()
    backend.gpio.set(((SYNC, 1),))
    backend.gpio.set(((SYNC, 0),))
    first, *_ = [edge for edge in backend.gpio.edges() if edge.line == TRIGGER]
    assert first.value == 1
    assert since_ns <= first.t_ns <= backend.clock.now_ns()


def test_other_lines_give_none(backend: Backend) -> None:
    backend.gpio.set(((24, 1),))
    backend.gpio.set(((24, 0),))
    assert [edge for edge in backend.gpio.edges() if edge.line == TRIGGER] == []


def test_edges_that_nobody_reads_give_way_to_newer_ones() -> None:
    rig = stepped_board()
    for number in range(2_000):
        rig.fake.world.trigger(rig.clock.now_ns() + number * 1_000, lasts_ns=500)
    rig.clock.spend(3_000_000)
    last = rig.backend.gpio.edges()[-1]
    assert (last.line, last.value) == (TRIGGER, 0)
    assert rig.clock.now_ns() - last.t_ns < 1_100_000


@pytest.mark.parametrize(("edge", "pull", "level"), [("rising", "down", 0), ("falling", "up", 1)])
def test_the_pull_makes_the_level_before_the_edge(edge: str, pull: str, level: int) -> None:
    trigger = msgspec.convert({"line": TRIGGER, "edge": edge}, EdgeInput)
    board = msgspec.structs.replace(shipped_board("kajimoto-hv507"), trigger=trigger)
    (asked,) = line_setup(board).inputs
    assert (asked.line, asked.pull, asked.edges) == (TRIGGER, pull, True)
    assert stepped_board(board=board).backend.gpio.get(TRIGGER) == level


def test_a_board_without_a_trigger_has_no_edge_to_give() -> None:
    board = msgspec.structs.replace(shipped_board("kajimoto-hv507"), trigger="absent")
    with pytest.raises(ValueError, match="kajimoto-hv507 has no trigger"):
        stepped_board(board=board).fake.world.trigger()
