"""Inputs from inputs: what a fuzzer does that sees no coverage.

Owns: the changes, and the words that a format is made of. Must not know: targets, time.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterable, Sequence

#: Names and words of a format, also within msgpack.
_WORD = re.compile(rb"[A-Za-z_][A-Za-z0-9_-]{2,40}")
_ODD = (
    *(b"\0", b"\xff", b"\x80", b"[", b"]", b"{", b"}", b'"', b"\n", b"=", b"-", b"."),
    *(b"nan", b"inf", b"null", b"true", b"1e999", b"\\ud800", b"-1", b"256", b"65536"),
    *(
        b"9223372036854775807",
        b"9223372036854775808",
        b"\x7f\xf8\0\0\0\0\0\0",
        b"\xcf" + b"\xff" * 8,
    ),
)
_NUMBER = re.compile(rb"-?\d[\d_.]*")
_NUMBERS = (
    *(b"0", b"-1", b"1", b"2", b"19", b"100", b"201", b"256", b"1001", b"10001", b"65536"),
    *(b"0.0", b"-0.5", b"0.5", b"1.5", b"200.5", b"1e9", b"1e999", b"nan", b"9223372036854775808"),
)
_MOST_WORDS = 400
#: Mostly one: what is spoiled in many places is refused for the first.
_CHANGES = (1, 1, 1, 2, 3, 6)


def words(seeds: Iterable[bytes]) -> tuple[bytes, ...]:
    """Each once, in the order of its first appearance."""
    found = dict.fromkeys(word for seed in seeds for word in _WORD.findall(seed))
    return (*list(found)[:_MOST_WORDS], *_ODD)


class Mutator:
    """The same `seed` makes the same inputs, one after another."""

    def __init__(self, seeds: Sequence[bytes], most_bytes: int, seed: int) -> None:
        self._seeds = list(seeds) or [b""]
        self._words = words(seeds)
        self._most_bytes = most_bytes
        self._dice = random.Random(seed)

    def next(self) -> bytes:
        return self.changed(self._dice.choice(self._seeds))

    def is_heads(self) -> bool:
        return self._dice.random() < 0.5

    def changed(self, before: bytes) -> bytes:
        data = bytearray(before)
        for _ in range(self._dice.choice(_CHANGES)):
            self._change(data)
        return bytes(data[: self._most_bytes])

    def _change(self, data: bytearray) -> None:
        dice = self._dice
        at = dice.randint(0, len(data))
        end = min(len(data), at + dice.choice((1, 1, 2, 4, 16, 64)))
        match dice.randrange(9):
            case 0:
                data[at:end] = dice.choice(self._words)
            case 1:
                data[at:at] = dice.choice(self._words)
            case 2:
                data[at:end] = b""
            case 3:
                data[at:at] = data[at:end] * dice.choice((1, 2, 50))
            case 4:
                other = dice.choice(self._seeds)
                begin = dice.randint(0, len(other))
                data[at:] = other[begin:]
            case 5:
                data[at:end] = dice.randbytes(end - at)
            case 6 if at < len(data):
                data[at] ^= 1 << dice.randrange(8)
            case _:
                self._change_number(data)

    def _change_number(self, data: bytearray) -> None:
        found = [number.span() for number in _NUMBER.finditer(data)]
        if found:
            begin, end = self._dice.choice(found)
            data[begin:end] = self._dice.choice(_NUMBERS)
