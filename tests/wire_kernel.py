"""Stand-ins for the kernel's end of an ioctl: they read the structures as the kernel would.

Owns: spidev's and gpio's side of the wire, typed from the kernel's headers and not from our code.
Must not know: the drivers under test.
"""

from __future__ import annotations

import ctypes
import struct
from dataclasses import dataclass, field


@dataclass
class SentTransfer:
    tx: bytes
    speed_hz: int
    delay_us: int
    bits: int
    cs_change: int
    has_buffers: bool


@dataclass
class Spidev:
    """Takes SPI_IOC_MESSAGE(n); answers each byte with its complement, so that rx is never tx."""

    requests: list[int] = field(default_factory=list)
    messages: list[list[SentTransfer]] = field(default_factory=list)
    addresses: list[int] = field(default_factory=list)
    fail_errno: int = 0
    lose_bytes: int = 0
    is_open: bool = True

    def fileno(self) -> int:
        return 77

    def close(self) -> None:
        self.is_open = False

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> int:
        assert fd == 77
        if self.fail_errno:
            raise OSError(self.fail_errno, "as told")
        self.requests.append(request)
        size = request >> 16 & 0x3FFF
        assert size == len(buffer)
        self.addresses.append(int.from_bytes(buffer[:8], "little"))
        message = [self._play(part) for part in struct.iter_unpack("<QQIIHBBBBBB", buffer)]
        self.messages.append(message)
        return sum(len(transfer.tx) for transfer in message) - self.lose_bytes

    def _play(self, part: tuple[int, ...]) -> SentTransfer:
        tx_buf, rx_buf, length, speed_hz, delay_us, bits, cs_change, *rest = part
        assert rest == [0, 0, 0, 0]
        tx = ctypes.string_at(tx_buf, length) if tx_buf else b""
        if rx_buf:
            ctypes.memmove(rx_buf, bytes(byte ^ 0xFF for byte in tx), length)
        has_buffers = bool(tx_buf or rx_buf)
        return SentTransfer(tx, speed_hz, delay_us, bits, cs_change, has_buffers)


@dataclass
class HeldRequest:
    """A line request of the GPIO character device: levels by line, bits in order of request."""

    fd: int
    offsets: list[int]
    levels: dict[int, int]
    fail_errno: int = 0
    writes: list[dict[int, int]] = field(default_factory=list)

    def release(self) -> None:
        self.fd = -1

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> int:
        assert fd == self.fd
        if self.fail_errno:
            raise OSError(self.fail_errno, "as told")
        bits, mask = struct.unpack("<QQ", buffer)
        asked = [(at, line) for at, line in enumerate(self.offsets) if mask >> at & 1]
        if request == 0xC010B40F:
            self.writes.append({line: bits >> at & 1 for at, line in asked})
            self.levels |= self.writes[-1]
        else:
            assert request == 0xC010B40E
            bits = sum(self.levels[line] << at for at, line in asked)
            buffer[:] = struct.pack("<QQ", bits, mask)
        return 0
