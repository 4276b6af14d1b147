"""The process that reads the sensors: an ordinary one, with the I2C bus and nothing else of the
board. It also reads what the kernel says of the scan's core, since files take their time.

Owns: its bus, its clock, and when it ends. Must not know: which sensors there are, who reads them.
"""

from __future__ import annotations

import os
import select
from functools import partial
from importlib import import_module

from etd_hal.linux import realtime, side_process
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.i2c import open_i2c
from etd_hal.linux.scan_core import scan_core


def main(
    control: int,
    device: str | None,
    core: int | None,
    module: str,
    arguments: tuple[object, ...],
) -> None:
    """`control`: file descriptor of the socket; `core`: the scan's, to be left. Never returns; see
    `backend.Beside.sensors`.
    """
    of_scan = partial(scan_core, os.getppid())
    i2c = None if device is None else open_i2c(device)
    connection = side_process.begin(control, realtime.set_up_beside(None, core))

    def is_over(wait_s: float) -> bool:
        return bool(select.select([connection], (), (), wait_s)[0])

    try:
        import_module(module).main(i2c, LinuxClock(), of_scan, is_over, *arguments)
    finally:
        side_process.finish()
