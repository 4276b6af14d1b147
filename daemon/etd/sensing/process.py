"""The sensors, and what the kernel says of the scan's core, in a process of their own, which leaves
what it reads in shared memory.

Owns: what it is given when it starts, and its loop. Must not know: the scan, states, what follows
from a value; how the bus is opened.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from etd.files.array import Array
from etd.sensing.readings import Readings
from etd.sensing.scan_core import ScanCoreReading
from etd.sensing.sensors import PressureSensors, RailSensor, SensorCycle, read_until, slots_of
from etd_hal.backend import Beside, SideTask
from etd_hal.bench import ScanCore
from etd_hal.boardfile import BoardFile
from etd_hal.ports import Clock, I2c
from etd_hal.shared_memory import SharedMemory


def start(
    beside: Beside, board: BoardFile, array: Array, readings: Readings, scan_core: int | None
) -> SideTask:
    """The process, which writes into `readings`."""
    files, memory = msgspec.json.encode((board, array)), readings.memory.fd
    return beside.sensors(__name__, (memory, files), (memory,), scan_core)


def main(
    i2c: I2c | None,
    clock: Clock,
    scan_core: Callable[[], ScanCore],
    is_over: Callable[[float], bool],
    memory: int,
    files: bytes,
) -> None:
    """In the process itself. `memory` is the readings' file descriptor; see `read_until`."""
    board, array = msgspec.json.decode(files, type=tuple[BoardFile, Array])
    slots = slots_of(array)
    readings = Readings(slots, SharedMemory(Readings.size(slots), memory))
    rail = RailSensor(board, i2c, clock, readings)
    pressure = PressureSensors(array, i2c, clock, readings)
    read_until(is_over, SensorCycle(rail, pressure), ScanCoreReading(readings, clock, scan_core))
