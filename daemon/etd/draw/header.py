"""The 40-pin header of a Raspberry Pi, and what a board file puts on which pin.

Owns: the numbers of the pins, their pulls at boot, and for each wire of a board what it is for and
which level it must have while nothing drives it. Must not know: how it is drawn.

Pins: Raspberry Pi documentation, "GPIO and the 40-pin header" (the same on all models that etd
runs on; Zephyr's binding raspberrypi-40pins-header agrees). Pulls at boot: BCM2835 and BCM2711
peripherals, GPIO 0 to 8 up, from 9 down. Levels: docs/hardware.md, "The lines".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from etd_hal.boardfile import BoardFile

#: Pin 1 first: the number of a GPIO line, or what else the pin is.
_PINS: tuple[int | str, ...] = (
    "3.3 V", "5 V",  2,       "5 V",   3,       "GND",   4,       14,      "GND",   15,
    17,      18,     27,      "GND",   22,      23,      "3.3 V", 24,      10,      "GND",
    9,       25,     11,      8,       "GND",   7,       0,       1,       5,       "GND",
    6,       12,     13,      "GND",   19,      16,      26,      20,      "GND",   21,
)  # fmt: skip
#: GPIO line to the pin's number.
PIN_OF_GPIO = {what: pin for pin, what in enumerate(_PINS, start=1) if isinstance(what, int)}
#: What is on pins that are no GPIO line.
POWER_PINS = {pin: what for pin, what in enumerate(_PINS, start=1) if isinstance(what, str)}
#: Left to the EEPROM of an attached board.
RESERVED_GPIO = (0, 1)

Group = Literal["switch", "source", "i2c", "guard", "sync"]
#: By bus: clock, out, in, and the chip selects by number.
_SPI = {0: (11, 10, 9, (8, 7)), 1: (21, 20, 19, (18, 17, 16))}
_I2C = {1: (2, 3)}


@dataclass(frozen=True, slots=True)
class Wire:
    """One wire of the header. `level` is what it must have while nothing drives it; None: any.

    `is_fitted`: the board needs a resistor that makes this level. `name` is as in the board file.
    """

    gpio: int
    name: str
    group: Group
    direction: Literal["out", "in", "both"]
    purpose: str
    level: Literal[0, 1] | None = None
    is_fitted: bool = False

    @property
    def pin(self) -> int:
        return PIN_OF_GPIO[self.gpio]

    @property
    def is_pulled_the_other_way(self) -> bool:
        """Whether the Pi's own pull at boot is against the level that is wanted."""
        return self.level is not None and self.level != level_at_boot(self.gpio)

    @property
    def pull(self) -> str:
        """What to fit, and what the Pi does by itself."""
        at_boot = "up" if level_at_boot(self.gpio) else "down"
        if self.level is None:
            return f"any level while undriven; Pi at boot: {at_boot}"
        if not self.is_fitted:
            return f"{self.level} while undriven; Pi at boot: {at_boot}"
        to = "pull-up to 3.3 V" if self.level else "pull-down to ground"
        return f"{to}: {self.level} while undriven; Pi at boot: {at_boot}"


def level_at_boot(gpio: int) -> Literal[0, 1]:
    """Of a pin that nothing drives."""
    return 1 if gpio <= 8 else 0


def wires_of(board: BoardFile) -> tuple[Wire, ...]:
    """Every wire of the board whose pin is known, in the order of the pins."""
    found = [*_switch(board), *_guards(board), *_source(board), *_i2c(board)]
    if board.sync_line != "absent":
        purpose = "marks frames for other instruments"
        found.append(Wire(board.sync_line, "SYNC", "sync", "out", purpose, 0))
    if board.trigger != "absent":
        edge = board.trigger.edge
        before: Literal[0, 1] = 0 if edge == "rising" else 1
        purpose = f"a {edge} edge begins a frame"
        found.append(Wire(board.trigger.line, "TRIGGER", "sync", "in", purpose, before))
    if board.too_strong != "absent":
        rest: Literal[0, 1] = 0 if board.too_strong.edge == "rising" else 1
        purpose = "the wearer's button: too strong"
        found.append(Wire(board.too_strong.line, "TOO_STRONG", "sync", "in", purpose, rest))
    return tuple(sorted(found, key=lambda wire: wire.pin))


