"""Opening hardware that is not there: one refusal that says everything."""

from __future__ import annotations

import errno
import os
from importlib.util import find_spec
from pathlib import Path

import msgspec
import pytest

from etd_hal.boardfile import BoardFile, load_board, load_machine
from etd_hal.errors import BusError, HardwareMissing
from etd_hal.linux import opening as linux
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


def test_devices_that_are_not_there_may_come_and_another_machine_does_not() -> None:
    machine = load_machine(CONFIG / "machines" / "pi4.toml")
    right = msgspec.structs.replace(machine, models=())
    for here, may_come in ((right, find_spec("spidev") is not None), (machine, False)):
        with pytest.raises(HardwareMissing) as caught:
            linux.open_ports(board_without_devices(), here, LINES)
        assert caught.value.may_come is may_come


def test_a_device_that_is_of_another_kind_is_not_waited_for() -> None:
    machine = msgspec.structs.replace(load_machine(CONFIG / "machines" / "pi4.toml"), models=())
    board = msgspec.structs.replace(board_without_devices(), i2c="/dev/null")
    with pytest.raises(HardwareMissing) as caught:
        linux.open_ports(board, machine, LINES)
    assert not caught.value.may_come


@pytest.mark.parametrize(("number", "may_come"), [(errno.EACCES, True), (errno.EPERM, False)])
def test_what_a_file_does_not_permit_may_come_and_what_a_unit_does_not_needs_the_unit(
    monkeypatch: pytest.MonkeyPatch, number: int, may_come: bool
) -> None:
    def refused(_: BoardFile) -> None:
        raise BusError.of(OSError(number, os.strerror(number)), "/dev/spidev0.0", "opening")

    monkeypatch.setattr(linux, "_open_spi", refused)
    machine = msgspec.structs.replace(load_machine(CONFIG / "machines" / "pi4.toml"), models=())
    with pytest.raises(HardwareMissing) as caught:
        linux.open_ports(board_without_devices(), machine, LINES)
    assert caught.value.may_come is may_come
    assert ("DeviceAllow=" in caught.value.problems[0]) is not may_come


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
