"""Strength-duration: the same nerve at its threshold, with a narrower and stronger pulse.

Owns: the strength-duration curve, and the current that a narrower pulse needs. Must not know:
limits, hardware, clocks, what was measured.

Why: thin fibers, which carry pain, have a steeper curve than thick ones, so that pain moves away
from the first touch as pulses get narrower (Kajimoto, Electro-tactile Display, sections 2.2.1 and
4.2; Collins et al. there, for 20 to 50 us). The curve is equation 16, I(T) = Irh / (1 -
exp(-T / tau)): the current falls with the width towards the rheobase. A pulse is replaced by the
one that stands as far above the curve as it did. Its charge is smaller, whatever tau is, because
I(T) x T falls with T.

What is assumed: one tau for all electrodes. 151 us were found at the median nerve of monkeys
(Kaczmarek et al. 2000); sensory chronaxies of an arm are 0.35 to 1.17 ms, which is tau x ln 2.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.pulse.request import SHORTEST_US, MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate


def strength(width_us: float, tau_us: float) -> float:
    """The current at threshold as a multiple of the rheobase: equation 16."""
    return 1.0 / -math.expm1(-width_us / tau_us)


class StrengthDuration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Nothing wider than `width_us`; what is narrower already stays as it is."""

    width_us: Annotated[int, Meta(ge=SHORTEST_US, le=200)]
    tau_us: Annotated[float, Meta(ge=50.0, le=2_000.0)]

    @property
    def max_gain(self) -> MaxGain:
        """From the widest pulse there is; the charge always falls."""
        return MaxGain(current=strength(self.width_us, self.tau_us) / strength(200, self.tau_us))

    def reset(self) -> None:
        """It remembers nothing."""

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:  # noqa: ARG002 - others look at it
        return self.of(request)

    def of(self, request: PulseRequest) -> PulseRequest:
        """As far above the curve as it was, and narrower."""
        if request.width_us <= self.width_us:
            return request
        rise = strength(self.width_us, self.tau_us) / strength(request.width_us, self.tau_us)
        return request.stepped(int(request.current_ua * rise), self.width_us)
