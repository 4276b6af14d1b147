"""What all laws that follow a resistance have in common.

Owns: what they compare with, what they believe of it, and how fast they give more. Must not know:
what a law makes of a resistance, which part of a pulse it changes, limits.
"""

from __future__ import annotations

from etd.stabilize.pipeline import ElectrodeEstimate, MaxGain
from etd.stabilize.plausibility import Plausibility
from etd.stabilize.reference import References
from etd.stabilize.rejection import OnRejected
from etd.stabilize.slew import SlewLimiter


class RatioTracker:
    """Of one law, which asks for at most `max_widening` times what is wanted, and comes there by at
    most `rise_per_s`.
    """

    def __init__(self, max_widening: float, rise_per_s: float, on_rejected: OnRejected) -> None:
        self._max_widening = max_widening
        self._references = References()
        self._plausibility = Plausibility(max_widening, on_rejected)
        self._factor = SlewLimiter(1.0, rise_per_s)
        self.max_gain = MaxGain(width=max_widening, charge=max_widening)

    def reset(self) -> None:
        """The supply was off. What is not believed stays so, since it goes by readings, and is told
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
        """See `Trust.believed`."""
        return self._plausibility.plausible(estimate.electrode, wanted, estimate.now_ns)

    def factor(self, estimate: ElectrodeEstimate, wanted: float) -> float:
        """What comes of a factor that is believed: bounded, no more than 1 at a soft contact; a
        rise takes its time, a fall is at once.
        """
        most = 1.0 if estimate.state == "soft" else self._max_widening
        return self._factor.toward(estimate.electrode, min(wanted, most), estimate.now_ns)
