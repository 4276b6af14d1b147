"""What is not there, or does not answer: buses, rights, packages, chips, firmware."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import pytest

from etd_hal.boardfile import load_machine
from etd_hal.compose import open_linux
from etd_hal.errors import BusError, HardwareMissing
from etd_hal.linesetup import line_setup
from etd_hal.linux import gpio, host
from etd_hal.ports import LineSetup
from guest_board import BOARD, MACHINE, TREE, Chips, unplugged, without_rights

LINES = line_setup(BOARD)
#: It is looked at before the others.
LEFT_OVER = Path("/dev/gpiochip-left-over")
FIRMWARE = Path("/sys/devices/platform/soc")


def missing() -> HardwareMissing:
    with pytest.raises(HardwareMissing) as raised:
        open_linux(BOARD, MACHINE)
    return raised.value


@contextmanager
def hidden(folder: Path) -> Iterator[None]:
    """The kernel's folder is empty: as if there were no such driver."""
    subprocess.run(["mount", "-t", "tmpfs", "none", str(folder)], check=True)
    yield
    subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture
def left_over() -> Iterator[Path]:
    """A device file whose chip is gone: udev has not come to it yet."""
    used = gpio.find_chip(BOARD.gpio_chip_labels).stat().st_rdev
    os.mknod(LEFT_OVER, stat.S_IFCHR | 0o600, os.makedev(os.major(used), os.minor(used) + 99))
    yield LEFT_OVER
    LEFT_OVER.unlink()


class TestOpening:
    @pytest.mark.parametrize(
        ("bus", "device"), [("rig-spi", BOARD.source.spi), ("rig-i2c", BOARD.i2c)]
    )
    def test_a_bus_that_is_not_there_is_named_with_what_to_do(
        self, chips: Chips, bus: Literal["rig-spi", "rig-i2c"], device: str
    ) -> None:
        with unplugged(bus):
            found = missing()
        (told,) = found.problems
        assert device in told
        assert "raspi-config" in told
        assert found.may_come

    def test_without_rights_all_that_is_closed_is_told_at_once(self, chips: Chips) -> None:
        # Packages are imported when they are first used, from folders that may be closed as well.
        open_linux(BOARD, MACHINE).close()
        with without_rights():
            found = missing()
        assert len(found.problems) == 3
        assert all("join the groups gpio, spi and i2c" in problem for problem in found.problems)
        assert found.may_come

    def test_the_machine_file_of_another_machine_is_refused(self, chips: Chips) -> None:
        pi4 = load_machine(TREE / "config/machines/pi4.toml")
        with pytest.raises(HardwareMissing, match="name the right machine file"):
            open_linux(BOARD, pi4)

    def test_a_package_that_is_missing_is_named_and_nothing_is_waited_for(
        self, chips: Chips, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(sys.modules, "spidev", None)
        found = missing()
        assert "pip install 'etd[pi]'" in found.problems[0]
        assert not found.may_come


class TestChips:
    def test_a_device_file_without_its_chip_is_passed_over(self, left_over: Path) -> None:
        found = gpio.find_chip(BOARD.gpio_chip_labels)
        assert left_over < found
        assert found.name.removeprefix("gpiochip").isdigit()

    def test_of_a_chip_that_is_gone_nobody_can_be_asked_who_holds_its_lines(
        self, left_over: Path
    ) -> None:
        with pytest.raises(BusError, match="asking who holds the lines") as raised:
            gpio.holders(left_over, (4,))
        assert raised.value.kind == "absent"

    def test_a_line_that_somebody_takes_as_it_is_let_go_of_is_told(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Between the two requests that show whether a line stays driven."""
        requested = gpio.open_gpio
        somebody: list[gpio.LinuxGpio] = []

        class Watched:
            def __init__(self, lines: gpio.LinuxGpio) -> None:
                self.lines = lines

            def close(self) -> None:
                self.lines.close()
                line, level = LINES.outputs[0]
                taken = LineSetup(outputs=((line, level),), consumer="somebody")
                somebody.append(requested(chip, taken))

        chip = gpio.find_chip(BOARD.gpio_chip_labels)
        monkeypatch.setattr(gpio, "open_gpio", lambda *none: Watched(requested(*none)))
        with pytest.raises(BusError, match="looking at released lines") as raised:
            gpio.keeps_driving(chip, LINES)
        somebody[0].close()
        assert raised.value.kind == "busy"


class TestMachine:
    def test_without_a_firmware_nothing_is_claimed_of_the_voltage(self) -> None:
        told = host.LinuxHost(MACHINE, keeps_pins=True)
        assert told.health().is_throttled is False
        with hidden(FIRMWARE):
            found = told.health()
        assert (found.is_throttled, found.is_under_voltage) == (None, None)

    def test_a_package_that_is_not_installed_has_no_version(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(host, "_PACKAGES", ("gpiod", "no-such-package"))
        versions = host.LinuxHost(MACHINE, keeps_pins=True).packages()
        assert versions["gpiod"]
        assert versions["no-such-package"] is None
