"""A skin that is brought from one state into the next: dry, breathed on, dry again, pressed, dry.

Owns: what each state does to contacts, and when a finger that is left in peace comes into the next
one. Must not know: circuits, nerves, clocks, why anybody wants such states.

All figures are [design]: a breath makes three times as much of what conducts, each electrode to an
extent of its own; a firmer finger has a quarter more of area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etd_body.course import STILL, Course, SkinNow

#: How differently a breath reaches the electrodes.
_BREATH_SIGMA = 0.2
#: Who is not stimulated for so long breathes on the array, or wipes it.
LEFT_IN_PEACE_S = 15.0


@dataclass(frozen=True, slots=True)
class SkinState:
    """What sweat conducts, over dry, and the area of contact, over that at the usual pressure."""

    sweat_gain: float
    area: float


STATES = (
    SkinState(1.0, 1.0),
    SkinState(3.0, 1.0),
    SkinState(1.15, 1.0),
    SkinState(1.9, 1.25),
    SkinState(1.1, 1.0),
)


class StatedCourse(Course):
    """A skin that stays as `state` has it, until that is replaced."""

    def __init__(self, positions_mm: Sequence[tuple[float, float]], *, seed: int) -> None:
        super().__init__(STILL, positions_mm, seed=seed)
        random = np.random.default_rng([seed, 9])
        self._reached = np.exp(random.normal(0.0, _BREATH_SIGMA, len(positions_mm)))
        self.state = STATES[0]

    def at(self, t_s: float) -> SkinNow:  # noqa: ARG002 - it stays
        gain = self.state.sweat_gain**self._reached
        wetness = np.clip((gain - 1.0) / (STATES[1].sweat_gain - 1.0), 0.0, 1.0)
        return SkinNow(np.full(len(gain), self.state.area), wetness, gain)


class BreathingCourse(StatedCourse):
    """The next state comes after each `LEFT_IN_PEACE_S` in which nobody looked at the skin, as
    happens when a pulse begins; the last one stays. So, other than any course, it must be asked in
    the order of time.
    """

    def __init__(self, positions_mm: Sequence[tuple[float, float]], *, seed: int) -> None:
        super().__init__(positions_mm, seed=seed)
        self._last_s = 0.0
        self._done = 0

    def at(self, t_s: float) -> SkinNow:
        if t_s - self._last_s >= LEFT_IN_PEACE_S:
            self._done = min(self._done + 1, len(STATES) - 1)
            self.state = STATES[self._done]
        self._last_s = t_s
        return super().at(t_s)
