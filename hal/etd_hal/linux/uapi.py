"""The kernel's structures for SPI messages and GPIO values, as bytes.

Owns: layouts and request numbers of `linux/spi/spidev.h` and `linux/gpio.h` (version 2); they are
the same on 64-bit ARM and x86. Must not know: files, devices, who asks.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

#: tx_buf, rx_buf, len, speed_hz, delay_usecs, bits_per_word, cs_change, tx_nbits, rx_nbits,
#: word_delay_usecs, pad.
_SPI_IOC_TRANSFER = struct.Struct("=QQIIHBBBBBB")
#: bits, mask: bit i is the i-th line of the request.
_GPIO_V2_LINE_VALUES = struct.Struct("=QQ")

TRANSFER_BYTES = _SPI_IOC_TRANSFER.size
#: With 512, the size field of the request number wraps to 0: accepted, and nothing is sent.
MAX_TRANSFERS = 511
MAX_DELAY_US = 0xFFFF
#: spidev's bounce buffer, and what each transfer's share of it is rounded up to on 64-bit ARM.
BOUNCE_BYTES = 4096
BOUNCE_ALIGN_BYTES = 128

GPIO_V2_LINE_GET_VALUES = 0xC010B40E
GPIO_V2_LINE_SET_VALUES = 0xC010B40F

_SPI_IOC_MESSAGE_0 = 0x40006B00
_SIZE_SHIFT = 16


def spi_ioc_message(transfers: int) -> int:
    """The request number for a message of so many transfers.

    Raises: ValueError outside 1..511, where the number would say "zero bytes".
    """
    if not 1 <= transfers <= MAX_TRANSFERS:
        raise ValueError(f"a message has 1..{MAX_TRANSFERS} transfers, not {transfers}")
    return _SPI_IOC_MESSAGE_0 | (transfers * TRANSFER_BYTES) << _SIZE_SHIFT


def spi_ioc_transfer(
    *, tx: int, rx: int, length: int, speed_hz: int, delay_us: int, cs_change: bool
) -> bytes:
    """One transfer of 8-bit words; `tx` and `rx` are addresses, 0 for none."""
    return _SPI_IOC_TRANSFER.pack(tx, rx, length, speed_hz, delay_us, 8, int(cs_change), 0, 0, 0, 0)


def bounce_bytes(lengths: Iterable[int]) -> int:
    """How much of spidev's buffer transfers of these lengths take, as 64-bit ARM counts."""
    return sum(-(-length // BOUNCE_ALIGN_BYTES) * BOUNCE_ALIGN_BYTES for length in lengths)


def line_values(values: Iterable[tuple[int, int]]) -> bytearray:
    """A `gpio_v2_line_values` of (bit, level) pairs, ready for the ioctl."""
    bits = mask = 0
    for bit, level in values:
        mask |= 1 << bit
        bits |= (1 if level else 0) << bit
    return bytearray(_GPIO_V2_LINE_VALUES.pack(bits, mask))


def level_of(values: bytearray, bit: int) -> int:
    """The level of one bit in what GET_VALUES filled in."""
    bits: int = _GPIO_V2_LINE_VALUES.unpack(values)[0]
    return bits >> bit & 1
