"""The processes beside the scan's on the kernel's drivers.

Owns: what each inherits. Must not know: what they do, when they are needed.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Protocol

from etd_hal.cutlatch import CutLatch
from etd_hal.linux import death_mark
from etd_hal.linux.side_process import SideProcess
from etd_hal.ports import Changes


class OutputLines(Protocol):
    """The request for the outputs, which a process beside inherits."""

    @property
    def output_fd(self) -> int: ...

    def values_of(self, changes: Changes) -> bytes: ...


class LinuxBeside:
    """See `backend.Beside`."""

    def __init__(self, gpio: OutputLines, i2c_device: str | None) -> None:
        self._gpio = gpio
        self._i2c_device = i2c_device

    def stopper(
        self,
        latch: CutLatch,
        safe_changes: Changes,
        note: Path | None,
        priority: int | None,
        scan_core: int | None,
    ) -> SideProcess:
        values = self._gpio.values_of(safe_changes)
        kept = None if note is None else os.fspath(note)
        return stopper_process(latch, self._gpio.output_fd, values, kept, priority, scan_core)

    def sensors(
        self,
        module: str,
        arguments: tuple[object, ...],
        fds: tuple[int, ...],
        scan_core: int | None,
    ) -> SideProcess:
        return SideProcess(
            "the sensors",
            "etd_hal.linux.sensor_process",
            (self._i2c_device, scan_core, module, arguments),
            fds,
        )


def stopper_process(
    latch: CutLatch,
    lines: int,
    values: bytes,
    note: str | None,
    priority: int | None,
    scan_core: int | None,
) -> SideProcess:
    """On the outputs' request `lines`. It watches the calling thread, and its process. Raises:
    OSError.
    """
    engine = os.pidfd_open(os.getpid())
    try:
        fds = (latch.memory.fd, lines, engine, death_mark.take())
        return SideProcess(
            "the stopper",
            "etd_hal.linux.stopper_process",
            (*fds, values, note, priority, scan_core),
            fds,
        )
    finally:
        os.close(engine)
