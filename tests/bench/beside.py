"""What works beside the scan: the scene on wall-clock ports, as processes and as threads, and what
the shipped processes take.

Owns: how long each is played, and its two tables. Must not know: the scene (`wall_scene.py`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import msgspec
from rich.table import Table

from bench import wall_scan, wall_scene
from bench.process_facts import ProcessFacts, facts_of
from etd.client import clock
from etd.files.configuration import fake_config
from etd.sensing.readings import Readings
from etd.sensing.sensors import slots_of
from etd_hal.cutlatch import CutLatch
from etd_hal.fake.machines import MACHINES
from etd_hal.linux.beside import stopper_process
from etd_hal.linux.side_process import SideProcess

_SECONDS, _QUICK_S = 20.0, 3.0
_ALONE_S = 3.0


@dataclass(frozen=True)
class BesideFigures:
    """The scene both ways; empty `cannot` where the machine grants it."""

    processes: wall_scene.Found | None
    threads: wall_scene.Found | None
    cannot: str
    #: Engine, gateway, stopper, sensors; the first two only with the scene.
    memory: tuple[ProcessFacts, ...]
    #: Of a processor, while the supply is on.
    stopper_part: float

    @property
    def stopper_part_of_a_zero2w(self) -> float:
        """Assumed as much slower as all computing is."""
        return self.stopper_part * MACHINES["zero2w"].slowness


def measure(is_quick: bool) -> BesideFigures:
    seconds = _QUICK_S if is_quick else _SECONDS
    stopper, sensors, part = _shipped()
    try:
        processes = wall_scene.play(seconds)
        threads = wall_scene.play(seconds, "threads")
    except OSError as error:
        return BesideFigures(None, None, str(error), (stopper, sensors), part)
    return BesideFigures(processes, threads, "", (*processes.processes, stopper, sensors), part)


def _shipped() -> tuple[ProcessFacts, ProcessFacts, float]:
    """The stopper, on a file that knows no lines; the sensors, without a bus; and what part of a
    processor the stopper takes while it is needed.
    """
    latch, loaded = CutLatch(), fake_config(board=wall_scan.BOARD)
    readings = Readings(slots_of(loaded.array))
    lines, memory = os.dup(latch.memory.fd), readings.memory.fd
    module, files = "etd.sensing.process", msgspec.json.encode((loaded.board, loaded.array))
    stopper = stopper_process(latch, lines, bytes(16), None, None, None)
    sensors = SideProcess(
        "the sensors",
        "etd_hal.linux.sensor_process",
        (None, None, module, (memory, files)),
        (memory,),
    )
    try:
        stopper.watch(True)
        before = facts_of("the stopper", stopper.pid)
        clock.sleep_s(_ALONE_S)
        after = facts_of("the stopper", stopper.pid)
        part = (after.processor_s - before.processor_s) / _ALONE_S
        return after, facts_of("the sensors", sensors.pid), part
    finally:
        os.close(lines)
        stopper.end()
        sensors.end()


def tables(found: BesideFigures) -> list[Table]:
    """The scene, where it could be played; then memory."""
    memory = _memory_table(found)
    if found.processes is None or found.threads is None:
        memory.caption = f"the scene cannot be played here: {found.cannot}"
        return [memory]
    return [_scene_table(found.processes, found.threads), memory]


def _scene_table(processes: wall_scene.Found, threads: wall_scene.Found) -> Table:
    table = Table(
        title=f"on wall-clock ports beside a hog, {processes.seconds:.0f} s each, measured here",
        caption=f"the machine took the scan's processor {len(processes.stalls_ns)} times with"
        f" processes, {len(threads.stalls_ns)} with threads; halts by that are left out",
    )
    for column in ("stopper and sensors as", "", "p50", "p99.9", "max", "halts"):
        table.add_column(column, justify="right" if column.startswith(("p", "m", "h")) else "left")
    for kind, found in (("processes", processes), ("threads", threads)):
        for what, spread in found.figures.items():
            values = (f"{spread[part]:.0f}" for part in ("p50", "p99.9", "max"))
            table.add_row(kind, what, *values, str(len(found.unexcused())))
    return table


def _memory_table(found: BesideFigures) -> Table:
    part, slow_part = found.stopper_part, found.stopper_part_of_a_zero2w
    table = Table(title="memory of each process, measured here; a Zero 2 W has 512 MB")
    for column in ("", "MB", "its own"):
        table.add_column(column, justify="right" if column else "left")
    for facts in found.memory:
        total_mb, own_mb = facts.proportional_kb / 1_024, facts.private_kb / 1_024
        table.add_row(facts.name, f"{total_mb:.1f}", f"{own_mb:.1f}")
    total_mb = sum(facts.proportional_kb for facts in found.memory) / 1_024
    table.add_row("together", f"{total_mb:.1f}", "")
    table.add_row(f"the stopper takes {part:.1%} of a processor while the supply is on", "", "")
    table.add_row(f"of a Zero 2 W's at most {slow_part:.0%}, as much slower as Python is", "", "")
    return table
