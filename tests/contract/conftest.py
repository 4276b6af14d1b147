"""The backends that the contract of the ports is held against.

Owns: how each backend is opened for a test. Real drivers join in when the files of a real board
and its machine are named; nobody may be attached:

    pytest tests/contract --board-file=FILE --machine-file=FILE
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from board_process import running_board
from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile, load_board, load_machine
from etd_hal.compose import open_fake, open_linux
from stepped_board import BOARDS


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--board-file", help="board file of the real board under test")
    parser.addoption("--machine-file", help="machine file of the machine it is on")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "backend" in metafunc.fixturenames:
        backends: list[object] = ["stepped", "live", "board process"]
        if metafunc.config.getoption("--board-file", default=None):
            backends.append(pytest.param("linux", marks=pytest.mark.hardware))
        metafunc.parametrize("backend", backends, indirect=True)


@pytest.fixture
def board(request: pytest.FixtureRequest) -> BoardFile:
    """The board under test: the one with every guard, unless a real one is given."""
    given = request.config.getoption("--board-file", default=None)
    return load_board(Path(given) if given else BOARDS / "reference-hv507.toml")


@pytest.fixture
def backend(request: pytest.FixtureRequest, board: BoardFile, tmp_path: Path) -> Iterator[Backend]:
    """The ports of a board, requested with harmless levels, and let go of afterwards."""
    outputs = range(board.switch.outputs)
    if request.param == "linux":
        machine = request.config.getoption("--machine-file")
        assert machine, "name the machine file of the machine under test"
        opened = open_linux(board, load_machine(Path(machine)))
    elif request.param == "board process":
        with running_board(board, tmp_path) as running:
            opened = open_fake(board, electrodes=outputs, board_socket=running.socket)
            yield opened
            opened.close()
            assert running.state().dac_code == 0
        return
    else:
        opened = open_fake(board, electrodes=outputs, stepped=request.param == "stepped")
    yield opened
    opened.close()
