"""What the checks on the emulated Pi share: its board, and what its drivers were seen to do.

Owns: probes in the Pi's GPIO driver, the SPI driver's own counts. Must not know: what is tested.

A probe is a breakpoint that the kernel sets into itself: whenever the function is called, its
arguments go into the trace. The driver is Debian's, unchanged, and sees nothing of it. On 64-bit
ARM the arguments are in x0 (the chip), x1 (the line) and x2 (the level).
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from etd_hal.boardfile import BoardFile, MachineFile, load_board, load_machine
from etd_hal.fake.trace import header
from etd_hal.linesetup import line_setup
from kernel_trace import TRACING, Event

TREE = Path(__file__).parents[2]
BOARD_PATH = TREE / "tests/kernel/pi-board.toml"
MACHINE_PATH = TREE / "config/machines/pi3.toml"
BOARD: BoardFile = load_board(BOARD_PATH)
MACHINE: MachineFile = load_machine(MACHINE_PATH)
LINES = BOARD.used_lines()
NAMES = {line: name for name, line in LINES.items()} | {8: "CE0"}
#: The driver of each bus on a Pi 3, and the one device that each must have taken.
DRIVERS = {
    "pinctrl-bcm2835": "3f200000.gpio",
    "spi-bcm2835": "3f204000.spi",
    "i2c-bcm2835": "3f805000.i2c",
}
_PROBES = (
    "p:rig/rig_line bcm2835_gpio_set line=%x1:u32 level=%x2:s32\n"
    "p:rig/rig_output bcm2835_gpio_direction_output line=%x1:u32 level=%x2:s32\n"
)
_ARGUMENTS = re.compile(r"line=(\d+) level=(-?\d+)")
_COUNTS = Path("/sys/kernel/debug/spi-bcm2835-3f204000.spi")
_PINS = Path("/sys/kernel/debug/pinctrl/3f200000.gpio-pinctrl-bcm2835/pins")
_PIN = re.compile(r"^pin (\d+) .* function (\S+) in (hi|lo)", re.MULTILINE)
_WITHIN_S = 120
#: Whether the kernel leaves lines as they are when their program lets go of them.
KEEPS_OUTPUTS = Path("/sys/module/pinctrl_bcm2835/parameters/persist_gpio_outputs")


def set_probes() -> None:
    """Once a boot: probes in use cannot be set again."""
    if not (TRACING / "events/rig").exists():
        (TRACING / "kprobe_events").write_text(_PROBES)
    (TRACING / "events/rig/rig_output/enable").write_text("1")


def watch_i2c() -> None:
    """Let the trace tell each I2C transaction: how many messages, how many of them went."""
    (TRACING / "events/i2c/i2c_result/enable").write_text("1")


def line_calls(of: list[Event], probe: str = "rig_line") -> list[tuple[str, int]]:
    """(name, level) of each call of the driver, chip select among them, in order.

    `rig_line`: a level was set; `rig_output`: a line became an output at this level.
    """
    calls = [_arguments(event) for event in of if event.name == probe]
    return [(NAMES.get(line, f"line {line}"), level) for line, level in calls]


def _arguments(event: Event) -> tuple[int, int]:
    found = _ARGUMENTS.search(event.rest)
    assert found, f"a probe without arguments: {event}"
    return int(found[1]), int(found[2])


def trace_header() -> dict[str, Any]:
    """What the decoder needs to know of the board."""
    found = json.loads(header(BOARD, range(BOARD.switch.outputs)))
    assert isinstance(found, dict)
    return found


def line_records(of: list[Event]) -> list[tuple[int, int, int]]:
    """(time in ns, line, level) of all that the driver did to lines of the board."""
    probes = ("rig_line", "rig_output")
    found = [(event.t_us * 1_000, *_arguments(event)) for event in of if event.name in probes]
    return [record for record in found if record[1] in LINES.values()]


def transfer_counts() -> dict[str, int]:
    """How the driver did its transfers: polling, irq, irq_after_polling, dma."""
    prefix = "count_transfer_"
    return {
        path.name.removeprefix(prefix): int(path.read_text()) for path in _COUNTS.glob(f"{prefix}*")
    }


def etd(*arguments: str, status: int = 0) -> str:
    """What the `etd` command says on its standard output, in a process of its own."""
    told = subprocess.run(
        [sys.executable, "-m", "etd", *arguments],
        capture_output=True,
        text=True,
        timeout=_WITHIN_S,
        check=False,
    )
    assert told.returncode == status, told.stdout + told.stderr
    return told.stdout


def pins() -> dict[str, tuple[str, int]]:
    """(function, level) of each output of the board, by its name: from the pin controller itself.

    Functions: gpio_in, gpio_out. Nobody's request is asked, and none is made.
    """
    found = {
        int(pin): (way, int(level == "hi")) for pin, way, level in _PIN.findall(_PINS.read_text())
    }
    return {NAMES[line]: found[line] for line, _ in line_setup(BOARD).outputs}
