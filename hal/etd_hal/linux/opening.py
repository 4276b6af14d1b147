"""Opens the kernel's drivers behind the ports.

Owns: opening all devices that a board needs, or reporting all problems at once.
Must not know: what the board is for.

The packages are imported when hardware is opened: the clock works where they are not installed.
The ports that `open_ports` returns have a `close` each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from etd_hal.boardfile import BoardFile, MachineFile
from etd_hal.errors import BusError, HardwareMissing
from etd_hal.linux import machine as this_machine
from etd_hal.linux.clock import LinuxClock
from etd_hal.ports import LineSetup, SpiSetup

if TYPE_CHECKING:
    from etd_hal.linux.gpio import LinuxGpio
    from etd_hal.linux.i2c import LinuxI2c
    from etd_hal.linux.spi import LinuxSpi

T = TypeVar("T")

Ports = tuple["LinuxSpi", "LinuxGpio", "LinuxI2c | None", LinuxClock]


def open_ports(board: BoardFile, machine: MachineFile, lines: LineSetup) -> Ports:
    """Open SPI, GPIO, I2C (None if the board has none) and the clock.

    All or nothing: what was opened is closed again before it raises.
    Raises: HardwareMissing, with every problem and what to do about it.
    """
    problems: list[_Problem] = []
    wrong_machine = this_machine.problem(machine)
    if wrong_machine:
        problems.append(_Problem(wrong_machine))
    spi = _opened(problems, lambda: _open_spi(board), _SWITCH_ON)
    i2c = None
    if board.i2c != "absent":
        i2c = _opened(problems, lambda: _open_i2c(board), _SWITCH_ON)
    # The lines last: requesting them drives them, so only when nothing else is in the way.
    gpio = None
    if problems:
        _opened(problems, lambda: _free_lines(board, lines), _OTHER_CHIP)
    else:
        gpio = _opened(problems, lambda: _open_lines_looked_at(board, lines), _OTHER_CHIP)
    if problems or spi is None or gpio is None:
        for port in (spi, i2c):
            if port is not None:
                port.close()
        raise _missing(problems)
    return spi, gpio, i2c, LinuxClock()


def open_to_make_safe(
    board: BoardFile, lines: LineSetup
) -> tuple[LinuxGpio, LinuxSpi | None, tuple[str, ...]]:
    """The outputs first, which drives them; then the other devices, and a sentence for each that is
    missing. No I2C, and no check of the machine: nothing will be fired.

    Raises: HardwareMissing if the outputs cannot be requested.
    """
    problems: list[_Problem] = []
    gpio = _opened(problems, lambda: open_lines(board, lines), _OTHER_CHIP)
    if gpio is None and lines.inputs:
        outputs = replace(lines, inputs=())
        gpio = _opened([], lambda: open_lines(board, outputs), _OTHER_CHIP)
    if gpio is None:
        raise _missing(problems)
    spi = _opened(problems, lambda: _open_spi(board), _SWITCH_ON)
    return gpio, spi, tuple(problem.sentence for problem in problems)


def open_lines(board: BoardFile, lines: LineSetup) -> LinuxGpio:
    """The lines alone, driven from the request on.

    Raises: BusError (busy, with who holds them; absent, permission); ImportError.
    """
    from etd_hal.linux.gpio import open_gpio

    return open_gpio(_free_lines(board, lines), lines)


def _open_lines_looked_at(board: BoardFile, lines: LineSetup) -> LinuxGpio:
    """They are released once before, to see what this kernel does with them then; their levels are
    harmless. Raises: as `open_lines`.
    """
    from etd_hal.linux.gpio import keeps_driving

    keeps = keeps_driving(_free_lines(board, lines), lines)
    gpio = open_lines(board, lines)
    gpio.fact = _KEPT if keeps else _RELEASED
    return gpio


_KEPT = (
    "lines: let go of once, the outputs stayed as they were: after a kill the stopper makes them"
    " safe, and `etd safe` after it"
)
_RELEASED = (
    "lines: let go of once, the outputs became inputs: after a kill the pulls hold them safe, after"
    " the stopper"
)


def _free_lines(board: BoardFile, lines: LineSetup) -> Path:
    """The chip, if no process holds one of the lines. Raises: BusError."""
    from etd_hal.linux.gpio import find_chip, holders

    chip = find_chip(board.gpio_chip_labels)
    held = holders(chip, _all_lines(lines))
    if held:
        raise BusError("busy", str(chip), "requesting lines", who_holds(held, board))
    return chip


class _Problem(NamedTuple):
    sentence: str
    #: The device may still be on its way, or what it belongs to.
    may_come: bool = False


def _missing(problems: list[_Problem]) -> HardwareMissing:
    return HardwareMissing(
        tuple(problem.sentence for problem in problems),
        all(problem.may_come for problem in problems),
    )


def _opened(problems: list[_Problem], open_one: Callable[[], T], if_absent: str) -> T | None:
    try:
        return open_one()
    except ImportError as error:
        sentence = f"a Python package cannot be loaded ({error}): pip install 'etd[pi]'"
        problems.append(_Problem(sentence))
    except BusError as error:
        advice = if_absent if error.kind == "absent" else _ADVICE.get(error.kind, _LOOK)
        problems.append(_Problem(f"{error}; {advice}", error.kind in _MAY_COME))
    return None


_SWITCH_ON = "switch the bus on (raspi-config, Interface Options), or correct the board file"
_OTHER_CHIP = "the board file's gpio_chip_labels name the chip of the 40-pin header: correct them"
#: What udev mends, once it has seen a device.
_MAY_COME = ("absent", "gone", "permission")
_LOOK = "the kernel log (dmesg) may say why"
_ADVICE = {
    "busy": "end the program that holds them (`etd stop` and `systemctl stop` for a daemon)",
    "forbidden": "the service may not open it: a DeviceAllow= in its unit (docs/install.md); if the"
    " device came after the service was started, start that again",
    "gone": "look whether the device is still there, and its driver loaded",
    "permission": "join the groups gpio, spi and i2c (sudo adduser NAME GROUP), log in again",
    "invalid": "the driver does not take the board file's mode, speed or lines",
}


def _open_spi(board: BoardFile) -> LinuxSpi:
    from etd_hal.linux.spi import open_spi

    source = board.source
    return open_spi(SpiSetup(source.spi, source.mode, source.speed_hz))


def _open_i2c(board: BoardFile) -> LinuxI2c:
    from etd_hal.linux.i2c import open_i2c

    return open_i2c(board.i2c)


def _all_lines(lines: LineSetup) -> tuple[int, ...]:
    return tuple(line for line, _ in lines.outputs) + tuple(line.line for line in lines.inputs)


def who_holds(held: dict[int, str], board: BoardFile) -> str:
    """The lines in use by their function on this board, each with its holder's name."""
    functions = {line: function for function, line in board.used_lines().items()}
    return ", ".join(
        f"{functions.get(line, 'line')} ({line}) is held by {name or 'a kernel driver'!r}"
        for line, name in held.items()
    )
