"""The processes beside the scan's on the kernel's drivers.

Owns: what each inherits. Must not know: what they do, when they are needed.
"""

from __future__ import annotations

from etd_hal.cutlatch import CutLatch
from etd_hal.linux.gpio import LinuxGpio
from etd_hal.linux.side_process import SideProcess
from etd_hal.ports import Changes


class LinuxBeside:
    """See `backend.Beside`."""

    def __init__(self, gpio: LinuxGpio, i2c_device: str | None) -> None:
        self._gpio = gpio
        self._i2c_device = i2c_device

    def stopper(
        self, latch: CutLatch, safe_changes: Changes, priority: int | None, scan_core: int | None
    ) -> SideProcess:
        lines, memory = self._gpio.output_fd, latch.memory.fd
        values = self._gpio.values_of(safe_changes)
        return SideProcess(
            "the stopper",
            "etd_hal.linux.stopper_process",
            (memory, lines, values, priority, scan_core),
            (memory, lines),
        )

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
