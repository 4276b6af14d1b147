"""SPI messages through spidev: the package opens and configures, the ioctl sends.

Owns: making a `Message` into ready buffers once, and refusing what the kernel would misread.
Must not know: what the words mean.

The package's own calls send one transfer each and copy lists of numbers; a pulse is one message of
many transfers, and is sent again and again, so it keeps its buffers.
"""

from __future__ import annotations

import ctypes
import fcntl
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from etd_hal.errors import BusError
from etd_hal.linux import uapi
from etd_hal.ports import Message, SpiSetup

#: As fcntl.ioctl: file descriptor, request number, buffer.
Ioctl = Callable[[int, int, bytearray], int]


class Opened(Protocol):
    """An open device: what the spidev package's object is to us."""

    def fileno(self) -> int: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True, eq=False)
class _Ready:
    """A message as the kernel wants it. The transfers point into `data`, which stays put."""

    request: int
    transfers: bytearray
    data: ctypes.Array[ctypes.c_char]
    received: tuple[slice, ...]
    total_bytes: int


def lay_out(message: Message, speed_hz: int, device: str) -> _Ready:
    """Lay the message out in memory. Raises: BusError (invalid, too_long); nothing was sent."""
    _check(message, device)
    total_bytes = sum(len(transfer.tx) for transfer in message.transfers)
    # Sent bytes in the first half, received ones in the second.
    data = ctypes.create_string_buffer(
        b"".join(transfer.tx for transfer in message.transfers), 2 * total_bytes or 1
    )
    base = ctypes.addressof(data)
    transfers = bytearray()
    received: list[slice] = []
    at = 0
    for transfer in message.transfers:
        length = len(transfer.tx)
        transfers += uapi.spi_ioc_transfer(
            tx=base + at if length else 0,
            rx=base + total_bytes + at if length else 0,
            length=length,
            speed_hz=speed_hz,
            delay_us=transfer.delay_us,
            cs_change=transfer.cs_change,
        )
        if length:
            received.append(slice(total_bytes + at, total_bytes + at + length))
        at += length
    request = uapi.spi_ioc_message(len(message.transfers))
    return _Ready(request, transfers, data, tuple(received), total_bytes)


def _check(message: Message, device: str) -> None:
    transfers = message.transfers
    if not 1 <= len(transfers) <= uapi.MAX_TRANSFERS:
        raise _refusal(
            device, f"{len(transfers)} transfers: the kernel takes 1 to {uapi.MAX_TRANSFERS}"
        )
    if transfers[-1].cs_change:
        raise _refusal(device, "cs_change on the last transfer would keep chip select active")
    for transfer in transfers:
        if not 0 <= transfer.delay_us <= uapi.MAX_DELAY_US:
            raise _refusal(device, f"a delay of {transfer.delay_us} us: 0 to {uapi.MAX_DELAY_US}")
    taken = uapi.bounce_bytes(len(transfer.tx) for transfer in transfers)
    if taken > uapi.BOUNCE_BYTES:
        raise BusError(
            "too_long",
            device,
            "SPI message",
            f"its data takes {taken} bytes of the kernel's buffer of {uapi.BOUNCE_BYTES},"
            f" {uapi.BOUNCE_ALIGN_BYTES} for each transfer begun: send at most 32 with data",
        )


def _refusal(device: str, detail: str) -> BusError:
    return BusError("invalid", device, "SPI message", detail)


class LinuxSpi:
    """The Spi port on an open spidev device, which it closes."""

    def __init__(
        self, opened: Opened, device: str, speed_hz: int, ioctl: Ioctl = fcntl.ioctl
    ) -> None:
        self._opened = opened
        self._fd = opened.fileno()
        self._device = device
        self._speed_hz = speed_hz
        self._ioctl = ioctl

    def prepare(self, message: Message) -> None:
        """See `ports.Spi`: lay it out in memory, which the message keeps."""
        if self not in message.made:
            self._lay_out(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        """See `ports.Spi`. A message that is prepared costs one look-up and one ioctl."""
        ready: _Ready = message.made.get(self) or self._lay_out(message)
        try:
            sent = self._ioctl(self._fd, ready.request, ready.transfers)
        except OSError as error:
            raise BusError.of(error, self._device, "SPI message") from error
        if sent != ready.total_bytes:
            detail = f"{sent} of {ready.total_bytes} bytes"
            raise BusError("short", self._device, "SPI message", detail)
        raw = ready.data.raw
        return tuple(raw[part] for part in ready.received)

    def close(self) -> None:
        """Idempotent."""
        self._fd = -1
        self._opened.close()

    def _lay_out(self, message: Message) -> _Ready:
        ready = message.made[self] = lay_out(message, self._speed_hz, self._device)
        return ready


def open_spi(setup: SpiSetup) -> LinuxSpi:
    """Open and configure: mode, speed, 8-bit words (the Pi's controller takes no others).

    Raises: BusError (absent, permission, invalid).
    """
    # Here, because messages are made and tested where this package cannot be built.
    import spidev

    device = spidev.SpiDev()
    try:
        device.open_path(setup.device)
        # Sets the two clock bits and leaves the others, CS_HIGH among them, as they were read.
        device.mode = setup.mode
        device.bits_per_word = 8
        device.max_speed_hz = setup.speed_hz
    except OSError as error:
        device.close()
        raise BusError.of(error, setup.device, "opening") from error
    return LinuxSpi(device, setup.device, setup.speed_hz)
