"""A prepulse: the pulse comes in two steps, the first too weak to be felt.

Owns: how strong and how long the first step is. Must not know: limits, hardware, clocks.

Why: a weak depolarization before the pulse raises the threshold of pain more than that of touch,
and the more the stronger it is (Kajimoto, Electro-tactile Display, section 4.2; Poletto and Van
Doren 2002: 1 mm electrodes on fingertips, prepulses 2 to 10 dB below the pulse).

What is out of reach: those prepulses were long, by the words of their abstract, which does not say
how long; and the ones that weaken a startle come 40 to 60 ms before (Blumenthal 2001). Here the
two steps are one SPI message, so that nothing can come between them, and share the width of one
pulse: at most 200 us in all. What so short a prepulse does to pain nobody has published: it is for
studies to find out, and this gives them the means.

Both phases of a biphasic pulse have one, so that their charges stay equal.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.stabilize.pipeline import NO_GAIN, SHORTEST_US, ElectrodeEstimate, MaxGain, PulseRequest


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
        """The pulse itself stays what it is; what comes before it has its own room."""
        return NO_GAIN

    def reset(self) -> None:
        """It remembers nothing."""

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:  # noqa: ARG002 - others look at it
        return self.of(request)

    def of(self, request: PulseRequest) -> PulseRequest:
        """The same, led into."""
        prepulse_ua = int(request.current_ua * self.part)
        return replace(request, prepulse_ua=prepulse_ua, prepulse_us=self.width_us)
