"""AD7276, the 12-bit ADC on the source's node.

Owns: its 16-bit frame and the check that it is one. Must not know: what the node's volts mean.

Datasheet rev. C: samples on the falling edge of CS; two leading zeros, 12 bits MSB first, zeros.
"""

from __future__ import annotations

from functools import cache

from etd_hal.errors import BoardFault

_NOT_DATA = 0xC003


@cache
def code_of(received: bytes) -> int:
    """The sample in a received word, 0..4095. There are as many, so each is decoded once.

    Raises: BoardFault if the leading or trailing bits are not zero: a floating MISO reads 0xFFFF,
    and a wrong SPI mode moves the word by one bit.
    """
    word = int.from_bytes(received, "big")
    if len(received) != 2 or word & _NOT_DATA:
        raise BoardFault(
            "AD7276 frame", received.hex() or "nothing", "two leading and two trailing zero bits"
        )
    return word >> 2
