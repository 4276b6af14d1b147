"""The stopper as a process: it holds the output lines too, and needs no lock of any other.

Owns: its loop, and what becomes of the lines when the driving process ends. Must not know: boards,
messages, SPI; which levels are safe (they come as the kernel's bytes).

It cuts by one ioctl with one buffer, which was made before it began. It outlives the driving
process: when that ends, however it ends, it cuts and is over. The lines are free then for whoever
makes the board safe. It learns of the end in three ways, of which the first counts: the mark that
the kernel sets as the driving thread dies, read with each check; the end of the socket; and the
pidfd, which no child that inherited the socket can hold open.
"""

from __future__ import annotations

import fcntl
import gc
import os
import select
import socket
import time
from pathlib import Path
from typing import Any

from etd_hal.cutlatch import SIZE
from etd_hal.linux import realtime, side_process, uapi
from etd_hal.linux.death_mark import DeathMark
from etd_hal.shared_memory import SharedMemory
from etd_hal.stopper import PERIOD_NS, Stopper
from etd_hal.supply_note import SupplyNote


def main(
    control: int,
    latch: int,
    lines: int,
    engine: int,
    mark: int,
    values: bytes,
    note: str | None,
    priority: int | None,
    scan_core: int | None,
) -> None:
    """File descriptors: of the socket, the latch's memory, the outputs' request, the driving
    process, the mark of its death. Never returns.
    """
    of_engine = DeathMark(mark)
    refusals = (*realtime.set_up_beside(priority, scan_core), of_engine.why_not_held)
    connection = side_process.begin(control, refusals)
    memory, safe_levels = SharedMemory(SIZE, latch), bytearray(values)

    def cut_off() -> None:
        fcntl.ioctl(lines, uapi.GPIO_V2_LINE_SET_VALUES, safe_levels)

    kept = None if note is None else SupplyNote(Path(note))
    stopper = Stopper(memory.words, time.monotonic_ns, cut_off, kept)
    try:
        watch(connection, stopper, engine, of_engine)
    finally:
        stopper.cut()
        # By itself: the end of a process takes milliseconds, and its files come last.
        os.close(lines)
        stopper.note_supply()
        side_process.finish()


def watch(connection: socket.socket, stopper: Stopper, engine: int, mark: DeathMark) -> None:
    """Checks while it is needed, else waits; until the driving process has ended."""
    gc.disable()
    ends: tuple[Any, ...] = (connection, engine)
    pause_s: float | None = None
    while True:
        ready: list[object] = select.select(ends, (), (), pause_s)[0]
        if mark.is_set or engine in ready:
            return
        if ready:
            told = connection.recv(1)
            if not told:
                return
            pause_s = PERIOD_NS / 1e9 if told == side_process.NEEDED else None
        stopper.check()
