"""The stopper as a process: it holds the output lines too, and needs no lock of any other.

Owns: its loop, and what becomes of the lines when the driving process ends. Must not know: boards,
messages, SPI; which levels are safe (they come as the kernel's bytes).

It cuts by one ioctl with one buffer, which was made before it began. When the driving process ends,
however it ends, it cuts and is over: the lines are free then for whoever makes the board safe.
"""

from __future__ import annotations

import fcntl
import gc
import os
import select
import socket
import time

from etd_hal.cutlatch import SIZE
from etd_hal.linux import realtime, side_process, uapi
from etd_hal.shared_memory import SharedMemory
from etd_hal.stopper import PERIOD_NS, Stopper


def main(
    control: int, latch: int, lines: int, values: bytes, priority: int | None, scan_core: int | None
) -> None:
    """File descriptors: of the socket, the latch's memory, the outputs' request. Never returns."""
    connection = side_process.begin(control, realtime.set_up_beside(priority, scan_core))
    memory, safe_levels = SharedMemory(SIZE, latch), bytearray(values)

    def cut_off() -> None:
        fcntl.ioctl(lines, uapi.GPIO_V2_LINE_SET_VALUES, safe_levels)

    stopper = Stopper(memory.words, time.monotonic_ns, cut_off)
    try:
        watch(connection, stopper)
    finally:
        stopper.cut()
        # By itself: the end of a process takes milliseconds, and its files come last.
        os.close(lines)
        side_process.finish()


def watch(connection: socket.socket, stopper: Stopper) -> None:
    """Checks while it is needed, else waits; until the other end is closed."""
    gc.disable()
    pause_s: float | None = None
    while True:
        if select.select([connection], (), (), pause_s)[0]:
            told = connection.recv(1)
            if not told:
                return
            pause_s = PERIOD_NS / 1e9 if told == side_process.NEEDED else None
        stopper.check()
