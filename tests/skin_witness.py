"""Who touched in a story, and how much of that an engine without eyes could know.

Owns: the real division of a current among all others, by the conductances of the body; and for how
long somebody may go on believing in a contact that was lifted. Must not know: the engine's own
reckoning.

A lift cannot be known before a pulse has gone out. From the first pulse after it, the engine has a
second. What a pulse cannot show is excused until the next arming: a lift between two pulses after
which the first had a width that its electrode never had, or after which some electrode was touched
anew, and so resists less for another reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Protocol

SECOND_NS = 1_000_000_000


class Visited(Protocol):
    """One pulse of the trace."""

    @property
    def electrode(self) -> int: ...

    @property
    def begun_ns(self) -> int: ...

    @property
    def on_us(self) -> float: ...


@dataclass
class _Lift:
    """A contact that was there. `until_ns` None: no pulse since then."""

    electrode: int
    conductance_s: float
    lifted_ns: int
    until_ns: float | None = None


class Skin:
    """See the module."""

    def __init__(self, contacts: Sequence[tuple[int, int, float]]) -> None:
        self._coming = sorted(contacts, key=lambda one: one[0], reverse=True)
        self._now_s: dict[int, float] = {}
        self._lifts: list[_Lift] = []
        self._widths: set[tuple[int, int]] = set()

    def until(self, t_ns: int) -> None:
        """All that changed up to a time."""
        while self._coming and self._coming[-1][0] <= t_ns:
            changed_ns, electrode, conductance_s = self._coming.pop()
            before_s = self._now_s.get(electrode, 0.0)
            self._now_s[electrode] = conductance_s
            if conductance_s < before_s:
                self._lifts.append(_Lift(electrode, before_s, changed_ns))
            else:
                self._hide()
        self._lifts = [one for one in self._lifts if one.until_ns is None or t_ns < one.until_ns]

    def forget(self) -> None:
        """Everybody is measured anew."""
        self._lifts.clear()
        self._widths.clear()

    def visited(self, visit: Visited) -> None:
        """A pulse went out, and told what it could."""
        path = visit.electrode, round(visit.on_us)
        if path not in self._widths:
            self._hide()
        self._widths.add(path)
        for one in self._lifts:
            if one.until_ns is None:
                one.until_ns = max(one.lifted_ns, visit.begun_ns) + SECOND_NS

    def is_touched(self, electrode: int) -> bool:
        return self._now_s[electrode] > 0

    def shares(self, electrode: int) -> dict[int, float]:
        """Of the current of one, what each of the others carried, at the least."""
        believed_s = dict(self._now_s)
        for one in self._lifts:
            believed_s[one.electrode] = max(believed_s[one.electrode], one.conductance_s)
        others_s = {one: g for one, g in self._now_s.items() if g > 0 and one != electrode}
        total_s = sum(g for one, g in believed_s.items() if one != electrode)
        return {one: g / total_s for one, g in others_s.items()}

    def _hide(self) -> None:
        for one in self._lifts:
            one.until_ns = inf
