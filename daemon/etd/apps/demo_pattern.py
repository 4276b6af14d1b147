"""The demo's pattern: a soft bar that sweeps across the array, in changing directions.

Owns: the level of each electrode at a time. Must not know: currents, the daemon, the terminal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

#: One sweep across the array.
SWEEP_S = 1.6
#: Between sweeps the bar turns by this: eight directions.
TURN_RAD = math.pi / 4
#: Half the bar's width, as a part of the array's.
_HALF_WIDTH = 0.22
#: Lower levels are 0, so that the edges of the bar can be felt.
_FAINTEST = 0.15


class SweepingBar:
    """Positions in mm, one for each electrode."""

    def __init__(self, x_mm: Sequence[float], y_mm: Sequence[float]) -> None:
        middle_x, middle_y = _middle(x_mm), _middle(y_mm)
        self._places = [(x - middle_x, y - middle_y) for x, y in zip(x_mm, y_mm, strict=True)]
        self._reach_mm = max(math.hypot(*place) for place in self._places) or 1.0

    def levels(self, t_s: float) -> list[float]:
        """0..1 for each electrode, `t_s` seconds after the beginning."""
        sweep, part = divmod(t_s / SWEEP_S, 1.0)
        angle = sweep * TURN_RAD
        along_x, along_y = math.cos(angle), math.sin(angle)
        bar_mm = (2.0 * part - 1.0) * self._reach_mm
        half_mm = 2.0 * _HALF_WIDTH * self._reach_mm
        return [
            _strength(abs(x * along_x + y * along_y - bar_mm) / half_mm) for x, y in self._places
        ]


def _strength(distance: float) -> float:
    """1 in the middle of the bar, 0 from its edge (1) on."""
    strength = math.cos(min(1.0, distance) * math.pi / 2)
    return round(strength, 3) if strength >= _FAINTEST else 0.0


def _middle(values: Sequence[float]) -> float:
    return (min(values) + max(values)) / 2
