"""I2C transactions through smbus2.

Owns: a write and a read as one transaction. Must not know: which chip answers.
"""

from __future__ import annotations

from typing import Protocol

from smbus2 import SMBus, i2c_msg

from etd_hal.errors import BusError


class Bus(Protocol):
    """An open bus: what smbus2's SMBus is to us."""

    def i2c_rdwr(self, *i2c_msgs: i2c_msg) -> None: ...

    def close(self) -> None: ...


class LinuxI2c:
    """The I2c port on an open bus, which it closes."""

    def __init__(self, bus: Bus, device: str) -> None:
        self._bus = bus
        self._device = device

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        """See `ports.I2c`."""
        operation = f"I2C transfer with 0x{address:02x}"
        if not write and not read_length:
            raise BusError("invalid", self._device, operation, "nothing to write and to read")
        messages = [i2c_msg.write(address, write)] if write else []
        if read_length:
            messages.append(i2c_msg.read(address, read_length))
        try:
            self._bus.i2c_rdwr(*messages)
        except OSError as error:
            raise BusError.of(error, self._device, operation) from error
        return bytes(messages[-1]) if read_length else b""

    def close(self) -> None:
        """Idempotent."""
        self._bus.close()


def open_i2c(device: str) -> LinuxI2c:
    """Open the bus `device`, a path. Raises: BusError (absent, permission)."""
    try:
        return LinuxI2c(SMBus(device), device)
    except OSError as error:
        raise BusError.of(error, device, "opening") from error
