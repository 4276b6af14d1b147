"""Both phases where one would leave more direct current than is allowed, if the body site says so.

Owns: which frames are balanced, with which phases, and how that is told. Must not know: how direct
current is foreseen (`net_forecast.py`), how pulses are planned.

Each pulse gets the other phase too, its own first, so a visit leaves nothing. It feels different:
so only a frame that names no polarity is balanced, the body site allows it (`balance`), a person's
calibrations have to hold for both phases, and the reply tells it. What decides is the frame alone,
by returns that share alike, and neither what was left before nor what conducts how well by now: one
that is renewed is felt the same all the time.
"""

from __future__ import annotations

from typing import Final, Literal

import msgspec

from etd.planning.net_forecast import NetLimit
from etd.protocol.errors import Refused
from etd.protocol.frame import Frame, Polarity
from etd.protocol.outcome import Shortfall
from etd.safety.limits import PersonLimits

_BALANCED: Final[dict[Polarity, Polarity]] = {
    "anodic": "biphasic",
    "cathodic": "biphasic_cathodic_first",
}


class NetBalance:
    """Of one lease, whose person it is for. `is_allowed`: whether the body site balances at all."""

    def __init__(self, balance: Literal["biphasic"] | None, person: PersonLimits) -> None:
        self.is_allowed: Final = balance is not None
        #: Empty: the lease has limits and no calibration, and they hold for any pulse.
        self._calibrated: Final = {each.polarity for each in person.calibrations}

    def form_of(self, frame: Frame, alone: NetLimit, default: Polarity) -> Frame | None:
        """The frame with both phases; None: it is not balanced. `alone`: what it would leave by
        itself; `default`: the polarity of frames that name none.

        A frame that stands, or one of so many pulses that they pass the bound. Who names a polarity
        gets that, or is refused; and so does who asks for what was sent or nothing (`strict`).

        Raises: Refused, where the person has no calibration for both phases.
        """
        both = _BALANCED.get(default)
        if both is None or frame.polarity is not None or frame.strict:
            return None
        if frame.pulses is not None and alone.after_s >= alone.shown_s:
            return None
        if self._calibrated and both not in self._calibrated:
            raise Refused("bad_calibration", f"there is no calibration for polarity {both}")
        return msgspec.structs.replace(frame, polarity=both)


def told_balanced(alone: NetLimit) -> Shortfall:
    """For the reply."""
    return Shortfall(electrode=alone.electrode, reason="balanced")
