"""A current source with leak and compliance, driving one capacitor through resistances.

Owns: the exact course of voltage and charge of that loop, in closed form, through the source's
regimes. Must not know: electrodes, what else is connected, absolute time.

The source delivers what it is told, is held at its compliance, or delivers nothing because the
capacitor holds its node above that; the leak takes its share first (Kajimoto, Electro-tactile
Display, section 3.1, Figure 10, and the boards' resistors to ground).
"""

from __future__ import annotations

from math import expm1, inf, log
from typing import NamedTuple


class _Regime(NamedTuple):
    """One linear law of the loop: current = (drive_v - held_v) / loop_ohm."""

    drive_v: float
    loop_ohm: float


class Loop(NamedTuple):
    """`series_ohm` is all between the node and ground but the capacitor's own way.

    `parallel_ohm` 0 is no capacitor at all.
    """

    source_a: float
    leak_ohm: float
    compliance_v: float
    series_ohm: float
    parallel_ohm: float
    capacitance_f: float

    def node_v(self, held_v: float) -> float:
        """The node's voltage while the capacitor holds `held_v` (positive against the source)."""
        regime = self._regimes()[self._regime_of(held_v)]
        current_a = (regime.drive_v - held_v) / regime.loop_ohm
        return current_a * self.series_ohm + held_v

    def advance(self, held_v: float, duration_s: float) -> tuple[float, float]:
        """What is held after `duration_s`, and the charge in C that has passed meanwhile.

        The voltage runs one way under a constant drive: it meets two changes of regime at most.
        """
        regimes = self._regimes()
        index = self._regime_of(held_v)
        charge_c = 0.0
        for may_change in (True, True, False):
            regime = regimes[index]
            if self.parallel_ohm == 0.0:
                return 0.0, charge_c + regime.drive_v / regime.loop_ohm * duration_s
            resistance_ohm = parallel(self.parallel_ohm, regime.loop_ohm)
            tau_s = self.capacitance_f * resistance_ohm
            final_v = regime.drive_v / regime.loop_ohm * resistance_ohm
            step_s, edge_v = duration_s, None
            if may_change:
                step_s, index, edge_v = self._until_next_regime(
                    index, held_v, final_v, tau_s, duration_s
                )
            decayed = -expm1(-step_s / tau_s)
            held_area = final_v * step_s + (held_v - final_v) * tau_s * decayed
            charge_c += (regime.drive_v * step_s - held_area) / regime.loop_ohm
            duration_s -= step_s
            if edge_v is None:
                held_v += (final_v - held_v) * decayed
                break
            held_v = edge_v
        return held_v, charge_c

    def _until_next_regime(
        self, index: int, held_v: float, final_v: float, tau_s: float, left_s: float
    ) -> tuple[float, int, float | None]:
        """How long this regime lasts, which is next, and the held voltage at the change."""
        rising = final_v > held_v
        next_index = index + 1 if rising else index - 1
        if not 0 <= next_index <= 2:
            return left_s, index, None
        edge_v = self._edges_v()[index if rising else index - 1]
        beyond = final_v > edge_v if rising else final_v < edge_v
        if not beyond:
            return left_s, index, None
        step_s = max(0.0, -tau_s * log((edge_v - final_v) / (held_v - final_v)))
        if step_s >= left_s:
            return left_s, index, None
        return step_s, next_index, edge_v

    def _regimes(self) -> tuple[_Regime, _Regime, _Regime]:
        """Delivering what it is told; held at the compliance; delivering nothing."""
        with_leak_ohm = self.series_ohm + self.leak_ohm
        return (
            _Regime(self.source_a * self.leak_ohm, with_leak_ohm),
            _Regime(self.compliance_v, self.series_ohm),
            _Regime(0.0, with_leak_ohm),
        )

    def _edges_v(self) -> tuple[float, float]:
        """The held voltages at which the source reaches its compliance, and has to stop."""
        stop_v = self.compliance_v * (self.series_ohm + self.leak_ohm) / self.leak_ohm
        return stop_v - self.source_a * self.series_ohm, stop_v

    def _regime_of(self, held_v: float) -> int:
        limit_v, stop_v = self._edges_v()
        if held_v < limit_v:
            return 0
        return 1 if held_v < stop_v else 2


def parallel(a_ohm: float, b_ohm: float) -> float:
    """Two resistances beside one another; inf is none."""
    if a_ohm == inf:
        return b_ohm
    if b_ohm == inf:
        return a_ohm
    return a_ohm * b_ohm / (a_ohm + b_ohm)
