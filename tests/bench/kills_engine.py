"""Real engines on wall-clock ports, one after the other, each with the shipped stopper beside it.

Owns: the process that they are forked from (`python kills_engine.py FOLDER LIBRARY CORE`), and what
a stopper leaves of its end. Must not know: when an engine is killed, what is made of the figures.

It has loaded everything, so that an engine is there in no time. A line on its input starts one; it
says `ready` and the number of its process, and `ended` when that is gone.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

_CLONE = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(_CLONE / "tests")]

import msgspec  # noqa: E402

from bench.wall_beside import Processes, sense  # noqa: E402
from bench.wall_ports import SystemCalls, WallGpio, WallSpi  # noqa: E402
from bench.wall_scan import BOARD, TRY_STOP, loaded_for  # noqa: E402
from etd.engine.process import run_engine  # noqa: E402
from etd.files.configuration import LoadedConfig  # noqa: E402
from etd.files.resources import find  # noqa: E402
from etd_hal.backend import Backend  # noqa: E402
from etd_hal.boardfile import load_board  # noqa: E402
from etd_hal.compose import codec_of  # noqa: E402
from etd_hal.cutlatch import CUTS, NOTED, POWER, SIZE  # noqa: E402
from etd_hal.linux import realtime, side_process  # noqa: E402
from etd_hal.linux.clock import LinuxClock  # noqa: E402
from etd_hal.linux.death_mark import DeathMark  # noqa: E402
from etd_hal.linux.stopper_process import watch  # noqa: E402
from etd_hal.shared_memory import SharedMemory  # noqa: E402
from etd_hal.stopper import Stopper  # noqa: E402
from etd_hal.supply_note import SupplyNote  # noqa: E402
from etd_hal.unwired import NoMarker  # noqa: E402

#: In the folder: the note of the supply, and what the stopper says at its end.
NOTE, ENDED = "supply.json", "stopper.json"
#: The first of a stopper's cuts.
_CUTS_KEPT = 10_000
#: Of this file, where it is not the program.
_MODULE = "bench.kills_engine"


class _Checks:
    """A clock that a stopper reads once a check: the longest that it was kept from the next one
    with the supply on. Before that it waits for the disk.
    """

    def __init__(self, words: memoryview[int]) -> None:
        self._clock_ns = LinuxClock().now_ns
        self._words = words
        self._read_ns: int | None = None
        self.longest_ns = 0

    def now_ns(self) -> int:
        now_ns, before_ns = self._clock_ns(), self._read_ns
        is_noted = self._words[POWER] & 1 and self._words[NOTED] == self._words[POWER]
        self._read_ns = now_ns if is_noted else None
        if is_noted and before_ns is not None:
            self.longest_ns = max(self.longest_ns, now_ns - before_ns)
        return now_ns


def main(control: int, kind: str, folder: str, library: str, board: str, *arguments: Any) -> None:
    """In a process beside an engine, see `Processes`."""
    calls = SystemCalls(Path(library))
    if kind == "stopper":
        _stop(control, Path(folder), calls, *arguments)
    else:
        sense(control, calls, load_board(Path(board)), *arguments)


def _stop(
    control: int,
    folder: Path,
    calls: SystemCalls,
    latch: int,
    engine: int,
    mark: int,
    priority: int | None,
    scan_core: int | None,
) -> None:
    connection = side_process.begin(control, realtime.set_up_beside(priority, scan_core))
    memory, clock = SharedMemory(SIZE, latch), LinuxClock()
    checks = _Checks(memory.words)
    note = SupplyNote(folder / NOTE)
    cuts_ns: list[int] = []

    def cut_off() -> None:
        calls.set_lines()
        # A cut is repeated until it was seen, which a stopped engine never does.
        if len(cuts_ns) < _CUTS_KEPT:
            cuts_ns.append(clock.now_ns())

    stopper = Stopper(memory.words, checks.now_ns, cut_off, note)
    watch(connection, stopper, engine, DeathMark(mark))
    cut_before_ns = tuple(cuts_ns)
    stopper.cut()
    safe_ns = clock.now_ns()
    is_powered = bool(memory.words[POWER] & 1)
    stopper.note_supply()
    new = folder / f".{ENDED}"
    told = {
        "safe_ns": safe_ns,
        "held_up_ns": checks.longest_ns,
        "cuts": memory.words[CUTS],
        "cut_before_ns": cut_before_ns,
        "is_powered": is_powered,
    }
    new.write_text(json.dumps(told))
    new.rename(folder / ENDED)
    side_process.finish()


def _forgiving(loaded: LoadedConfig) -> LoadedConfig:
    """What else this machine does must not halt an engine that is to be killed."""
    machine = msgspec.structs.replace(loaded.machine, halt_excess_us=9e4, drift_us=9e4)
    return replace(loaded, machine=machine)


def _drive(folder: Path, library: Path, core: int, parent: int) -> int:
    """One engine, which does not outlive the process that it was forked from."""
    realtime.perish_with(parent)
    loaded, calls, clock = _forgiving(loaded_for(core)), SystemCalls(library), LinuxClock()
    gpio = WallGpio(calls, loaded.board, folder / TRY_STOP)
    backend = Backend(
        "fake",
        WallSpi(calls, gpio),
        gpio,
        None,
        clock,
        NoMarker(),
        lambda: None,
        host_clock=clock,
        codec=codec_of(loaded.board.source),
        set_up_realtime=realtime.set_up,
        set_up_urgent_thread=realtime.scheduling,
        beside=Processes(folder, library, find("boards", BOARD), _MODULE),
    )
    said = partial(print, "ready", os.getpid(), flush=True)
    untested = folder / "selftest.json"
    return run_engine(loaded, backend, folder, untested, said, folder / NOTE)


def nursery(folder: Path, library: Path, core: int) -> int:
    parent = os.getpid()
    for _ in sys.stdin:
        pid = os.fork()
        if not pid:
            os._exit(_drive(folder, library, core, parent))
        os.waitpid(pid, 0)
        print("ended", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(nursery(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])))
