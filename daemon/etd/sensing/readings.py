"""The last value of each slow sensor, with its time, and what is wrong with it: in memory that two
processes share.

Owns: the layout, and that a reader never takes half a value. Must not know: what is measured, who
reads the sensors.

One process writes, another reads, without a lock and in whatever order the processor makes the
words visible. A value and its time carry a third word that only fits the two of them, and a text
carries a checksum: where they do not fit, the last one that did stands, with its own time, until
the next look.
"""

from __future__ import annotations

import struct
import zlib

from etd_hal.shared_memory import WORD_BYTES, SharedMemory

#: Of a slot: the time (0: no value), the value, and what fits both.
_WORDS = 3
#: Of a slot's text: checksum, length, time; then UTF-8, cut off where it is longer.
_HEAD = struct.Struct("=IIq")
_TEXT_BYTES = 480
_SLOT_BYTES = _WORDS * WORD_BYTES + _HEAD.size + _TEXT_BYTES
_DOUBLE, _WORD = struct.Struct("=d"), struct.Struct("=q")
_SPREAD, _MASK = 0x9E3779B97F4A7C15, (1 << 63) - 1

Value = tuple[float, int]
Text = tuple[str, int]


class Readings:
    """A slot for each sensor. Made by the reader; the writer gets its memory."""

    def __init__(self, count: int, memory: SharedMemory | None = None) -> None:
        self.memory = SharedMemory(self.size(count)) if memory is None else memory
        self._words, self._bytes = self.memory.words, self.memory.bytes
        # As read last; the reader's own.
        self._checks: list[int] = [0] * count
        self._values: list[Value | None] = [None] * count
        self._texts: list[Text] = [("", 0)] * count

    @staticmethod
    def size(count: int) -> int:
        """In bytes."""
        return count * _SLOT_BYTES

    # --- the writer ------------------------------------------------------------------------------

    def put(self, slot: int, value: float, t_ns: int) -> None:
        """The latest value, and when it was read."""
        words, at = self._words, slot * _SLOT_BYTES // WORD_BYTES
        (bits,) = _WORD.unpack(_DOUBLE.pack(value))
        words[at], words[at + 1], words[at + 2] = t_ns, bits, _check(t_ns, bits)

    def lose(self, slot: int) -> None:
        """There is no valid value any more."""
        self.put(slot, 0.0, 0)

    def tell(self, slot: int, text: str, t_ns: int) -> None:
        """What is wrong, and since when; "" for nothing."""
        said = text.encode()[:_TEXT_BYTES]
        body = _HEAD.pack(0, len(said), t_ns)[4:] + said
        begin = slot * _SLOT_BYTES + _WORDS * WORD_BYTES
        self._bytes[begin : begin + 4 + len(body)] = zlib.crc32(body).to_bytes(4, "little") + body

    # --- the reader ------------------------------------------------------------------------------

    def latest(self, slot: int) -> Value | None:
        """The value and its time; None where there is none."""
        words, at = self._words, slot * _SLOT_BYTES // WORD_BYTES
        check = words[at + 2]
        if check != self._checks[slot]:
            t_ns, bits = words[at], words[at + 1]
            if check == _check(t_ns, bits):
                (value,) = _DOUBLE.unpack(_WORD.pack(bits))
                self._checks[slot] = check
                self._values[slot] = (value, t_ns) if t_ns else None
        return self._values[slot]

    def told(self, slot: int) -> Text:
        """The text, and since when it holds; "" for nothing."""
        begin = slot * _SLOT_BYTES + _WORDS * WORD_BYTES
        found = bytes(self._bytes[begin : begin + _HEAD.size + _TEXT_BYTES])
        checksum, length, t_ns = _HEAD.unpack_from(found)
        if length <= _TEXT_BYTES and checksum == zlib.crc32(found[4 : _HEAD.size + length]):
            text = found[_HEAD.size : _HEAD.size + length].decode(errors="ignore")
            self._texts[slot] = (text, t_ns)
        return self._texts[slot]


def _check(t_ns: int, bits: int) -> int:
    """Another for another value or another time: both spread over all bits."""
    return (t_ns * _SPREAD + bits * 3 + 1) & _MASK
