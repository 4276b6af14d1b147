"""What a body site makes of every pulse of a level: narrower, led into by others, repeated.

Owns: which settings those are, what is left of them at a width, and their words. Must not know:
limits, hardware, clocks, calibrations.

A calibration holds for the shape it was made with: a threshold of plain pulses is another one than
that of a burst. The laws that answer what skin does (contact, pressure, impedance) are no part of
it: where nothing has changed since the calibration, they change nothing.
"""

from __future__ import annotations

import msgspec

from etd.pulse.request import PulseRequest
from etd.stabilize.bursts import Bursts
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.strength_duration import StrengthDuration


class Shape(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True
):
    """None: not there. Nothing of it: a plain pulse."""

    strength_duration: StrengthDuration | None = None
    prepulse: Prepulse | None = None
    bursts: Bursts | None = None
    #: The board's probe goes before each: too weak to be felt, near enough to add to what comes.
    probe_first: bool = False

    def at(self, width_us: int) -> Shape:
        """What is left of it for pulses of one width: narrow ones are not made narrower."""
        if self.strength_duration is None or width_us > self.strength_duration.width_us:
            return self
        return msgspec.structs.replace(self, strength_duration=None)

    def of(self, request: PulseRequest) -> PulseRequest:
        """What it makes of one pulse, in the order in which a body site must name them."""
        for narrow in (self.strength_duration, self.prepulse):
            request = request if narrow is None else narrow.of(request)
        return request

    @property
    def prepulse_us(self) -> int:
        """What it adds to the width of every pulse."""
        return 0 if self.prepulse is None else self.prepulse.width_us

    def __str__(self) -> str:
        words = []
        if self.strength_duration is not None:
            words.append(
                f"narrowed to {self.strength_duration.width_us} us (tau "
                f"{self.strength_duration.tau_us:g} us)"
            )
        if self.prepulse is not None:
            prepulse = self.prepulse
            words.append(f"a prepulse of {prepulse.width_us} us, {prepulse.below_db:g} dB below")
        if self.bursts is not None:
            words.append(f"bursts of {self.bursts.pulses} at {self.bursts.rate_hz:g} Hz")
        if self.probe_first:
            words.append("a probe before each")
        return ", ".join(words) or "plain pulses"


PLAIN = Shape()
