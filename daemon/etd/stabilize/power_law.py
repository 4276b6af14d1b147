"""Power law: a width for a resistance, by a power that was fitted to a person.

Owns: the law below. Must not know: how resistance is measured, how k is measured, limits.

Absolute threshold can be measured against skin resistance, and a function found that gives the
width for a resistance; it took away spatial and much temporal variation (Kajimoto, Electro-tactile
Display, section 4.3; Kajimoto 2012, IEEE Trans. Haptics; Watanabe, Futami and Hoshimiya on what
resistance tells of threshold). The published function could not be read, so this one is by design:
bounded, monotone, one number a person,

    w = w0 x (R / R0)^-k

k = 0 changes nothing, k = 1 holds I^2 R w (the skin's power without the board's leak), k < 0
lengthens the pulse as resistance rises. k is measured on the person, within electrodes over several
states of the skin (`etd.calibrate.exponent`), and stands in the calibration; there is no default,
and without it the pulse is what was wanted. Width grows by at most
`max_widening`; below `min_width_us` the current falls instead, so that the charge is the same. The
factor rises by at most `rise_per_s` and falls at once. Without an accepted resistance the pulse is
what was wanted; not all widening is believed (`plausibility.py`), and a soft contact gets none.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.pulse.request import PulseRequest
from etd.stabilize.law_settings import PowerLawSettings
from etd.stabilize.pipeline import ElectrodeEstimate, OnRejected, ignore_rejection
from etd.stabilize.resistance_law import ResistanceLaw
from etd.stabilize.rounding import as_charge


class PowerLaw(ResistanceLaw):
    def __init__(self, law: PowerLawSettings, on_rejected: OnRejected = ignore_rejection) -> None:
        super().__init__(law, on_rejected)
        #: Of the person that wears the display now.
        self._k = 0.0

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        if estimate.exponent is None:
            return request
        self._k = estimate.exponent
        factor = self._factor(request, estimate, self._wanted)
        if factor == 1.0:
            return request
        width_us = request.width_us * factor
        return as_charge(request, width_us, self._min_width_us, self._max_widening)

    def _wanted(self, seen_ohm: Sequence[float], reference_ohm: float) -> float:
        wanted: float = min((ohm / reference_ohm) ** -self._k for ohm in seen_ohm)
        return wanted
