"""The wearer of a live fake board: the stop is tried before current can flow, each time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from etd.files.resources import find
from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile, load_board
from etd_hal.compose import open_fake

TRIED = [0, 1]


@pytest.fixture
def board() -> BoardFile:
    return load_board(find("boards", "reference-hv507"))


@pytest.fixture
def backend(board: BoardFile) -> Iterator[Backend]:
    opened = open_fake(board, electrodes=range(64), stepped=True)
    yield opened
    opened.close()


def edges(backend: Backend, board: BoardFile) -> list[int]:
    """The levels that the wearer's stop came to since this was last asked."""
    stop = board.guards.wearer_stop
    return [edge.value for edge in backend.gpio.edges() if edge.line == stop]


def supply(backend: Backend, board: BoardFile, *, is_on: bool) -> None:
    enable = board.guards.hv_enable
    assert enable != "absent"
    backend.gpio.set(((enable.line, enable.on if is_on else 1 - enable.on),))


def test_the_stop_is_pressed_and_released_once_at_the_start(
    backend: Backend, board: BoardFile
) -> None:
    assert edges(backend, board) == TRIED
    assert edges(backend, board) == []


def test_it_is_left_alone_while_the_supply_is_on_and_tried_again_after_it(
    backend: Backend, board: BoardFile
) -> None:
    edges(backend, board)
    supply(backend, board, is_on=True)
    assert edges(backend, board) == []
    supply(backend, board, is_on=False)
    assert edges(backend, board) == TRIED
    assert edges(backend, board) == []


def test_a_supply_that_is_on_again_at_once_is_waited_for(
    backend: Backend, board: BoardFile
) -> None:
    edges(backend, board)
    for is_on in (True, False, True):
        supply(backend, board, is_on=is_on)
    assert edges(backend, board) == []
    supply(backend, board, is_on=False)
    assert edges(backend, board) == TRIED
