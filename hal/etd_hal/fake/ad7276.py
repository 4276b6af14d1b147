"""An AD7276 on the wire: samples when CS falls, then shifts the result out.

Owns: the frame of a conversion. Typed from the datasheet, for the fake only.
Must not know: what the voltage is of.

Datasheet facts used (rev. C): track-to-hold on CS falling; two leading zeros, twelve bits, then
zeros; CS raised between the 2nd and the 10th falling edge powers it down, and the conversion
after that is not valid.
"""

from __future__ import annotations

_ONE_BIT_EARLY_MODE = 3
_POWER_DOWN_CLOCKS = range(2, 10)


class Ad7276:
    def __init__(self) -> None:
        self._frame = 0
        self._clocks = 0
        self._powered_down = False

    def select(self, code: int) -> None:
        """CS falls while the input stands at `code` (0..4095)."""
        self._clocks = 0
        self._frame = 0 if self._powered_down else code << 2
        self._powered_down = False

    def shift(self, byte_count: int, mode: int) -> bytes:
        """What a master in SPI mode `mode` reads in the next `byte_count` bytes."""
        bits = 8 * byte_count
        early = 1 if mode == _ONE_BIT_EARLY_MODE else 0
        long_frame = self._frame << (early + 48)
        shift = 64 - self._clocks - bits
        self._clocks += bits
        word = (long_frame >> shift) & ((1 << bits) - 1) if shift >= 0 else 0
        return word.to_bytes(byte_count, "big")

    def deselect(self) -> None:
        self._powered_down = self._clocks in _POWER_DOWN_CLOCKS
