"""AD5452, the 12-bit current-output DAC that sets the pulse current.

Owns: its 16-bit word, and how many uA a code is. Must not know: messages, timing, switches.

Datasheet rev. G: C1 C0, D11..D0, two bits that do not count, MSB first. Control 00 loads and
updates on the rising edge of SYNC; 11 would freeze the output until power goes.
"""

from __future__ import annotations

#: Control bits 00 and the two unused ones: nothing else may ever be sent.
_MASK = 0x3FFC


def word(code: int, codes: int = 4096) -> bytes:
    """The two bytes, as sent, that load `code`.

    Raises: ValueError for a code the DAC does not have. It is never masked into range: 4096 would
    turn into 0, and 0x3000 into the command that freezes the present current.
    """
    if not 0 <= code < codes:
        raise ValueError(f"DAC code {code} is outside 0..{codes - 1}")
    return ((code << 2) & _MASK).to_bytes(2, "big")


def code_for(current_ua: int, full_scale_ua: int, codes: int = 4096) -> int:
    """The largest code whose current is not above `current_ua`."""
    return current_ua * (codes - 1) // full_scale_ua


def current_of(code: int, full_scale_ua: int, codes: int = 4096) -> float:
    """What the source is told by `code`, in uA."""
    return code * full_scale_ua / (codes - 1)
