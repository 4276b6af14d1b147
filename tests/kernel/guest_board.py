"""What the tests in the guest share: the chips behind the buses, and the kernel's other handles.

Owns: starting the answerer, the module's parameters, unplugging. Must not know: what is tested.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from board_door import knock_at
from etd_hal.boardfile import BoardFile, MachineFile, load_board, load_machine
from etd_hal.fake import wire
from etd_hal.fake.trace import header

TREE = Path(__file__).parents[2]
BOARD_PATH = TREE / "config/boards/reference-hv507.toml"
BOARD: BoardFile = load_board(BOARD_PATH)
#: With no guard and no chip that answers: it can be driven where nobody does.
_BARE_PATH = TREE / "config/boards/kajimoto-hv507.toml"
BARE_BOARD: BoardFile = load_board(_BARE_PATH)
IS_VIRTUAL_TIME = "User Mode Linux" in Path("/proc/cpuinfo").read_text()
MACHINE_PATH = TREE / (
    "tests/kernel/virtual-time.toml" if IS_VIRTUAL_TIME else "config/machines/rig.toml"
)
MACHINE: MachineFile = load_machine(MACHINE_PATH)
_PARAMETERS = Path("/sys/module/rig/parameters")
_DRIVERS = Path("/sys/bus/platform/drivers")
#: The folder that the run outside sees, too.
SHARED = Path("/run/rig")
WITHIN_S = 30.0
#: What is looked at runs on the first processor, what answers and serves on the last.
FIRST_PROCESSOR = {0}
LAST_PROCESSOR = {max(os.sched_getaffinity(1))}
#: Above the engine's, its stopper's included.
HIGHEST_PRIORITY = 98
#: Who has no group and owns nothing.
_NOBODY = 65_534
#: What is drawn by chance, the moments of kills above all, is drawn outside, and can be repeated.
SEED = int(os.environ.get("ETD_SEED", "0"))


def unchecked_board(path: Path) -> Path:
    """The bare board, written to `path` with probes too weak for the check of the source: where all
    that is read is zero, no other can be armed.
    """
    text = _BARE_PATH.read_text(encoding="utf-8")
    path.write_text(text.replace("probe_current_ua = 300", "probe_current_ua = 100"))
    return path


def report(figure: str) -> None:
    """A figure for the account at the end of the run."""
    with (SHARED / "figures").open("a") as figures:
        figures.write(f"{figure}\n")


def trace_header() -> dict[str, Any]:
    """What the decoder needs to know of the board."""
    found = json.loads(header(BOARD, range(BOARD.switch.outputs)))
    assert isinstance(found, dict)
    return found


def set_parameter(name: str, value: int) -> None:
    """A parameter of the module: its faults, mostly."""
    (_PARAMETERS / name).write_text(str(value))


def drivers() -> str:
    """What runs here, as the kernel names it: its version, and the driver of each bus."""
    buses = {
        "gpio": "/sys/bus/gpio/devices/gpiochip0/../driver",
        "spi": "/sys/class/spi_master/spi0/device/driver",
        "spidev0.0": "/sys/bus/spi/devices/spi0.0/driver",
        "i2c": "/sys/class/i2c-adapter/i2c-1/device/driver",
    }
    found = [f"{bus} by {Path(link).resolve().name}" for bus, link in buses.items()]
    return f"Linux {os.uname().release} ({os.uname().machine}): {', '.join(found)}"


@contextmanager
def unplugged(bus: Literal["rig-gpio", "rig-spi", "rig-i2c"]) -> Iterator[None]:
    """The bus's device goes away from its driver, and comes back."""
    (_DRIVERS / bus / "unbind").write_text(bus)
    try:
        yield
    finally:
        (_DRIVERS / bus / "bind").write_text(bus)


@contextmanager
def without_rights() -> Iterator[None]:
    """The files are opened, and real time is asked for, as a user without any group."""
    groups = os.getgroups()
    os.setgroups([])
    os.setegid(_NOBODY)
    os.seteuid(_NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(0)
        os.setgroups(groups)


@contextmanager
def above_the_engine() -> Iterator[None]:
    """Run as soon as there is something to do: on one processor the engine would come first."""
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(HIGHEST_PRIORITY))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@dataclass(frozen=True)
class Chips:
    """The running answerer."""

    door: Path
    trace: Path
    pid: int

    def knock(self, knock: wire.Knock) -> wire.State:
        """See `board_door.knock_at`."""
        return knock_at(self.door, knock, WITHIN_S)

    def state(self) -> wire.State:
        return self.knock(wire.AskState())


class _Nursery:
    """Of answerers: importing what they are made of takes longest."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(TREE / "tests/kernel/answerer_nursery.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        atexit.register(self._end)

    def ask_for(self, arguments: Sequence[str]) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(arguments) + "\n")
        self._process.stdin.flush()

    def said(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def _end(self) -> None:
        self._process.communicate(timeout=WITHIN_S)


@cache
def _nursery() -> _Nursery:
    """One, from when it is first needed until the run's end."""
    return _Nursery()


@contextmanager
def running_chips(folder: Path, *on_what: Literal["--on-bench"]) -> Iterator[Chips]:
    """An answerer, for as long as it is needed: the array on a fingertip, or on nothing."""
    door, trace = folder / "door.sock", folder / "chips.trace.jsonl"
    nursery = _nursery()
    nursery.ask_for(
        ["--board", str(BOARD_PATH), "--door", str(door), "--trace", str(trace), *on_what]
    )
    said = nursery.said()
    assert said.startswith("answering "), f"the answerer does not start: {said!r}"
    pid = int(said.split()[1])
    try:
        os.sched_setaffinity(pid, LAST_PROCESSOR)
        # It stands for hardware: nothing else makes it wait.
        os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(50))
        yield Chips(door, trace, pid)
    finally:
        # Fails where it has ended in between: the nursery has waited for it already.
        os.kill(pid, signal.SIGTERM)
        said = nursery.said()
    assert said == "ended 0", f"the answerer has {said}"
