"""How long a measurement of an electrode is valid, and which resistances skin can have.

Owns: the age at which contact, resistance, factors and shares expire, how often a contact poll
renews them, and the bounds of skin resistance. Must not know: how they are measured, what follows
when they expire, clocks.

A second, because of how fast skin changes between measurements. In a second the busiest modelled
hand (`etd_body.course.BUSY`, peeling left out) changes the conductance of a contact by less than 45
% in 99 of 100 cases, which is less than what counts as peeling; in two seconds it is 84 %, and from
then on a resistance says next to nothing of the one before. A finger can be taken off and laid down
again within a second; that is why a touch after an open contact is soft, however short the time
between.
"""

from __future__ import annotations

from typing import Literal

ContactState = Literal["unknown", "open", "soft", "closed", "saturated", "shorted"]

MAX_AGE_NS = 1_000_000_000
#: Time between contact polls: two fit into MAX_AGE_NS, so that one may be missed.
CONTACT_POLL_NS = 500_000_000
#: A resistance outside of these is none of skin.
MIN_SKIN_OHM, MAX_SKIN_OHM = 1_000.0, 2_000_000.0
#: Skin resists less at higher currents: R x (I + 8 mA) is constant (docs/body.md).
BEND_UA = 8_000.0


def is_stale(told_ns: int | None, now_ns: int) -> bool:
    """Whether a measurement of that time has expired; None: there is none."""
    return told_ns is None or now_ns - told_ns >= MAX_AGE_NS
