"""How much of a factor that a measured resistance suggests is accepted.

Owns: the rules and their order. Must not know: what a law goes by, limits.

First what all electrodes have in common for long (`common_mode.py`), which a wrong gain is, is
taken out of a widening; then an electrode that stands at its widest by itself
(`saturation_monitor.py`) is given up: it gets the pulse that the frame wants. What is left is still
bounded by the law's own `max_widening`. An electrode that stands at its narrowest is reported, and
stays there: a reading that is too high cannot be distinguished from an edge of skin that carries
all, which the frame's full pulse would hurt. These rules judge readings and not skin: they ignore
contact and the supply, but a rejection is reported again after the supply was off.
"""

from __future__ import annotations

from etd.stabilize.common_mode import CommonMode
from etd.stabilize.pipeline import OnRejected
from etd.stabilize.saturation_monitor import NARROWEST, SaturationMonitor, widest


class Plausibility:
    """The rules for all electrodes of a law, which widens `most` times at most."""

    def __init__(self, most: float, on_rejected: OnRejected) -> None:
        self._common_mode = CommonMode(on_rejected)
        self._widest = SaturationMonitor(widest(most), lambda: on_rejected("bound"))
        self._narrowest = SaturationMonitor(NARROWEST, lambda: on_rejected("narrow"))

    def plausible(self, electrode: int, wanted: float, now_ns: int) -> float:
        """The accepted part of the factor that a law wants, above 0; never more than the factor."""
        own = self._common_mode.without_common(electrode, wanted, now_ns)
        # Reported, and not rejected.
        self._narrowest.is_rejected(electrode, 1.0 / own, now_ns)
        return min(own, 1.0) if self._widest.is_rejected(electrode, own, now_ns) else own

    def report_again(self) -> None:
        """Report again what is rejected now."""
        for common in (self._common_mode, self._widest, self._narrowest):
            common.report_again()
