"""How far pulses rise above what was fired before them, by the wires alone.

Owns: the highest current of all that was fired a while ago. Must not know: the engine's ceilings.
"""

from __future__ import annotations

from bisect import bisect_right

RISE_UA, RISE_NS = 500, 100_000_000


class Rise:
    """Pulses in order of time, and by how much each exceeds what was fired before its 100 ms."""

    def __init__(self) -> None:
        self._times_ns: list[int] = []
        self._highest_ua: list[float] = []

    def above_ua(self, t_ns: int, current_ua: float) -> float:
        """Of the next pulse, which counts from then on."""
        place = bisect_right(self._times_ns, t_ns - RISE_NS)
        before_ua = self._highest_ua[place - 1] if place else 0.0
        if not self._highest_ua or current_ua > self._highest_ua[-1]:
            self._times_ns.append(t_ns)
            self._highest_ua.append(current_ua)
        return current_ua - before_ua
