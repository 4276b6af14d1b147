"""ADS1115, the slow 16-bit ADC that watches the rail and reads sensors.

Owns: its registers and the volts of a code. Must not know: dividers, what is measured.

Registers 0 conversion, 1 config; big-endian. One conversion takes at least 1.16 ms (860 a
second), so it sees rails and pressures, never a pulse. Four inputs share one converter: whose
result it is, and whether it is there, is asked of the config register before it is taken.
"""

from __future__ import annotations

from collections.abc import Callable

from etd_hal.errors import BusError
from etd_hal.ports import I2c

_CONVERSION, _CONFIG = 0, 1
#: OS 1 (start; read back it says that none is under way), MUX single-ended, PGA 4.096 V, MODE
#: single shot, DR 860/s, comparator off.
_START = 0x8000
_SINGLE_ENDED = (0x4000, 0x5000, 0x6000, 0x7000)
_PGA_4096_MV = 0x0200
_SINGLE_SHOT = 0x0100
_RATE_860 = 0x00E0
_COMPARATOR_OFF = 0x0003
_FULL_SCALE_V = 4.096
#: One old and one new period at 860 a second, and a tenth.
CONVERSION_NS = 2_600_000
#: So many times a result is asked for, a conversion apart, before the chip is given up.
_TRIES = 5
#: A conversion that is not over by then will not be.
GIVE_UP_NS = _TRIES * CONVERSION_NS


def start(i2c: I2c, address: int, channel: int) -> None:
    """Begin one conversion of `channel` (0..3, against ground). Raises: BusError."""
    i2c.transfer(address, bytes((_CONFIG,)) + _shot_of(channel).to_bytes(2, "big"), 0)


def read_v(i2c: I2c, address: int, channel: int) -> float | None:
    """The volts of the conversion begun by `start`; None while it lasts.

    Raises: BusError, also (`io`) where the chip did another conversion than that of `channel`:
    somebody else began one, or it lost its supply. What it holds is then of something else.
    """
    config = int.from_bytes(i2c.transfer(address, bytes((_CONFIG,)), 2), "big")
    if config | _START != _shot_of(channel):
        detail = (
            f"its config register says 0x{config:04x}, so its result is not of channel {channel}:"
            " somebody else uses this chip, or it lost its supply"
        )
        raise BusError("io", _name(address), "reading a result", detail)
    if not config & _START:
        return None
    received = i2c.transfer(address, bytes((_CONVERSION,)), 2)
    return int.from_bytes(received, "big", signed=True) * _FULL_SCALE_V / 32_768


def convert_v(i2c: I2c, address: int, channel: int, wait_ns: Callable[[int], object]) -> float:
    """One conversion from its beginning to its end; `wait_ns` waits for so long.

    Raises: BusError (`timeout`: it does not end).
    """
    start(i2c, address, channel)
    for _ in range(_TRIES):
        wait_ns(CONVERSION_NS)
        volts = read_v(i2c, address, channel)
        if volts is not None:
            return volts
    raise unfinished(address)


def unfinished(address: int) -> BusError:
    """What to say of a conversion that does not end."""
    return BusError("timeout", _name(address), "converting", "its conversion does not end")


def _shot_of(channel: int) -> int:
    return (
        _START | _SINGLE_ENDED[channel] | _PGA_4096_MV | _SINGLE_SHOT | _RATE_860 | _COMPARATOR_OFF
    )


def _name(address: int) -> str:
    return f"the ADS1115 at 0x{address:02x}"
