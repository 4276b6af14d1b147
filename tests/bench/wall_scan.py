"""The real engine on wall-clock ports: real-time, on a core of its own, with the shipped bound.

Owns: the process (`python wall_scan.py FOLDER LIBRARY CORE processes|threads`), and the figures
that it leaves in FOLDER when it ends. Must not know: who loads the machine, what the figures are
compared with.
"""

from __future__ import annotations

import json
import sys
from array import array
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

_CLONE = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(_CLONE / "tests")]

import msgspec  # noqa: E402

from bench.wall_beside import CHECKS, Processes, Threads  # noqa: E402
from bench.wall_ports import SystemCalls, WallGpio, WallSpi  # noqa: E402
from etd.engine.process import run_engine  # noqa: E402
from etd.files.configuration import EngineConfig, LoadedConfig, fake_config  # noqa: E402
from etd.files.resources import find  # noqa: E402
from etd_hal.backend import Backend  # noqa: E402
from etd_hal.boardfile import load_machine  # noqa: E402
from etd_hal.compose import codec_of  # noqa: E402
from etd_hal.linux import realtime  # noqa: E402
from etd_hal.linux.clock import LinuxClock  # noqa: E402
from etd_hal.unwired import NoMarker  # noqa: E402

BOARD = "reference-hv507"
PRIORITY = 80
FIGURES = "figures.json"
LOCK_WAITS = "waits for the interpreter's lock, us"
#: See `WallGpio`.
TRY_STOP = "try-stop"
_NEVER_NS = 1 << 62
Spread = dict[str, float]


def loaded_for(core: int) -> LoadedConfig:
    """The shipped files, and the scan thread as a service has it. Only how much messages may differ
    from one another is that of the shipped file for virtual machines: interrupts of a virtual
    machine take tens of microseconds. The bound at which a message halts stays a Pi 4's.
    """
    loaded = fake_config(board=BOARD)
    engine = EngineConfig(core=core, priority=PRIORITY)
    virtual = load_machine(find("machines", "rig"))
    machine = msgspec.structs.replace(
        loaded.machine, spread_us=virtual.spread_us, drift_us=virtual.drift_us
    )
    config = msgspec.structs.replace(loaded.config, engine=engine)
    return replace(loaded, config=config, machine=machine)


def main(folder: Path, library: Path, core: int, kind: str) -> int:
    loaded, calls, clock = loaded_for(core), SystemCalls(library), LinuxClock()
    gpio = WallGpio(calls, loaded.board, folder / TRY_STOP)
    threads = Threads(folder, library, loaded)
    is_threads = kind == "threads"
    backend = Backend(
        "fake",
        *(WallSpi(calls, gpio), gpio, None, clock, NoMarker(), lambda: None),
        host_clock=clock,
        codec=codec_of(loaded.board.source),
        set_up_realtime=realtime.set_up,
        set_up_urgent_thread=realtime.scheduling,
        beside=threads if is_threads else Processes(folder, library, find("boards", BOARD)),
    )
    # No self-test was made: a fake is armed all the same.
    untested = folder / "selftest.json"
    status = run_engine(loaded, backend, folder, untested, lambda: print("ready", flush=True))
    if is_threads:
        threads.save()
    checks = array("q")
    checks.frombytes((folder / CHECKS).read_bytes())
    spreads = {
        LOCK_WAITS: spread_us(calls.lock_waits_ns),
        "gaps between heartbeats, us": spread_us(gaps_ns(gpio.beats_ns, gpio.powered())),
        "gaps between the stopper's checks, us": spread_us(gaps_ns(checks, gpio.powered())),
    }
    figures = {"spreads": spreads, "stalls_ns": calls.stalls_ns()}
    (folder / FIGURES).write_text(json.dumps(figures), "utf-8")
    return status


def gaps_ns(times_ns: array[int], powered_ns: list[tuple[int, int]]) -> array[int]:
    """Between neighbours with the supply on: `powered_ns` has (from, to) of each such time."""
    spans, found = iter([*powered_ns, (_NEVER_NS, _NEVER_NS)]), array("q")
    begun_ns, ended_ns = next(spans)
    for before, after in pairwise(times_ns):
        while before >= ended_ns:
            begun_ns, ended_ns = next(spans)
        if begun_ns <= before and after <= ended_ns:
            found.append(after - before)
    return found


def spread_us(durations_ns: array[int]) -> Spread:
    """How many there are; p50, p99.9 and the largest."""
    ordered = sorted(durations_ns) or [0]
    at = {"p50": 0.5, "p99.9": 0.999, "max": 1.0}
    found = {name: ordered[round(part * (len(ordered) - 1))] / 1_000 for name, part in at.items()}
    return {"count": len(durations_ns), **found}


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4]))
