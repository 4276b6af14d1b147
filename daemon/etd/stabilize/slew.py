"""Factors that may rise only so fast, and fall at once.

Owns: the one rule that all laws share. Must not know: what is multiplied, sensors, limits.

A factor is knowledge too: when no pulse has asked for longer than it is believed, it starts anew.
"""

from __future__ import annotations

from etd.pulse.measured import MAX_AGE_NS

#: Between two pulses no more than this counts: a pause must not show as a step.
LONGEST_STEP_NS = 100_000_000


class SlewLimiter:
    """A factor an electrode."""

    def __init__(self, start: float, rise_per_s: float) -> None:
        self._start = start
        self._rise_per_ns = rise_per_s / 1e9
        self._reached: dict[int, tuple[float, int]] = {}

    def reset(self) -> None:
        self._reached.clear()

    def toward(self, electrode: int, wanted: float, now_ns: int) -> float:
        """As much of `wanted` as there is by now; all of it where it is less than before."""
        before, then_ns = self._reached.get(electrode, (self._start, now_ns))
        if now_ns - then_ns >= MAX_AGE_NS:
            before, then_ns = self._start, now_ns
        if wanted > before:
            elapsed_ns = min(max(0, now_ns - then_ns), LONGEST_STEP_NS)
            wanted = min(wanted, before + self._rise_per_ns * elapsed_ns)
        self._reached[electrode] = (wanted, now_ns)
        return wanted
