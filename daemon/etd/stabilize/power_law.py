"""Power law: a width for a resistance, by a power that was fitted to a person.

Owns: the law below. Must not know: how resistance is measured, how k is fitted, limits.

Absolute threshold can be measured against skin resistance, and a function found that gives the
width for a resistance; it took away spatial and much temporal variation (Kajimoto, Electro-tactile
Display, section 4.3; Kajimoto 2012, IEEE Trans. Haptics; Watanabe, Futami and Hoshimiya on what
resistance tells of threshold). The published function could not be read, so this one is by design:
bounded, monotone, one number a person,

    w = w0 x (R / R0)^-k

k = 0 changes nothing, k = 1 holds I^2 R w (the skin's power without the board's leak), k < 0
lengthens the pulse as resistance rises. k comes from a regression of log threshold width on log
resistance over the electrodes of a calibration; there is no default. Width grows by at most
`max_widening`; below `min_width_us` the current falls instead, so that the charge is the same. The
factor rises by at most `rise_per_s` and falls at once. Without an accepted resistance the pulse is
what was wanted; not all widening is believed (`plausibility.py`), and a soft contact gets none.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from etd.pulse.request import PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.ratio_tracker import RatioTracker
from etd.stabilize.rejection import OnRejected, ignore_rejection
from etd.stabilize.rounding import as_charge


class PowerLawSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a body-site file says of it."""

    k: Annotated[float, Meta(ge=-2.0, le=2.0)]
    max_widening: Annotated[float, Meta(ge=1.0, le=4.0)] = 1.5
    min_width_us: Annotated[int, Meta(ge=20, le=200)] = 35
    rise_per_s: Annotated[float, Meta(ge=0.01, le=20.0)] = 1.0


class PowerLaw:
    def __init__(self, law: PowerLawSettings, on_rejected: OnRejected = ignore_rejection) -> None:
        self._law = law
        self._tracker = RatioTracker(law.max_widening, law.rise_per_s, on_rejected)
        self.max_gain = self._tracker.max_gain

    def reset(self) -> None:
        self._tracker.reset()

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        law, wanted = self._law, 1.0
        compared = self._tracker.compared(estimate, request.current_ua)
        if compared is not None:
            *seen_ohm, reference_ohm = compared
            wanted = min((ohm / reference_ohm) ** -law.k for ohm in seen_ohm)
            wanted = self._tracker.plausible(estimate, wanted)
        factor = self._tracker.factor(estimate, wanted)
        if factor == 1.0:
            return request
        return as_charge(request, request.width_us * factor, law.min_width_us, law.max_widening)
