"""Fitted: a width for a resistance, by a power that was fitted to a person.

Owns: the law below. Must not know: how resistance is measured, how k is fitted, limits.

Absolute threshold can be measured against skin resistance, and a function found that gives the
width for a resistance; it took away spatial and much temporal variation (Kajimoto, Electro-tactile
Display, section 4.3; Kajimoto 2012, IEEE Trans. Haptics; Watanabe, Futami and Hoshimiya on what
resistance tells of threshold). The published function could not be read, so this one is by design:
bounded, monotone, one number a person,

    w = w0 x (R / R0)^-k

k = 0 changes nothing, k = 1 holds I^2 R w (the skin's power without the board's leak), k < 0
lengthens the pulse as resistance rises. k comes from a regression of log threshold width on
log resistance over the electrodes of a calibration; there is no default. Width grows by at most
`most_wider`; below `narrowest_us` the current falls instead, so that the charge is the same. The
factor rises by at most `rise_per_s` and falls at once. Without a believed resistance the pulse is
what was wanted; not all widening is believed (`trust.py`), and a soft contact gets none.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from etd.stabilize.following import Following
from etd.stabilize.pipeline import Known, Wish
from etd.stabilize.rounding import as_charge
from etd.stabilize.tell import Tell, unheard


class FittedLaw(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a body-site file says of it."""

    k: Annotated[float, Meta(ge=-2.0, le=2.0)]
    most_wider: Annotated[float, Meta(ge=1.0, le=4.0)] = 1.5
    narrowest_us: Annotated[int, Meta(ge=20, le=200)] = 35
    rise_per_s: Annotated[float, Meta(ge=0.01, le=20.0)] = 1.0


class Fitted:
    """See the module."""

    def __init__(self, law: FittedLaw, tell: Tell = unheard) -> None:
        self._law = law
        self._following = Following(law.most_wider, law.rise_per_s, tell)
        self.reach = self._following.reach

    def forget(self) -> None:
        self._following.forget()

    def ask(self, wish: Wish, known: Known) -> Wish:
        law, wanted = self._law, 1.0
        compared = self._following.compared(known, wish.current_ua)
        if compared is not None:
            *seen_ohm, reference_ohm = compared
            wanted = min((ohm / reference_ohm) ** -law.k for ohm in seen_ohm)
            wanted = self._following.believed(known, wanted)
        factor = self._following.factor(known, wanted)
        if factor == 1.0:
            return wish
        return as_charge(wish, wish.width_us * factor, law.narrowest_us, law.most_wider)
