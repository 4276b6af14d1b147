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
from typing import Annotated

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from etd.pulse.request import PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.ratio_tracker import RatioTracker
from etd.stabilize.rejection import OnRejected, ignore_rejection
from etd.stabilize.rounding import held_us


class EnergySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a body-site file says of it."""

    max_widening: Annotated[float, Meta(ge=1.0, le=4.0)] = 1.5
    min_width_us: Annotated[int, Meta(ge=20, le=200)] = 35
    rise_per_s: Annotated[float, Meta(ge=0.01, le=20.0)] = 1.0


class Energy:
    def __init__(
        self, law: EnergySettings, leak_ohm: float, on_rejected: OnRejected = ignore_rejection
    ) -> None:
        self._law = law
        self._leak_ohm = leak_ohm
        self._tracker = RatioTracker(law.max_widening, law.rise_per_s, on_rejected)
        self.max_gain = self._tracker.max_gain

    def reset(self) -> None:
        self._tracker.reset()

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        wanted = 1.0
        compared = self._tracker.compared(estimate, request.current_ua)
        if compared is not None:
            *seen_ohm, reference_ohm = compared
            wanted = self._power(reference_ohm) / max(map(self._power, seen_ohm))
            wanted = self._tracker.plausible(estimate, wanted)
        return self._pulse(request, self._tracker.factor(estimate, wanted))

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
        width_us = held_us(request, exact_us, self._law.min_width_us, self._law.max_widening)
        current_ua = int(request.current_ua * min(1.0, math.sqrt(exact_us / width_us)))
        return replace(request, current_ua=current_ua, width_us=width_us)
