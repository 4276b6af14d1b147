"""A prepulse: the pulse has two steps, the first too weak to be felt.

Owns: current and width of the first step. Must not know: limits, hardware, clocks.

Why: a weak depolarization before the pulse raises the threshold of pain more than that of touch;
the stronger it is, the more (Kajimoto, Electro-tactile Display, section 4.2; Poletto and Van Doren
2002: 1 mm electrodes on fingertips, prepulses 2 to 10 dB below the pulse).

Limitation: those prepulses were "long" (the abstract gives no figure), and those that weaken a
startle precede it by 40 to 60 ms (Blumenthal 2001). Here both steps are one SPI message, so that
nothing can come between them, of at most 200 us in all. No published study has tested the effect of
so short a prepulse on pain.

Both phases of a biphasic pulse have one, so that their charges are equal.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from etd.pulse.request import NO_GAIN, SHORTEST_US, MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate


class Prepulse(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`below_db` under the pulse's current, for `width_us` directly before it."""

    below_db: Annotated[float, Meta(ge=2.0, le=10.0)]
    width_us: Annotated[int, Meta(ge=SHORTEST_US, le=150)]

    @property
    def part(self) -> float:
        """Of the pulse's current: 10^(-dB/20), 0.79 at 2 dB and 0.32 at 10."""
        return float(10.0 ** (-self.below_db / 20.0))

    @property
    def max_gain(self) -> MaxGain:
        """The pulse itself is unchanged; the prepulse is budgeted separately."""
        return NO_GAIN

    def reset(self) -> None:
        """It has no state."""

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:  # noqa: ARG002 - others look at it
        return self.of(request)

    def of(self, request: PulseRequest) -> PulseRequest:
        """The request with a prepulse."""
        prepulse_ua = int(request.current_ua * self.part)
        return PulseRequest(request.current_ua, request.width_us, prepulse_ua, self.width_us)
