"""A frame of single phases whose direct current would pass the bound, as a body site balances it.

Owns: which frames are balanced, with which phases, and how that is told. Must not know: how direct
current is foreseen (`net_forecast.py`), how pulses are planned.

Each of its pulses gets the other phase too, the frame's own first, so a visit leaves nothing. It
feels different from what was asked for: the body site allows that (`balance`), and the reply tells
it. What decides is the frame and how its returns conduct, not what was left before: one that is
renewed is felt the same from its first pulse to its last.
"""

from __future__ import annotations

from typing import Final

import msgspec

from etd.planning.net_forecast import NetLimit
from etd.protocol.errors import Refused
from etd.protocol.frame import Frame, Polarity
from etd.protocol.outcome import Shortfall

_BALANCED: Final[dict[Polarity, Polarity]] = {
    "anodic": "biphasic",
    "cathodic": "biphasic_cathodic_first",
}


def is_to_balance(frame: Frame, limit: NetLimit) -> bool:
    """A frame that stands, or one of so many pulses that they pass the bound. Who asks for what was
    sent or nothing (`strict`) gets no other pulses.
    """
    if frame.strict:
        return False
    return frame.pulses is None or limit.after_s < limit.shown_s


def balanced_form(frame: Frame, default: Polarity) -> Frame:
    """The frame with both phases. `default`: of a frame that names no polarity."""
    asked = default if frame.polarity is None else frame.polarity
    if isinstance(asked, tuple):
        both: Polarity | tuple[Polarity, ...] = tuple([_BALANCED.get(it, it) for it in asked])
    else:
        both = _BALANCED.get(asked, asked)
    return msgspec.structs.replace(frame, polarity=both)


def told_balanced(limit: NetLimit) -> Shortfall:
    """For the reply."""
    return Shortfall(electrode=limit.electrode, reason="balanced")


def not_balanced(refusal: Refused, limit: NetLimit) -> Refused:
    """Why it cannot have both phases, and that it was to have them."""
    return Refused(
        refusal.code,
        f"electrode {limit.electrode} would get more net charge than is allowed if this frame"
        f' stood, so it gets both phases (balance = "biphasic" in the body site). {refusal.reason}',
        refusal.electrode,
        refusal.achievable_hz,
        refusal.bound_by,
    )