def held_pins(board: BoardFile) -> dict[int, str]:
    """Pins without a wire that a bus of the board takes, and its name."""
    device = _spi_of(board)
    if device is None:
        return {}
    bus, select = device
    others = (gpio for at, gpio in enumerate(_SPI[bus][3]) if at != select)
    used = board.used_lines().values()
    return {PIN_OF_GPIO[gpio]: f"SPI{bus}" for gpio in others if gpio not in used}


def unplaced(board: BoardFile) -> tuple[str, ...]:
    """A sentence for each bus whose pins are not those of the header's usual ones."""
    found = []
    if _spi_of(board) is None:
        found.append(f"{board.source.spi}: its pins are not known here; the current path is on it")
    if board.i2c != "absent" and _bus_of_i2c(board.i2c) not in _I2C:
        found.append(f"{board.i2c}: its pins are not known here; the rail's chips are on it")
    return tuple(found)


def _switch(board: BoardFile) -> Iterator[Wire]:
    lines = board.switch.lines
    safe = dict(board.switch.safe_levels)
    purposes = {
        "POL": "polarity of all outputs",
        "DATA": "into the chain of switches",
        "LE": "latch",
        "BL": "0 blanks: all outputs together",
        "CLK": "shift clock",
    }
    if board.switch.chip == "74HC595":
        purposes |= {"LE": "RCLK: copies on its rising edge", "CLK": "SRCLK: shift clock"}
    for name in lines.__struct_fields__:
        level: Literal[0, 1] | None = None if name == "DATA" else 0
        if name in safe:
            level = 1 if safe[name] else 0
        yield Wire(getattr(lines, name), name, "switch", "out", purposes[name], level, name in safe)


def _guards(board: BoardFile) -> Iterator[Wire]:
    guards = board.guards
    for name in ("emergency_stop", "wearer_stop"):
        line = getattr(guards, name)
        if line != "absent":
            purpose = "contact to 3.3 V, normally closed; 0 stops"
            yield Wire(line, name.upper(), "guard", "in", purpose, 0, True)
    if guards.hv_enable != "absent":
        on = guards.hv_enable.on
        purpose = f"the high-voltage supply: {on} switches it on"
        yield Wire(guards.hv_enable.line, "HV", "guard", "out", purpose, 0 if on else 1, True)
    if guards.heartbeat != "absent":
        purpose = "into the monostable: only edges count"
        yield Wire(guards.heartbeat.line, "HEARTBEAT", "guard", "out", purpose)
    if guards.readback != "absent":
        yield Wire(guards.readback, "READBACK", "guard", "in", "last stage of the chain")


def _source(board: BoardFile) -> Iterator[Wire]:
    device = _spi_of(board)
    if device is None:
        return
    bus, select = device
    clock, out, back, selects = _SPI[bus]
    yield Wire(clock, f"SPI{bus} SCLK", "source", "out", "to DAC and ADC")
    yield Wire(out, f"SPI{bus} MOSI", "source", "out", f"to the DAC ({board.source.dac})")
    yield Wire(back, f"SPI{bus} MISO", "source", "in", f"from the ADC ({board.source.adc})")
    purpose = "chip select of DAC and ADC, joined"
    yield Wire(selects[select], f"SPI{bus} CE{select}", "source", "out", purpose, 1, True)


def _i2c(board: BoardFile) -> Iterator[Wire]:
    bus = _bus_of_i2c(board.i2c)
    if bus in _I2C:
        data, clock = _I2C[bus]
        chips = []
        if board.guards.rail_monitor != "absent":
            chips.append(f"ADS1115 at 0x{board.guards.rail_monitor.address:02x}")
        if board.rail_setpoint != "absent":
            chips.append(f"MCP4725 at 0x{board.rail_setpoint.address:02x}")
        purpose = ", ".join(chips) or "no chip of the board"
        yield Wire(data, f"I2C{bus} SDA", "i2c", "both", purpose, 1)
        yield Wire(clock, f"I2C{bus} SCL", "i2c", "out", purpose, 1)


def _spi_of(board: BoardFile) -> tuple[int, int] | None:
    """Bus and chip select, where the header has them."""
    named = re.fullmatch(r"/dev/spidev(\d)\.(\d)", board.source.spi)
    if named is None:
        return None
    bus, select = int(named[1]), int(named[2])
    return (bus, select) if bus in _SPI and select < len(_SPI[bus][3]) else None


def _bus_of_i2c(device: str) -> int:
    named = re.fullmatch(r"/dev/i2c-(\d)", device)
    return int(named[1]) if named else -1
