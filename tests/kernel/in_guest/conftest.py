"""For the checks that run in the guest: the chips behind its buses, and the ports on its drivers.

They are collected in the guest only, by name: `tests/kernel/check.py` boots it.
"""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

import kernel_trace
from daemon_scene import Daemon, running_daemon
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.compose import open_linux
from guest_board import (
    BARE_BOARD,
    BOARD,
    FIRST_PROCESSOR,
    MACHINE,
    MACHINE_PATH,
    Chips,
    drivers,
    report,
    running_chips,
    set_parameter,
    unchecked_board,
)


@pytest.fixture(scope="session", autouse=True)
def first_processor() -> None:
    os.sched_setaffinity(0, FIRST_PROCESSOR)


@pytest.fixture(scope="session", autouse=True)
def what_it_runs_on() -> None:
    report(drivers())


@pytest.fixture(scope="module")
def all_chips() -> Iterator[Chips]:
    # A Unix socket's path has at most 107 bytes: not in pytest's folder.
    with tempfile.TemporaryDirectory(prefix="rig") as folder, running_chips(Path(folder)) as chips:
        yield chips


@pytest.fixture
def chips(all_chips: Chips) -> Iterator[Chips]:
    """The chips, which must be left at zero and with no rule broken."""
    before = len(all_chips.state().violations)
    kernel_trace.begin()
    yield all_chips
    state = all_chips.state()
    assert state.dac_code == 0
    assert state.violations[before:] == ()


@pytest.fixture
def ports(chips: Chips) -> Iterator[Backend]:
    """The shipped drivers on the guest's buses."""
    opened = open_linux(BOARD, MACHINE)
    yield opened
    opened.close()


@pytest.fixture
def board(ports: Backend) -> Board:
    """A board in its safe state; its timing is not calibrated."""
    board = Board(BOARD, MACHINE, ports.codec, ports.spi, ports.gpio, ports.clock)
    assert board.safe_off() == ()
    return board


@pytest.fixture
def traced() -> Sequence[str]:
    """What is traced from before the engine starts. A file that asks for less has its own."""
    return kernel_trace.EVENTS


@pytest.fixture(scope="session")
def lone_gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A daemon without an engine: importing it takes an emulated processor ten seconds."""
    board = unchecked_board(tmp_path_factory.mktemp("board") / "board.toml")
    with running_daemon(str(board), MACHINE_PATH, BARE_BOARD.absent_guards) as running:
        yield running


@pytest.fixture
def lone_daemon(lone_gateway: Daemon, traced: Sequence[str]) -> Iterator[Daemon]:
    """A daemon whose chips nobody plays: everything reads zero, and so it keeps its pace."""
    set_parameter("alone", 1)
    kernel_trace.begin(traced)
    try:
        lone_gateway.start_engine()
        lone_gateway.clear_crash()
        yield lone_gateway
    finally:
        if lone_gateway.engine_pid:
            lone_gateway.end_engine(signal.SIGTERM)
        set_parameter("alone", 0)
