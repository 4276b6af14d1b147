"""What a body site makes of every pulse of a level: narrower, led into by others, repeated.

Owns: which settings those are, what is left of them at a width, and their words. Must not know:
limits, hardware, clocks, calibrations.

A calibration holds for the shape it was made with: a threshold of plain pulses is another one than
that of a burst. The laws that answer what skin does (contact, pressure, impedance) are no part of
it: where nothing has changed since the calibration, they change nothing.
"""

from __future__ import annotations

import msgspec

from etd.stabilize.bursts import Bursts
from etd.stabilize.narrow import Narrow
from etd.stabilize.pipeline import Wish
from etd.stabilize.prepulse import Prepulse


class Shape(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True
):
    """None: not there. Nothing of it: a plain pulse."""

    narrow: Narrow | None = None
    prepulse: Prepulse | None = None
    bursts: Bursts | None = None
    #: The board's probe goes before each: too weak to be felt, near enough to add to what comes.
    probe_first: bool = False

    def at(self, width_us: int) -> Shape:
        """What is left of it for pulses of one width: narrow ones are not made narrower."""
        if self.narrow is None or width_us > self.narrow.width_us:
            return self
        return msgspec.structs.replace(self, narrow=None)

    def of(self, wish: Wish) -> Wish:
        """What it makes of one pulse, in the order in which a body site must name them."""
        for one in (self.narrow, self.prepulse):
            wish = wish if one is None else one.of(wish)
        return wish

    @property
    def prepulse_us(self) -> int:
        """What it adds to the width of every pulse."""
        return 0 if self.prepulse is None else self.prepulse.width_us

    def __str__(self) -> str:
        words = []
        if self.narrow is not None:
            words.append(f"narrowed to {self.narrow.width_us} us (tau {self.narrow.tau_us:g} us)")
        if self.prepulse is not None:
            one = self.prepulse
            words.append(f"a prepulse of {one.width_us} us, {one.below_db:g} dB below")
        if self.bursts is not None:
            words.append(f"bursts of {self.bursts.pulses} at {self.bursts.rate_hz:g} Hz")
        if self.probe_first:
            words.append("a probe before each")
        return ", ".join(words) or "plain pulses"


PLAIN = Shape()
