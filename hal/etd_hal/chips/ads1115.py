"""ADS1115, the slow 16-bit ADC that watches the rail and reads sensors.

Owns: its registers and the volts of a code. Must not know: dividers, what is measured.

Registers 0 conversion, 1 config; big-endian. One conversion takes at least 1.16 ms (860 a
second), so it sees rails and pressures, never a pulse.
"""

from __future__ import annotations

from etd_hal.ports import I2c

_CONVERSION, _CONFIG = 0, 1
#: OS 1 (start), MUX single-ended, PGA 4.096 V, MODE single shot, DR 860/s, comparator off.
_START = 0x8000
_SINGLE_ENDED = (0x4000, 0x5000, 0x6000, 0x7000)
_PGA_4096_MV = 0x0200
_SINGLE_SHOT = 0x0100
_RATE_860 = 0x00E0
_COMPARATOR_OFF = 0x0003
_FULL_SCALE_V = 4.096
#: One old and one new period at 860 a second, and a tenth.
CONVERSION_NS = 2_600_000


def start(i2c: I2c, address: int, channel: int) -> None:
    """Begin one conversion of `channel` (0..3, against ground). Raises: BusError."""
    config = (
        _START | _SINGLE_ENDED[channel] | _PGA_4096_MV | _SINGLE_SHOT | _RATE_860 | _COMPARATOR_OFF
    )
    i2c.transfer(address, bytes((_CONFIG,)) + config.to_bytes(2, "big"), 0)


def read_v(i2c: I2c, address: int) -> float:
    """The volts of the last conversion, begun at least CONVERSION_NS ago. Raises: BusError."""
    received = i2c.transfer(address, bytes((_CONVERSION,)), 2)
    return int.from_bytes(received, "big", signed=True) * _FULL_SCALE_V / 32_768
