"""Whether scans come later than planned for a whole second.

Owns: when the scans of the last second began and were planned to. Must not know: why they are late,
and what is done about it.
"""

from __future__ import annotations

from collections import deque

WINDOW_NS = 1_000_000_000
#: More than a tenth.
LATE = 1.1


class Lateness:
    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None
        #: Of each scan how long it took, and should have taken.
        self._taken_ns: deque[tuple[int, int]] = deque()

    def begun(self, now_ns: int, period_ns: int) -> float | None:
        """A scan begins, and the next one should a period later. Once a second: how many times as
        long as planned scans took, the longest left out, because a single stall is no lateness.
        """
        if self._last is not None:
            begun_ns, planned_ns = self._last
            self._taken_ns.append((now_ns - begun_ns, planned_ns))
        self._last = now_ns, period_ns
        if sum(taken_ns for taken_ns, _ in self._taken_ns) < WINDOW_NS:
            return None
        longest = max(self._taken_ns, key=lambda each: each[0] / each[1])
        self._taken_ns.remove(longest)
        rest = list(self._taken_ns) or [longest]
        self._taken_ns.clear()
        return sum(taken_ns for taken_ns, _ in rest) / sum(planned_ns for _, planned_ns in rest)

    def reset(self) -> None:
        """Nothing is shown: what follows continues nothing."""
        self._last = None
        self._taken_ns.clear()
