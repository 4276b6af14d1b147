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
from etd_hal.errors import BoardFault

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
TOLERANCE = 0.2
#: What one reading of an ADC in order may be off by chance: noise of 1.5 codes, four times.
_NOISE_CODES = 6
#: Noise up to this part of what an unloaded node comes to leaves a gain below 0.6 or above 1.4
#: outside the bounds, whatever one reading is off by.
_MOST_NOISE = 0.1


@dataclass(frozen=True, slots=True)
class SourceRules:
    """In volts of the node; see the module."""

    leak_ohm: int
    #: The node cannot come higher, or the ADC cannot read it.
    reach_v: float
    #: At most, at code 0 with nothing connected.
    idle_v: float
    #: Two readings of the same voltage differ by at most this.
    noise_v: float

    @classmethod
    def of(cls, source: Source) -> SourceRules:
        step_v = source.node_uv_per_code / 1e6
        noise_v = _NOISE_CODES * step_v
        idle_v = max(_IDLE_UA * source.leak_ohm / 1e6, _OFFSET_V + noise_v)
        return cls(
            leak_ohm=source.leak_ohm,
            reach_v=min(float(source.compliance_v), (source.adc_codes - 1) * step_v),
            idle_v=min(idle_v, IDLE_MOST_V),
            noise_v=2 * noise_v,
        )

    def most_v(self, commanded_ua: int, baseline_v: float) -> float:
        """In a pulse: current x leak, above which no passive load lifts the node; and what stood
        there before, because charge that is left in skin adds to it.
        """
        return commanded_ua * self.leak_ohm / 1e6 * (1.0 + TOLERANCE) + baseline_v + self.noise_v

    def idle_fault(self, node_v: float, how: str) -> BoardFault | None:
        """What is wrong at code 0 with nothing connected; `how` it is that nothing is."""
        if node_v <= self.idle_v:
            return None
        return BoardFault(
            "node with the DAC at zero",
            f"{node_v:.1f} V {how}",
            f"at most {self.idle_v:.1f} V: a current flows that was not commanded",
        )

    def why_untold(self, commanded_ua: int) -> str | None:
        """Why a pulse with nothing connected would not tell a wrong gain; None if it does."""
        node_v, noise_v = commanded_ua * self.leak_ohm / 1e6, self.noise_v / 2
        told = f"{commanded_ua} uA into the leak of {self.leak_ohm} ohm make {node_v:.1f} V, and"
        if noise_v > _MOST_NOISE * node_v:
            return f"{told} one reading may be off by {noise_v:.1f} V"
        if node_v * (1.0 + TOLERANCE) + noise_v > self.reach_v:
            return f"{told} no more than {self.reach_v:.1f} V can be read"
        return None

    def unselected_fault(
        self, commanded_ua: int, baseline_v: float, early_v: float, voltage_v: float
    ) -> BoardFault | None:
        """What is wrong by the samples of a pulse with no output selected, where one that was
        blanked is as it should be.
        """
        least_v, most_v = self._unloaded_v(commanded_ua)
        if least_v <= voltage_v <= most_v and early_v <= most_v:
            return self.idle_fault(baseline_v, "with no output selected")
        return BoardFault(
            f"node at {commanded_ua} uA with no output selected",
            f"{early_v:.1f} V, then {voltage_v:.1f} V",
            f"{least_v:.1f} to {most_v:.1f} V, current x leak: an output is still on the source, so"
            " pulses reach another electrode than they are told; look at LE, CLK and DATA of the"
            " switch, and test it with etd selftest",
        )

    def _unloaded_v(self, commanded_ua: int) -> tuple[float, float]:
        """Least and most of current x leak."""
        node_v, noise_v = commanded_ua * self.leak_ohm / 1e6, self.noise_v / 2
        return node_v * (1 - TOLERANCE) - noise_v, node_v * (1 + TOLERANCE) + noise_v

    def unloaded_fault(
        self, commanded_ua: int, baseline_v: float, early_v: float, voltage_v: float
    ) -> BoardFault | None:
        """What is wrong by the samples of a pulse with nothing connected: at code 0 before it,
        early in it, near its end.
        """
        standing = self.idle_fault(baseline_v, "with nothing connected")
        if standing is not None:
            return standing
        least_v, most_v = self._unloaded_v(commanded_ua)
        if least_v <= voltage_v <= most_v and early_v <= most_v:
            return None
        return BoardFault(
            f"node at {commanded_ua} uA with nothing connected",
            f"{early_v:.1f} V, then {voltage_v:.1f} V",
            f"{least_v:.1f} to {most_v:.1f} V, current x leak: full_scale_ua, leak_ohm or"
            " node_uv_per_code of the board file is not this board's now, or the supply is not"
            " there; test it with etd selftest",
        )
