"""An AD5452 on the wire: 16-bit serial word, control bits, update when SYNC rises.

Owns: the chip's shift register and what a frame does. Typed from the datasheet, for the fake only.
Must not know: the driver's encoding, what the current does.

Datasheet facts used (rev. G): C1 C0, then D11..D0, then two bits without meaning; shifted on SCLK
falling edges after power-up; 00 loads and updates on SYNC rising; 01 and 10 are reserved; 11
changes to rising edges until power is removed; a short frame is taken as valid, its missing bits
being what the frame before left; zero scale at power-up.
"""

from __future__ import annotations

from collections.abc import Callable

_SHIFTS_LATE_WHEN_FALLING = 3
_SHIFTS_LATE_WHEN_RISING = 1
#: The master changes data on the edge that the chip samples: after the bit (0), or before it (3).
_RACES_WHEN_FALLING = (0, 3)


class Ad5452:
    """`on_code(t_ns, code)` is called when the output is updated; `complain` for what is wrong."""

    def __init__(
        self,
        on_code: Callable[[int, int], None],
        complain: Callable[[int, str], None],
    ) -> None:
        self._on_code = on_code
        self._complain = complain
        self._register = 0
        self._data_level = 0
        self._clocks = 0
        self._rising = False

    def select(self) -> None:
        """SYNC falls."""
        self._clocks = 0

    def shift(self, data: bytes, mode: int, is_hold_short: bool = False) -> None:
        """Clock `data` in, most significant bit first, by a master in SPI mode `mode`.

        `is_hold_short`: of data that changes on the edge that is sampled, the new is taken.
        """
        bits = 8 * len(data)
        word = int.from_bytes(data, "big")
        last = word & 1
        if is_hold_short and not self._rising and mode in _RACES_WHEN_FALLING:
            # Mode 0 has the next bit then, and nothing after the last; mode 3 has its own.
            word = (word << 1) & ((1 << bits) - 1) if mode == 0 else word
        elif self._samples_before_the_first_bit(mode):
            word = (self._data_level << (bits - 1)) | (word >> 1)
        self._register = ((self._register << bits) | word) & 0xFFFF
        self._data_level = last
        self._clocks += bits

    def deselect(self, t_ns: int) -> None:
        """SYNC rises: execute what is in the register."""
        if not self._clocks:
            return
        if self._clocks != 16:
            self._complain(t_ns, f"a DAC frame of {self._clocks} clocks")
        control = self._register >> 14
        if control == 0:
            self._on_code(t_ns, (self._register >> 2) & 0xFFF)
        elif control == 3:
            self._rising = True
            self._complain(t_ns, "a DAC word that changes the clock edge: the output is stuck")
        else:
            self._complain(t_ns, f"a DAC word with reserved control bits {control:02b}")

    def _samples_before_the_first_bit(self, mode: int) -> bool:
        """Whether the master puts the first bit out on the very edge that the chip samples."""
        late = _SHIFTS_LATE_WHEN_RISING if self._rising else _SHIFTS_LATE_WHEN_FALLING
        return mode == late
