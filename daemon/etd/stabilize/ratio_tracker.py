"""What all laws that follow a resistance have in common.

Owns: what they compare with, which factors they accept, and how fast they rise. Must not know: what
a law makes of a resistance, which part of a pulse it changes, limits.
"""

from __future__ import annotations

from etd.pulse.request import MaxGain
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.plausibility import Plausibility
from etd.stabilize.reference import References
from etd.stabilize.rejection import OnRejected
from etd.stabilize.slew import SlewLimiter


class RatioTracker:
    """The tracker of a law, which requests at most `max_widening` times what is wanted, and rises
    by at most `rise_per_s`.
    """

    def __init__(self, max_widening: float, rise_per_s: float, on_rejected: OnRejected) -> None:
        self._max_widening = max_widening
        self._references = References()
        self._plausibility = Plausibility(max_widening, on_rejected)
        self._factor = SlewLimiter(1.0, rise_per_s)
        self.max_gain = MaxGain(width=max_widening, charge=max_widening)

    def reset(self) -> None:
        """The supply was off. A rejection stays, since it depends on readings, and is reported
        again.
        """
        self._plausibility.report_again()
        self._references.reset()
        self._factor.reset()

    def compared(
        self, estimate: ElectrodeEstimate, wanted_ua: int
    ) -> tuple[float, float, float] | None:
        """See `References.compared`."""
        return self._references.compared(estimate, wanted_ua)

    def plausible(self, estimate: ElectrodeEstimate, wanted: float) -> float:
        """See `Plausibility.plausible`."""
        return self._plausibility.plausible(estimate.electrode, wanted, estimate.now_ns)

    def factor(self, estimate: ElectrodeEstimate, wanted: float) -> float:
        """The accepted factor: bounded, at most 1 at a soft contact; it rises slowly and falls at
        once.
        """
        most = 1.0 if estimate.state == "soft" else self._max_widening
        return self._factor.toward(estimate.electrode, min(wanted, most), estimate.now_ns)
