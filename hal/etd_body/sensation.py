"""What is felt, and what hurts, of the pulses that the skin was given: modelled, not measured.

Owns: the membranes' state from pulse to pulse, felt strength and pain per electrode, and the true
thresholds that a calibration can be compared with.
Must not know: sources, sides, contacts, boards.

Strength is dimensionless: 1.0 is just felt, 0 is nothing. A pulse's own strength grows as a power
of the current over its threshold (exponents of 0.9 to 1.5 are reported; 1.2 is [design]); pulses
that follow one another add up and saturate, so that six in a burst of 350 Hz are felt about twice
as strong as one (Kaczmarek, Webster, Radwin 1992). Pain is how far the thin fibres are driven, as
a fraction of their threshold, or what the heat under a contact makes of it (section 2.2.2 of
Kajimoto, Electro-tactile Display, names Joule heat; Mason and Mackay 1976 place prick pain in the
corneal layer under uneven contacts): 1.0 and more hurts.
"""

from __future__ import annotations

from math import exp, inf, sqrt
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from etd_body.nerve import NOMINAL_RADIUS_MM, RADII_MM, ROWS, TAU_US, TOUCH_ROWS, Nerves
from etd_body.shifts import Shifts
from etd_body.tissue import Floats

#: What is touched at every pulse is kept short: with 256 electrodes memory is what it waits for.
Singles = NDArray[np.float32]
Polarity = Literal["anodic", "cathodic", "biphasic", "biphasic_cathodic_first"]

#: Joule heat of one pulse in the layer under a contact that just hurts [design].
HURTING_UJ_PER_MM2 = 45.0
_EXPONENT = 1.2
#: How long a pulse adds to those that follow, and how much they make of it at most.
_SUMMATION_NS = 60e6
_MOST_ADDED, _HALF_ADDED = 1.5, 2.3
#: A nerve that has fired does not do so again within this: two phases are one pulse.
_REFRACTORY_NS = 1e6
_TAU_NS = (TAU_US[:, None] * 1_000.0).astype(np.float32)
#: After so long without current all membranes are at rest.
_AT_REST_NS = 10_000_000.0


class Felt(NamedTuple):
    """One number per electrode: the strongest since the last call."""

    felt: tuple[float, ...]
    pain: tuple[float, ...]


