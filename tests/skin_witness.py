"""Who touched in a story, and how much of that an engine without eyes could know.

Owns: the real number of those that a current was shared by, from the body itself. Must not know:
the engine's own reckoning.

A lift cannot be known before somebody was looked at again: whoever was lifted counts as touching
for one second more, and for nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence

SECOND_NS = 1_000_000_000


class Skin:
    """See the module. `contacts`: (time, electrode, conductance in S), 0 when lifted."""

    def __init__(self, contacts: Sequence[tuple[int, int, float]]) -> None:
        self._contacts = sorted(contacts, key=lambda entry: entry[0])
        self._next = 0
        self._touching: set[int] = set()
        self._lifted_ns: dict[int, int] = {}

    def until(self, t_ns: int) -> None:
        """All that changed up to a time."""
        while self._next < len(self._contacts) and self._contacts[self._next][0] <= t_ns:
            changed_ns, electrode, conductance_s = self._contacts[self._next]
            self._next += 1
            if conductance_s > 0:
                self._touching.add(electrode)
            elif electrode in self._touching:
                self._touching.discard(electrode)
                self._lifted_ns[electrode] = changed_ns
        self._lifted_ns = {
            electrode: lifted_ns
            for electrode, lifted_ns in self._lifted_ns.items()
            if t_ns - lifted_ns < SECOND_NS
        }

    def is_touched(self, electrode: int) -> bool:
        return electrode in self._touching

    def shares(self, electrode: int) -> dict[int, float]:
        """Of the current of one, what each of the others returned, at the least."""
        others = self._touching - {electrode}
        believed = (self._touching | set(self._lifted_ns)) - {electrode}
        return dict.fromkeys(others, 1.0 / max(1, len(believed)))
