"""What each call costs on a Raspberry Pi 4, in nanoseconds: the fake's only source of durations.

Owns: the figures. Must not know: boards, chips, clocks.

The figures are a model, not a measurement. They are put together from the delay rules of the
kernel's SPI core (delays up to 10 us are busy-waited, longer ones slept), the byte timing of the
spi-bcm2835 driver (9 clock periods a byte), and published times of single GPIO calls.
"""

from __future__ import annotations

#: One set or get call on GPIO lines.
GPIO_CALL_NS = 4_400
#: From the start of the call to the change of its first line, and from line to line.
GPIO_FIRST_LINE_NS = 3_000
GPIO_NEXT_LINE_NS = 50

#: An SPI message before its first chip select, and after its last.
MESSAGE_BEFORE_NS = 5_000
MESSAGE_AFTER_NS = 3_000
CS_FALL_NS = 400
CS_TO_CLOCK_NS = 3_000
CS_RISE_NS = 700
#: `cs_change`: chip select stays inactive for this long; spidev cannot choose.
CS_CHANGE_NS = 10_000
#: A transfer without data, on top of its delay.
EMPTY_TRANSFER_NS = 300

_CLOCKS_PER_BYTE = 9
_LONGEST_BUSY_WAIT_US = 10
_OVERSLEEP_NS = 50_000
_LAYOUT_NS = 48_000
_LAYOUT_TRANSFER_NS = 4_000
_I2C_BIT_NS = 10_000
_I2C_CALL_NS = 40_000


def clocking_ns(byte_count: int, speed_hz: int) -> int:
    """How long `byte_count` bytes take on the wire."""
    return round(_CLOCKS_PER_BYTE * byte_count * 1_000_000_000 / speed_hz)


def delay_ns(delay_us: int) -> int:
    """A delay inside a message: exact up to 10 us, above that slept, and overslept."""
    if delay_us <= _LONGEST_BUSY_WAIT_US:
        return delay_us * 1_000
    return delay_us * 1_100 + _OVERSLEEP_NS


def layout_ns(transfer_count: int) -> int:
    """Laying a message out in memory: what the driver computes the first time that it is sent.

    Measured in an engine's loop on PCs: 16 to 29 us for a pulse of 11 transfers, 23 to 45 us for
    one of 21. A Pi 4 is assumed to be 4 times slower (docs/benchmarks.md).
    """
    return _LAYOUT_NS + _LAYOUT_TRANSFER_NS * transfer_count


def i2c_ns(write_length: int, read_length: int) -> int:
    """A transaction at 100 kHz: 9 bits a byte, the address once or (with a restart) twice."""
    addresses = bool(write_length) + bool(read_length)
    bits = 9 * (write_length + read_length + addresses) + addresses + 1
    return _I2C_CALL_NS + bits * _I2C_BIT_NS
