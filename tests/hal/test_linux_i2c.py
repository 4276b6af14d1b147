"""I2C transactions as they reach the kernel."""

from __future__ import annotations

import ctypes
import errno
from typing import Any

import pytest

from etd_hal.errors import BusError

pytest.importorskip("smbus2", reason="smbus2 is there on Linux only")

from etd_hal.linux.i2c import LinuxI2c, open_i2c

READ = 1


class Chip:
    """One chip at 0x48 that answers 0x8583 to a read; nobody else is on the bus."""

    def __init__(self, fail_errno: int = 0) -> None:
        self.transactions: list[list[tuple[int, int, bytes]]] = []
        self.is_open = True
        self.fail_errno = fail_errno

    def i2c_rdwr(self, *messages: Any) -> None:
        if self.fail_errno or any(message.addr != 0x48 for message in messages):
            raise OSError(self.fail_errno or errno.EREMOTEIO, "as told")
        for message in messages:
            if message.flags & READ:
                ctypes.memmove(message.buf, b"\x85\x83"[: message.len], message.len)
        self.transactions.append(
            [(message.addr, message.flags, bytes(message)) for message in messages]
        )

    def close(self) -> None:
        self.is_open = False


def test_a_write_and_a_read_are_one_transaction() -> None:
    chip = Chip()
    assert LinuxI2c(chip, "/dev/i2c-1").transfer(0x48, b"\x00", 2) == b"\x85\x83"
    assert chip.transactions == [[(0x48, 0, b"\x00"), (0x48, READ, b"\x85\x83")]]


def test_a_write_alone_sends_no_read_and_a_read_alone_no_write() -> None:
    chip = Chip()
    bus = LinuxI2c(chip, "/dev/i2c-1")
    assert bus.transfer(0x48, b"\x01\xc3\x83", 0) == b""
    assert bus.transfer(0x48, b"", 1) == b"\x85"
    assert chip.transactions == [[(0x48, 0, b"\x01\xc3\x83")], [(0x48, READ, b"\x85")]]


def test_nothing_to_do_is_refused() -> None:
    with pytest.raises(BusError) as caught:
        LinuxI2c(Chip(), "/dev/i2c-1").transfer(0x48, b"", 0)
    assert caught.value.kind == "invalid"


@pytest.mark.parametrize(
    ("address", "number", "kind"),
    [(0x49, 0, "absent"), (0x48, errno.ETIMEDOUT, "timeout"), (0x48, errno.EIO, "io")],
)
def test_nobody_there_and_a_stuck_bus_are_told_apart(address: int, number: int, kind: str) -> None:
    with pytest.raises(BusError, match=f"0x{address:02x}") as caught:
        LinuxI2c(Chip(number), "/dev/i2c-1").transfer(address, b"\x00", 2)
    assert caught.value.kind == kind


def test_a_bus_that_is_not_there_is_absent() -> None:
    with pytest.raises(BusError, match="/dev/i2c-none") as caught:
        open_i2c("/dev/i2c-none")
    assert caught.value.kind == "absent"


def test_closing_closes_the_bus() -> None:
    chip = Chip()
    LinuxI2c(chip, "/dev/i2c-1").close()
    assert not chip.is_open
