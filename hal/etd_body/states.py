"""A skin that is brought from one state into the next: dry, breathed on, dry again, pressed, dry.

Owns: what each state does to contacts, and when a finger that is left in peace comes into the next
one. Must not know: boards, clocks, what such states are for.

All figures are [design]: a breath makes three times as much of what conducts, each electrode to an
extent of its own; a firmer finger has a quarter more of area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etd_body.course import STILL, Course, Script, SkinNow
from etd_body.interface import Sides
from etd_body.living import LivingBody

#: How differently a breath reaches the electrodes.
_BREATH_SIGMA = 0.2
#: Who is not stimulated for so long breathes on the array, or wipes it.
SILENCE_S = 15.0


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


class BreathingBody(LivingBody):
    """A finger that comes into the next state whenever it was not stimulated for `SILENCE_S`; the
    last one stays. Nothing else changes its skin, whatever its `script`.
    """

    _stimulated_ns: int | None = None
    _done = 0

    def _course(
        self,
        script: Script,  # noqa: ARG002 - it has states in place of one
        positions_mm: Sequence[tuple[float, float]],
        seed: int,
    ) -> Course:
        self._stated = StatedCourse(positions_mm, seed=seed)
        return self._stated

    def drive(self, t_ns: int, source_ua: float, sides: Sides) -> None:
        if source_ua > 0.0 and self._ways.of(sides).direction:
            since_ns = t_ns if self._stimulated_ns is None else self._stimulated_ns
            if t_ns - since_ns >= SILENCE_S * 1e9:
                self._done = min(self._done + 1, len(STATES) - 1)
                self._stated.state = STATES[self._done]
            self._stimulated_ns = t_ns
        super().drive(t_ns, source_ua, sides)
