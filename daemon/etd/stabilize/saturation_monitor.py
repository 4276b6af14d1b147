"""Rejects a law that stays at an end of its range for long.

Owns: how near and how long that is, and when it ends. Must not know: what a law depends on, limits.

A divider that makes bad contact on one electrode reads like wet skin, and holds a law at the most
that it may ask for; one that is too high reads like skin that hardly touches, and has it ask for
next to nothing. Skin is there too, but not for so long. On the busiest modelled fingers (seeds 1
and 2, ten minutes) `power_law` wants nearly its widest for 7 and 13 % of the time, and less than a
quarter of the frame's for 0.3 and 0.2 %, in stretches of seconds. After 10 s 4 and 2 of 1000 pulses
there are doubted at the wide end, and none at the narrow one.

What a law wants counts, by resistances that are believed; so pulses by others, and pauses, neither
fill nor end it, nor does an arming. Nor does a moment away from there: what is wrong for more than
half of the time must not be believed for the rest. Time away counts against it, and the doubt ends
when that has used up what was counted. Time not so far away takes back what led to a doubt, and
never ends one. Where a site allows more than twice the width, near is what it would be at twice.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

_LONG_NS = 10_000_000_000
#: Whatever a site allows: a law that wants this much for long is rejected.
_WIDE = 2.0
#: In parts of the way, as logarithms, from unchanged to the widest.
_NEAR, _AWAY = 0.8, 0.5
#: The narrow end, which no site bounds: of what the frame wants.
_NARROW = 0.25
#: Between two pulses at most this counts.
_LONGEST_STEP_NS = 1_000_000_000


class End:
    """Of what is wanted, or its inverse: at or above `near` is near, below `away` clearly away."""

    __slots__ = ("away", "near")

    def __init__(self, near: float, away: float) -> None:
        self.near: Final = near
        self.away: Final = away


def widest(most: float) -> End:
    """Of a law that widens `most` times at most; one that never widens is never near."""
    most = min(most, _WIDE)
    return End(near=most**_NEAR if most > 1.0 else float("inf"), away=most**_AWAY)


#: Of the inverse of what is wanted.
NARROWEST = End(near=1.0 / _NARROW, away=(1.0 / _NARROW) ** _AWAY)


class SaturationMonitor:
    """For all electrodes of one law, at one end; `on_rejected` is called when a doubt begins."""

    def __init__(self, end: End, on_rejected: Callable[[], object]) -> None:
        self._end = end
        self._on_rejected = on_rejected
        self._stood_ns: dict[int, int] = {}
        self._asked_ns: dict[int, int] = {}
        self._rejected: set[int] = set()
        self._reported: set[int] = set()

    def report_again(self) -> None:
        """Of those that are doubted now, each when it is next asked."""
        self._reported.clear()

    def is_rejected(self, electrode: int, wanted: float, now_ns: int) -> bool:
        """Whether what a law wants by what is measured, as a factor, has stood at the end for too
        long, until it has been clearly away from there for as long.
        """
        stood_ns = self._count(electrode, wanted, now_ns)
        if stood_ns >= _LONG_NS:
            self._rejected.add(electrode)
        elif electrode not in self._rejected:
            return False
        elif stood_ns == 0:
            self._rejected.discard(electrode)
            self._reported.discard(electrode)
            return False
        if electrode not in self._reported:
            self._reported.add(electrode)
            self._on_rejected()
        return True

    def _count(self, electrode: int, wanted: float, now_ns: int) -> int:
        """For how long it has stood there, less what it has been away since."""
        asked_ns, self._asked_ns[electrode] = self._asked_ns.get(electrode, now_ns), now_ns
        stood_ns, is_near = self._stood_ns.get(electrode, 0), wanted >= self._end.near
        if not is_near and not stood_ns:
            return 0
        elapsed_ns = min(max(0, now_ns - asked_ns), _LONGEST_STEP_NS)
        if is_near:
            stood_ns += elapsed_ns
        elif wanted < self._end.away or electrode not in self._rejected:
            stood_ns -= elapsed_ns
        self._stood_ns[electrode] = stood_ns = min(max(0, stood_ns), _LONG_NS)
        return stood_ns