class Sensation:
    """Give it every stretch of constant current in turn (`pass_current`), say when a pulse is over
    (`end_pulse`), and ask (`take`).

    Currents are those that pass the skin, in uA: positive into it. `weights` has one number per
    electrode: what it carries of 1 uA, +1 for the one that is alone on the source's side and
    together -1 for its returns.
    """

    def __init__(self, nerves: Nerves, shifts: Shifts | None = None) -> None:
        """`shifts`: what use and neighbors make of the thresholds; None is nothing."""
        self._shifts = shifts
        self._own = nerves.own.astype(np.float32)
        count = self.electrode_count = nerves.electrode_count
        shape = (len(TAU_US), ROWS * count)
        #: [j]: what 1 uA into electrode j does everywhere, with its present area.
        self._unit: Singles = nerves.everywhere.astype(np.float32).reshape(count, -1)
        self._state: Singles = np.zeros(shape, dtype=np.float32)
        self._state_ns = 0.0
        self._felt: Floats = np.zeros(count)
        self._pain: Floats = np.zeros(count)
        self._peak: Floats = np.zeros(count)
        self._heat_uj_per_mm2: dict[int, float] = {}
        self._trace: Floats = np.zeros(count)
        self._trace_ns: Floats = np.zeros(count)
        self._shared: Singles = self._unit[0]
        self._shares: Floats = np.zeros(count)
        self.set_contacts(np.full(count, NOMINAL_RADIUS_MM), np.ones(count))

    def set_contacts(self, radius_mm: Floats, conductance: Floats) -> None:
        """How wide the current enters under each electrode, and how returns share it.

        `conductance` in any unit; 0 is an electrode that does not touch the skin.
        """
        count = self.electrode_count
        at = np.interp(radius_mm, RADII_MM, np.arange(len(RADII_MM)))
        low = np.minimum(at.astype(int), len(RADII_MM) - 2)
        part = (at - low).astype(np.float32)[:, None, None]
        each = np.arange(count)
        own = self._own[each, low] * (1.0 - part) + self._own[each, low + 1] * part
        by_electrode = self._unit.reshape(count, len(TAU_US), ROWS, count)
        by_electrode[each, :, :, each] = own
        self._shares = conductance / max(float(conductance.sum()), 1e-30)
        self._shared = self._shares.astype(np.float32) @ self._unit

    def one_against_all(self, electrode: int) -> Singles:
        """What 1 uA into `electrode` and out of all others does: an opaque argument for others."""
        own = float(self._shares[electrode])
        unit = self._unit[electrode]
        return np.asarray((unit - self._shared) / max(1.0 - own, 1e-12))

    def one_against(self, weights: Floats) -> Singles:
        """The same for any distribution of the current."""
        return np.asarray(weights.astype(np.float32) @ self._unit)

    # --- currents ----------------------------------------------------------------------------

    def pass_current(
        self, at_ns: float, duration_ns: float, current_ua: float, pattern: Singles
    ) -> None:
        """`current_ua` (negative: the other way) in `pattern` for `duration_ns` from `at_ns`."""
        state = self._state
        gap_ns = at_ns - self._state_ns
        if gap_ns > _AT_REST_NS:
            state[:] = 0.0
        elif gap_ns > 0.0:
            state *= np.exp(-gap_ns / _TAU_NS)
        drive = pattern.reshape(state.shape) * current_ua
        state -= drive
        state *= np.exp(-duration_ns / _TAU_NS)
        state += drive
        self._state_ns = at_ns + duration_ns
        reached = state.sum(axis=0).reshape(ROWS, self.electrode_count)
        np.maximum(self._peak, reached[:TOUCH_ROWS].max(axis=0), out=self._peak)
        np.maximum(self._pain, reached[TOUCH_ROWS:].max(axis=0), out=self._pain)

    def heat(self, electrode: int, uj_per_mm2: float) -> None:
        """What the current that was passed has made of heat under one contact."""
        before = self._heat_uj_per_mm2.get(electrode, 0.0)
        self._heat_uj_per_mm2[electrode] = before + uj_per_mm2

    def let_pass(self, t_ns: float) -> None:
        """Until `t_ns`: what use has raised comes back."""
        if self._shifts is not None:
            self._shifts.let_pass(t_ns)

    def end_pulse(self, driven: int | None = None) -> None:
        """What was passed since the last call was one pulse, prepulse and all, by the electrode
        `driven` if it was one against others.
        """
        for electrode, heat in self._heat_uj_per_mm2.items():
            self._pain[electrode] = max(self._pain[electrode], pain_of_heat(heat))
        self._heat_uj_per_mm2.clear()
        if self._shifts is not None:
            self._peak = self._shifts.shifted(self._peak, driven, self._state_ns)
        for strong in np.flatnonzero(self._peak >= 1.0):
            self._feel(int(strong), float(self._peak[strong]), self._state_ns)
        self._peak[:] = 0.0

    def _feel(self, electrode: int, over: float, t_ns: float) -> None:
        """One pulse above threshold, `over` times it."""
        since_ns = t_ns - float(self._trace_ns[electrode])
        trace = float(self._trace[electrode]) * exp(-since_ns / _SUMMATION_NS)
        summed = 1.0 + _MOST_ADDED * trace / (trace + _HALF_ADDED)
        if since_ns >= _REFRACTORY_NS or trace == 0.0:
            self._trace[electrode] = trace + 1.0
            self._trace_ns[electrode] = t_ns
        felt = 1.0 + (over**_EXPONENT - 1.0) * summed
        if felt > self._felt[electrode]:
            self._felt[electrode] = felt

    # --- answers -----------------------------------------------------------------------------

    def take(self) -> Felt:
        """The strongest of each electrode since the last call."""
        found = Felt(tuple(self._felt.tolist()), tuple(np.maximum(self._pain, 0.0).tolist()))
        self._felt[:] = 0.0
        self._pain[:] = 0.0
        return found

    def true_threshold_ua(
        self, electrode: int, width_us: float, polarity: Polarity = "anodic"
    ) -> float:
        """The current through the skin at which one pulse against all others is just felt.

        In the state that the contacts are in now. A biphasic pulse is felt by the phase that
        needs less. What use has raised counts, what a neighbor's pulse before it would lower does
        not. inf where no current would do it.
        """
        threshold_ua = self._threshold_ua(electrode, width_us, polarity, slice(0, TOUCH_ROWS))
        return (
            threshold_ua if self._shifts is None else threshold_ua * self._shifts.raised(electrode)
        )

    def pain_threshold_ua(
        self, electrode: int, width_us: float, polarity: Polarity = "anodic"
    ) -> float:
        """The same for what just drives a thin fibre; heat, which takes resistance, is left out."""
        return self._threshold_ua(electrode, width_us, polarity, slice(TOUCH_ROWS, ROWS))

    def _threshold_ua(
        self, electrode: int, width_us: float, polarity: Polarity, rows: slice
    ) -> float:
        pattern = self.one_against_all(electrode).reshape(len(TAU_US), ROWS, self.electrode_count)
        grown = -np.expm1(-width_us / TAU_US) @ pattern[:, rows, electrode]
        ways = {"anodic": (1.0,), "cathodic": (-1.0,)}.get(polarity, (1.0, -1.0))
        most = max(float((way * grown).max()) for way in ways)
        return 1.0 / most if most > 0.0 else inf


def pain_of_heat(uj_per_mm2: float) -> float:
    """As a fraction of a current that hurts: heat goes with its square."""
    return sqrt(uj_per_mm2 / HURTING_UJ_PER_MM2)
