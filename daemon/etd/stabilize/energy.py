"""Energy: the same energy into the skin with every pulse, whatever it resists.

Owns: the law below. Must not know: how resistance is measured, limits.

Equal felt magnitude where the energy of the pulse, current x voltage x width, is the same (Tachi,
Tanie and Abe 1977, for pulses below 1 ms; Kajimoto, Electro-tactile Display, section 4.3, computes
it as current x voltage x width). At the end of a pulse of I the skin of R beside the board's leak L
takes P = I^2 R (L / (L + R))^2 watt; with R0 the reference, and w0 and I0 what was wanted:

    w = w0 x P(R0) / P(R)      and, where the width is at its bound,   I = I0 x sqrt(w / w_bound)

so a skin that takes more power gets a shorter pulse, and below `min_width_us` a weaker one. A skin
of more than L takes less again, since the leak takes more; it counts as one of L: a reading that is
too high, and an edge of skin that carries all, must not be answered by more. Width
grows by at most `max_widening`; current never. Beyond that the energy falls short, and nothing
winds up. The factor rises by at most `rise_per_s`, and falls at once. Without a believed resistance
the pulse is what was wanted; not all widening is believed (`plausibility.py`), and soft contacts
get none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from etd.pulse.request import PulseRequest
from etd.stabilize.law_settings import EnergySettings
from etd.stabilize.pipeline import ElectrodeEstimate, OnRejected, ignore_rejection
from etd.stabilize.resistance_law import ResistanceLaw
from etd.stabilize.rounding import held_us


class Energy(ResistanceLaw):
    def __init__(
        self, law: EnergySettings, leak_ohm: float, on_rejected: OnRejected = ignore_rejection
    ) -> None:
        super().__init__(law, on_rejected)
        self._leak_ohm = leak_ohm

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return self._pulse(request, self._factor(request, estimate, self._wanted))

    def _wanted(self, seen_ohm: Sequence[float], reference_ohm: float) -> float:
        return self._power(reference_ohm) / max(map(self._power, seen_ohm))

    def _power(self, resistance_ohm: float) -> float:
        """In watt for an ampere squared; above the leak's resistance, as there."""
        counted_ohm = min(resistance_ohm, self._leak_ohm)
        taken = self._leak_ohm / (self._leak_ohm + counted_ohm)
        return counted_ohm * taken * taken

    def _pulse(self, request: PulseRequest, factor: float) -> PulseRequest:
        """The width is a step, at least the narrowest; the current makes up for the rounding."""
        if factor == 1.0:
            return request
        exact_us = request.width_us * factor
        width_us = held_us(request, exact_us, self._min_width_us, self._max_widening)
        current_ua = int(request.current_ua * min(1.0, math.sqrt(exact_us / width_us)))
        return request.stepped(current_ua, width_us)
