"""What the current source's node may read: with nothing connected, before a pulse, in one.

Owns: the bounds, from the board file's constants, each with its reason and source.
Must not know: when a reading is taken, what follows from one that is out of bounds.

The node is sampled as the chip select of a word falls, before its code is played. With the DAC at
zero the leak drains it within microseconds. With nothing connected it rises to current x leak; skin
takes a part of the current and holds it below that. So a node above zero at code 0 is a current, or
charge that is left in skin; a node above current x leak is more current than was commanded; and an
unloaded node that is off tells that source, leak or ADC are not those of the board file.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd_hal.boardfile import Source

#: At code 0 with nothing connected. 50 uA is the baseline at which a Digitimer DS5 disables its
#: output; 5 V is the bound of an idle node in the FMEA of the design, whatever the leak.
_IDLE_UA, IDLE_MOST_V = 50.0, 5.0
#: What the self-test lets a node at rest read: offsets of the ADC and its buffer.
_OFFSET_V = 1.0
#: Before a pulse, with skin connected that has rested. In the modelled bodies nothing is left of a
#: pulse after the rest; real skin gives some of its charge back more slowly than one RC does.
RESTED_V = 5.0
#: Of source, leak and ADC together: the 20 % that IEC 60601-2-10 allows an amplitude. The
#: self-test asks for half of that, so that a board which passed it can still drift.
_TOLERANCE = 0.2
#: What one reading of an ADC in order may be off by chance: noise of 1.5 codes, four times.
_NOISE_CODES = 6


@dataclass(frozen=True, slots=True)
class SourceRules:
    """In volts of the node; see the module."""

    leak_ohm: int
    #: At most, at code 0 with nothing connected.
    idle_v: float
    #: Two readings of the same voltage differ by at most this.
    noise_v: float

    @classmethod
    def of(cls, source: Source) -> SourceRules:
        """The bounds of one board."""
        step_v = source.node_uv_per_code / 1e6
        noise_v = _NOISE_CODES * step_v
        idle_v = max(_IDLE_UA * source.leak_ohm / 1e6, _OFFSET_V + noise_v)
        return cls(
            leak_ohm=source.leak_ohm,
            idle_v=min(idle_v, IDLE_MOST_V),
            noise_v=2 * noise_v,
        )

    def most_v(self, commanded_ua: int, baseline_v: float) -> float:
        """In a pulse: current x leak, above which no passive load lifts the node; and what stood
        there before, because charge that is left in skin adds to it.
        """
        return commanded_ua * self.leak_ohm / 1e6 * (1.0 + _TOLERANCE) + baseline_v + self.noise_v
