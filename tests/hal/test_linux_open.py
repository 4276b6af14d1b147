"""Opening hardware that is not there: one refusal that says everything."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import msgspec
import pytest

from etd_hal import linux
from etd_hal.boardfile import BoardFile, load_board, load_machine
from etd_hal.errors import HardwareMissing
from etd_hal.ports import LineSetup

pytest.importorskip("gpiod", reason="gpiod is there on Linux only")

CONFIG = Path(__file__).parents[2] / "config"
LINES = LineSetup(outputs=((4, 1), (23, 0)))


def board_without_devices() -> BoardFile:
    board = load_board(CONFIG / "boards" / "reference-hv507.toml")
    return msgspec.structs.replace(
        board,
        source=msgspec.structs.replace(board.source, spi="/dev/spidev-none"),
        i2c="/dev/i2c-none",
        gpio_chip_labels=("no-such-chip",),
    )


def test_everything_that_is_missing_is_listed_at_once_with_what_to_do() -> None:
    machine = load_machine(CONFIG / "machines" / "pi4.toml")
    nowhere = msgspec.structs.replace(machine, models=("no such model",))
    with pytest.raises(HardwareMissing) as caught:
        linux.open_ports(board_without_devices(), nowhere, LINES)
    model, spi, i2c, gpio = caught.value.problems
    assert "no such model" in model
    if find_spec("spidev") is None:
        assert "pip install 'etd[pi]'" in spi
    else:
        assert "/dev/spidev-none" in spi
        assert "raspi-config" in spi
    assert "/dev/i2c-none" in i2c
    assert "raspi-config" in i2c
    assert "no-such-chip" in gpio
    assert "gpio_chip_labels" in gpio


def test_a_board_without_i2c_does_not_ask_for_it() -> None:
    board = msgspec.structs.replace(board_without_devices(), i2c="absent")
    machine = load_machine(CONFIG / "machines" / "pi4.toml")
    with pytest.raises(HardwareMissing) as caught:
        linux.open_ports(board, machine, LINES)
    assert not any("i2c" in problem for problem in caught.value.problems)


def test_who_holds_a_line_is_told_by_function_and_by_name() -> None:
    board = load_board(CONFIG / "boards" / "reference-hv507.toml")
    told = linux.who_holds({4: "etd", 23: ""}, board)
    assert told == "POL (4) is held by 'etd', BL (23) is held by 'a kernel driver'"
