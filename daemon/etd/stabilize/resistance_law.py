"""What all laws that follow a resistance have in common.

Owns: what they compare with, which factors they accept, and how fast
they rise. Must not know: what a law makes of a resistance, what it changes of a pulse, limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.law_settings import ResistanceLawSettings
from etd.stabilize.pipeline import ElectrodeEstimate, OnRejected
from etd.stabilize.plausibility import Plausibility
from etd.stabilize.reference import References
from etd.stabilize.slew import SlewLimiter


class ResistanceLaw:
    """Requests at most `max_widening` times what is wanted, and rises by at most `rise_per_s`."""

    def __init__(self, settings: ResistanceLawSettings, on_rejected: OnRejected) -> None:
        most = self._max_widening = settings.max_widening
        self._min_width_us = settings.min_width_us
        self._references = References()
        self._plausibility = Plausibility(most, on_rejected)
        self._slew = SlewLimiter(1.0, settings.rise_per_s)
        self.max_gain = MaxGain(width=most, charge=most)

    def reset(self) -> None:
        """The supply was off. A rejection depends on readings: it stays, and is reported again."""
        self._plausibility.report_again()
        self._references.reset()
        self._slew.reset()

    def _factor(
        self,
        request: PulseRequest,
        estimate: ElectrodeEstimate,
        law: Callable[[Sequence[float], float], float],
    ) -> float:
        """The accepted factor of `law(seen_ohm, reference_ohm)`; toward 1 if none is believed."""
        compared = self._references.compared(estimate, request.current_ua)
        if compared is None:
            return self._slewed(estimate, 1.0)
        *seen_ohm, reference_ohm = compared
        wanted = self._plausible(estimate, law(seen_ohm, reference_ohm))
        return self._slewed(estimate, wanted)

    def _plausible(self, estimate: ElectrodeEstimate, wanted: float) -> float:
        return self._plausibility.plausible(estimate.electrode, wanted, estimate.now_ns)

    def _slewed(self, estimate: ElectrodeEstimate, wanted: float) -> float:
        """Bounded, and at most 1 at a soft contact; it rises slowly and falls at once."""
        most = 1.0 if estimate.state == "soft" else self._max_widening
        return self._slew.toward(estimate.electrode, min(wanted, most), estimate.now_ns)
