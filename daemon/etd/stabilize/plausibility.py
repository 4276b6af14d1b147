"""How much of what a measured resistance asks for is believed.

Owns: the rules and their order. Must not know: what a law goes by, limits.

First what all electrodes have in common for long (`common_mode.py`), which a wrong gain is, is
taken out of a widening; then an electrode that stands at its widest by itself
(`saturation_monitor.py`) is given up: it gets the pulse that the frame wants. What is left is still
bounded by the law's own `max_widening`. One that stands at its narrowest is told, and stays there:
nothing tells a reading that is too high from an edge of skin that carries all, and that one would
be hurt by what the frame wants. All of them judge readings and no skin: who touches, and whether
the supply was off meanwhile, is nothing to them; but who comes then is told again.
"""

from __future__ import annotations

from etd.stabilize.common_mode import CommonMode
from etd.stabilize.rejection import OnRejected
from etd.stabilize.saturation_monitor import SaturationMonitor, narrowest, widest


class Plausibility:
    """For all electrodes of one law, which widens `most` times at most."""

    def __init__(self, most: float, on_rejected: OnRejected) -> None:
        self._common_mode = CommonMode(on_rejected)
        self._widest = SaturationMonitor(widest(most), lambda: on_rejected("bound"))
        self._narrowest = SaturationMonitor(narrowest(), lambda: on_rejected("narrow"))

    def plausible(self, electrode: int, wanted: float, now_ns: int) -> float:
        """Of what a law wants by what is measured, as a factor above 0; never more than that."""
        own = self._common_mode.without_common(electrode, wanted, now_ns)
        # Told, no more.
        self._narrowest.is_rejected(electrode, 1.0 / own, now_ns)
        return min(own, 1.0) if self._widest.is_rejected(electrode, own, now_ns) else own

    def report_again(self) -> None:
        """What is doubted now is news to whoever comes."""
        for common in (self._common_mode, self._widest, self._narrowest):
            common.report_again()
