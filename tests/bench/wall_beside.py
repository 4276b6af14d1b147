"""What works beside the scan of `wall_scan.py`: as processes, and as the threads that they must
not be.

Owns: both ways, and the times of the stopper's checks. Must not know: what is made of the figures.

Stopper, sensors and their loops are the shipped ones, on wall-clock ports.
"""

from __future__ import annotations

import os
import select
from array import array
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from bench.wall_ports import SystemCalls, WallI2c
from etd.engine.stopper import StopperThread
from etd.files.configuration import LoadedConfig
from etd.sensing.readings import Readings
from etd.sensing.scan_core import ScanCoreReading
from etd.sensing.sensors import PressureSensors, RailSensor, SensorThread, slots_of
from etd_hal.backend import SideTask, StopperTask
from etd_hal.boardfile import BoardFile, load_board
from etd_hal.cutlatch import SIZE, CutLatch
from etd_hal.linux import death_mark, realtime, side_process
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.death_mark import DeathMark
from etd_hal.linux.scan_core import scan_core as read_scan_core
from etd_hal.linux.side_process import SideProcess
from etd_hal.linux.stopper_process import watch
from etd_hal.ports import Changes
from etd_hal.shared_memory import SharedMemory
from etd_hal.stopper import Stopper

#: In the scene's folder.
CHECKS = "checks"


class Checks:
    """A clock that notes when it is read, which a stopper does once a check."""

    def __init__(self) -> None:
        self.at_ns = array("q")
        self._clock_ns = LinuxClock().now_ns

    def now_ns(self) -> int:
        now_ns = self._clock_ns()
        self.at_ns.append(now_ns)
        return now_ns

    def save(self, folder: Path) -> None:
        (folder / CHECKS).write_bytes(self.at_ns.tobytes())


class Processes:
    """See `backend.Beside`; as on the kernel's drivers."""

    def __init__(self, folder: Path, library: Path, board: Path, module: str = __name__) -> None:
        """`module`: whose `main` runs in these processes."""
        self._given = (str(folder), str(library), str(board))
        self._module = module

    def stopper(
        self,
        latch: CutLatch,
        safe_changes: Changes,
        note: Path | None,
        priority: int | None,
        scan_core: int | None,
    ) -> StopperTask:
        engine = os.pidfd_open(os.getpid())
        try:
            fds = latch.memory.fd, engine, death_mark.take()
            arguments = ("stopper", *self._given, *fds, priority, scan_core)
            return SideProcess("the stopper", self._module, arguments, fds)
        finally:
            os.close(engine)

    def sensors(
        self,
        module: str,
        arguments: tuple[object, ...],
        fds: tuple[int, ...],
        scan_core: int | None,
    ) -> SideTask:
        given = ("sensors", *self._given, scan_core, module, *arguments)
        return SideProcess("the sensors", self._module, given, fds)


def main(control: int, kind: str, folder: str, library: str, board: str, *arguments: Any) -> None:
    """In such a process."""
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
    checks, memory = Checks(), SharedMemory(SIZE, latch)
    stopper = Stopper(memory.words, checks.now_ns, calls.set_lines)
    watch(connection, stopper, engine, DeathMark(mark))
    checks.save(folder)


def sense(
    control: int,
    calls: SystemCalls,
    board: BoardFile,
    core: int | None,
    module: str,
    *arguments: Any,
) -> None:
    """The sensors' process, until the scan's ends."""
    of_scan = partial(read_scan_core, os.getppid())
    connection = side_process.begin(control, realtime.set_up_beside(None, core))

    def is_over(wait_s: float) -> bool:
        return bool(select.select([connection], (), (), wait_s)[0])

    import_module(module).main(WallI2c(calls, board), LinuxClock(), of_scan, is_over, *arguments)


class Threads:
    """The same in the scan's process, where every thread waits for the interpreter's lock."""

    def __init__(self, folder: Path, library: Path, loaded: LoadedConfig) -> None:
        self._folder = folder
        self._loaded = loaded
        self._stopper_calls, self._sensor_calls = SystemCalls(library), SystemCalls(library)
        self._checks = Checks()

    def stopper(
        self,
        latch: CutLatch,
        safe_changes: Changes,
        note: Path | None,
        priority: int | None,
        scan_core: int | None,
    ) -> StopperTask:
        assert priority is not None
        thread = StopperThread(
            Stopper(latch.words, self._checks.now_ns, self._stopper_calls.set_lines),
            lambda: realtime.scheduling(priority),
        )
        thread.start()
        return thread

    def sensors(
        self,
        module: str,
        arguments: tuple[object, ...],
        fds: tuple[int, ...],
        scan_core: int | None,
    ) -> SideTask:
        board, electrodes, clock = self._loaded.board, self._loaded.array, LinuxClock()
        i2c, slots = WallI2c(self._sensor_calls, board), slots_of(electrodes)
        readings = Readings(slots, SharedMemory(Readings.size(slots), os.dup(fds[0])))
        rail = RailSensor(board, i2c, clock, readings)
        pressure = PressureSensors(electrodes, i2c, clock, readings)
        thread = SensorThread(rail, pressure, ScanCoreReading(readings, clock))
        thread.start()
        return thread

    def save(self) -> None:
        self._checks.save(self._folder)
