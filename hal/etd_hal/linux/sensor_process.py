"""The process that reads the sensors: an ordinary one, with the I2C bus and nothing else of the
board.

Owns: its bus, its clock, and when it ends. Must not know: which sensors there are, who reads them.
"""

from __future__ import annotations

import select
from importlib import import_module

from etd_hal.linux import realtime, side_process
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.i2c import open_i2c


def main(
    control: int,
    device: str | None,
    scan_core: int | None,
    module: str,
    arguments: tuple[object, ...],
) -> None:
    """`control`: file descriptor of the socket. Never returns; see `backend.Beside.sensors`."""
    i2c = None if device is None else open_i2c(device)
    connection = side_process.begin(control, realtime.set_up_beside(None, scan_core))

    def is_over(wait_s: float) -> bool:
        return bool(select.select([connection], (), (), wait_s)[0])

    try:
        import_module(module).main(i2c, LinuxClock(), is_over, *arguments)
    finally:
        side_process.finish()
