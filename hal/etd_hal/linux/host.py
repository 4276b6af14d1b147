"""The machine under a real board: its packages, its health, its pins, its rights.

Owns: reading each from the kernel and the firmware of a Raspberry Pi. Must not know: boards, tests.
`root` is prepended to every path, so that a test can provide a machine's files.
"""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

from etd_hal.bench import CpuClock, Health, Obtained, ScanCore, Timekeeping
from etd_hal.boardfile import MachineFile
from etd_hal.linux import machine as this_machine
from etd_hal.linux.clock import timekeeping
from etd_hal.linux.machine import read_text
from etd_hal.linux.realtime import obtained, set_up
from etd_hal.linux.scan_core import scan_core

_PACKAGES = ("msgspec", "gpiod", "spidev", "smbus2")
_TEMPERATURE = "sys/class/thermal/thermal_zone0/temp"
#: Bits 0..3 are of now: under-voltage, capped, throttled, soft temperature limit. Bits 16..19 say
#: that the same has been.
_THROTTLED = "sys/devices/platform/soc/soc:firmware/get_throttled"
_SLOWER_NOW = 0b1110
_UNDER_VOLTAGE_NOW = 0b0001
_HAS_BEEN = 16
_CLOCK_SOURCE = "sys/devices/system/clocksource/clocksource0/current_clocksource"
_HWMON = "sys/class/hwmon"


class LinuxHost:
    """See `bench.Host`. `keeps_pins` was found out by letting go of the lines once."""

    def __init__(
        self, machine: MachineFile, keeps_pins: bool, root: Path = this_machine.ROOT
    ) -> None:
        self._machine = machine
        self._keeps_pins = keeps_pins
        self._root = root

    def packages(self) -> dict[str, str | None]:
        return {name: _version(name) for name in _PACKAGES}

    def problem(self) -> str | None:
        return this_machine.problem(self._machine, self._root)

    def facts(self) -> tuple[str, ...]:
        return this_machine.facts(self._root)

    def health(self) -> Health:
        return health(self._root)

    def cpu_clock(self) -> CpuClock | None:
        return this_machine.cpu_clock(self._root)

    def keeps_pins(self) -> bool:
        return self._keeps_pins

    def free_memory_kb(self) -> int | None:
        found = [line.split() for line in self._read("proc/meminfo").splitlines()]
        return next((int(words[1]) for words in found if words[0] == "MemAvailable:"), None)

    def timekeeping(self) -> Timekeeping:
        return timekeeping(self._read(_CLOCK_SOURCE) or "unknown")

    def set_up_realtime(self, priority: int, core: int | None) -> tuple[str, ...]:
        return set_up(priority, core)

    def obtained(self) -> Obtained:
        return obtained()

    def scan_core(self) -> ScanCore:
        return scan_core(root=self._root)

    def _read(self, path: str) -> str:
        return read_text(self._root / path)


def health(root: Path = this_machine.ROOT) -> Health:
    """As the kernel and the firmware report it: a few files, one of them asked of the firmware."""
    bits = _throttled_bits(root)
    if bits is None:
        return Health(_temperature_c(root), None, _alarm_of_voltage(root))
    return Health(
        temperature_c=_temperature_c(root),
        is_throttled=bool(bits & _SLOWER_NOW),
        is_under_voltage=bool(bits & _UNDER_VOLTAGE_NOW),
        was_throttled=bool(bits >> _HAS_BEEN & _SLOWER_NOW),
        was_under_voltage=bool(bits >> _HAS_BEEN & _UNDER_VOLTAGE_NOW),
    )


def _temperature_c(root: Path) -> float | None:
    text = read_text(root / _TEMPERATURE)
    return int(text) / 1_000 if text.lstrip("-").isdigit() else None


def _throttled_bits(root: Path) -> int | None:
    try:
        return int(read_text(root / _THROTTLED), 16)
    except ValueError:
        return None


def _alarm_of_voltage(root: Path) -> bool | None:
    for folder in sorted((root / _HWMON).glob("hwmon*")):
        if read_text(folder / "name") == "rpi_volt":
            return read_text(folder / "in0_lcrit_alarm") == "1"
    return None


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
