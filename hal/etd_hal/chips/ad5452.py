"""AD5452, the 12-bit current-output DAC that sets the pulse current.

Owns: its 16-bit word. Must not know: currents, messages, timing, switches.

Datasheet rev. G: C1 C0, D11..D0, two bits that do not count, MSB first. Control 00 loads and
updates on the rising edge of SYNC; 11 would freeze the output until power goes.
"""

from __future__ import annotations

#: Control bits 00 and the two unused ones: nothing else may ever be sent.
_MASK = 0x3FFC
_CODES = 4096


def word(code: int) -> bytes:
    """The two bytes, as sent, that load `code`.

    Raises: ValueError for a code the DAC does not have. It is never masked into range: 4096 would
    turn into 0, and 0x3000 into the command that freezes the present current.
    """
    if not 0 <= code < _CODES:
        raise ValueError(f"DAC code {code} is outside 0..{_CODES - 1}")
    return ((code << 2) & _MASK).to_bytes(2, "big")
