"""Choices that are made by bytes: the same bytes make the same ones.

Owns: how bytes become numbers and picks, so that an input that is cut or changed a little makes
about the same choices. Must not know: what is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """Taken from the front; where no bytes are left, each is the first there is."""

    def __init__(self, data: bytes) -> None:
        self._left = data

    @property
    def is_over(self) -> bool:
        return not self._left

    def number(self, low: int, high: int) -> int:
        """From `low` to `high`, both included."""
        span = high - low + 1
        taken = self.taken(max(1, ((span - 1).bit_length() + 7) // 8))
        return low + int.from_bytes(taken, "little") % span

    def pick(self, these: Sequence[T]) -> T:
        return these[self.number(0, len(these) - 1)]

    def is_so(self) -> bool:
        return self.pick((False, True))

    def taken(self, count: int) -> bytes:
        """So many bytes, or what is left."""
        taken, self._left = self._left[:count], self._left[count:]
        return taken

    def piece(self) -> bytes:
        """Some bytes as they are, at most 65 535."""
        return self.taken(self.number(0, 65_535))
