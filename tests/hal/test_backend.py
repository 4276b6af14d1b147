"""Which clocks a backend may have, and what may be lengthened on it."""

from __future__ import annotations

import dataclasses

import pytest

from etd_hal.backend import Backend
from etd_hal.boardfile import load_board
from etd_hal.compose import open_fake
from etd_hal.linux.clock import LinuxClock
from etd_hal.unwired import NoMarker
from stepped_board import BOARDS, SteppedBoard, stepped_board


def on_linux(**changes: object) -> Backend:
    """As `compose` puts a real board's ports together; the ports themselves are a fake's."""
    made: SteppedBoard = stepped_board()
    fake, clock = made.backend, LinuxClock()
    backend = Backend(
        "linux",
        *(fake.spi, fake.gpio, fake.i2c, clock, NoMarker(), fake.close),
        host_clock=clock,
        codec=fake.codec,
    )
    return dataclasses.replace(backend, **changes)  # type: ignore[arg-type]


def test_a_real_board_has_one_clock_and_the_timeouts_of_the_protocol() -> None:
    backend = on_linux()
    assert backend.host_clock is backend.clock
    assert backend.timeout_factor == 1


@pytest.mark.parametrize("factor", [0, 2, 100])
def test_a_real_boards_timeouts_cannot_be_lengthened(factor: int) -> None:
    with pytest.raises(ValueError, match="not lengthened"):
        on_linux(timeout_factor=factor)


def test_a_real_board_has_no_second_clock() -> None:
    with pytest.raises(ValueError, match="one clock"):
        on_linux(host_clock=LinuxClock())


def test_a_fake_counts_timeouts_on_its_machines_clock_and_may_lengthen_them() -> None:
    board = load_board(BOARDS / "kajimoto-hv507.toml")
    backend = open_fake(board, electrodes=range(64), timeout_factor=20)
    try:
        assert isinstance(backend.host_clock, LinuxClock)
        assert backend.timeout_factor == 20
    finally:
        backend.close()
