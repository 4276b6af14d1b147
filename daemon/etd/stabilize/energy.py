"""Energy: the same energy into the skin with every pulse, whatever it resists.

Owns: the law below. Must not know: how resistance is measured, limits.

Equal felt magnitude where the energy of the pulse, current x voltage x width, is the same (Tachi,
Tanie and Abe 1977, for pulses below 1 ms; Kajimoto, Electro-tactile Display, section 4.3, computes
it as current x voltage x width). At the end of a pulse of I the skin of R beside the board's leak L
takes P = I^2 R (L / (L + R))^2 watt; with R0 the reference, and w0 and I0 what was wanted:

    w = w0 x P(R0) / P(R)      and, where the width is at its bound,   I = I0 x sqrt(w / w_bound)

so a skin that takes more power gets a shorter pulse, and below `narrowest_us` a weaker one. A skin
of more than L takes less again, since the leak takes more; it counts as one of L: a reading that is
too high, and an edge of skin that carries all, must not be answered by more. Width
grows by at most `most_wider`; current never. Beyond that the energy falls short, and nothing winds
up. The factor rises by at most `rise_per_s`, and falls at once. Without a believed resistance the
pulse is what was wanted; not all widening is believed (`trust.py`), and soft contacts get none.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.stabilize.following import Following
from etd.stabilize.pipeline import Known, Wish
from etd.stabilize.rounding import held_us
from etd.stabilize.tell import Tell, unheard


class EnergyLaw(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a body-site file says of it."""

    most_wider: Annotated[float, Meta(ge=1.0, le=4.0)] = 1.5
    narrowest_us: Annotated[int, Meta(ge=20, le=200)] = 35
    rise_per_s: Annotated[float, Meta(ge=0.01, le=20.0)] = 1.0


class Energy:
    """See the module."""

    def __init__(self, law: EnergyLaw, leak_ohm: float, tell: Tell = unheard) -> None:
        self._law = law
        self._leak_ohm = leak_ohm
        self._following = Following(law.most_wider, law.rise_per_s, tell)
        self.reach = self._following.reach

    def forget(self) -> None:
        self._following.forget()

    def ask(self, wish: Wish, known: Known) -> Wish:
        wanted = 1.0
        compared = self._following.compared(known, wish.current_ua)
        if compared is not None:
            *seen_ohm, reference_ohm = compared
            wanted = self._power(reference_ohm) / max(map(self._power, seen_ohm))
            wanted = self._following.believed(known, wanted)
        return self._pulse(wish, self._following.factor(known, wanted))

    def _power(self, resistance_ohm: float) -> float:
        """In watt for an ampere squared; above the leak's resistance, as there."""
        counted_ohm = min(resistance_ohm, self._leak_ohm)
        taken = self._leak_ohm / (self._leak_ohm + counted_ohm)
        return counted_ohm * taken * taken

    def _pulse(self, wish: Wish, factor: float) -> Wish:
        """The width is a step, at least the narrowest; the current makes up for the rounding."""
        if factor == 1.0:
            return wish
        exact_us = wish.width_us * factor
        width_us = held_us(wish, exact_us, self._law.narrowest_us, self._law.most_wider)
        current_ua = int(wish.current_ua * min(1.0, math.sqrt(exact_us / width_us)))
        return replace(wish, current_ua=current_ua, width_us=width_us)
