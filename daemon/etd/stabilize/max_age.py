"""For how long what a pulse told of an electrode is believed, and which resistances are.

Owns: the one bound in time that contact, resistance, factors and shares go by, how often a look
keeps it, and the bounds of what skin resists. Must not know: how it is measured, what follows when
it is not believed, clocks.

A second, because of how fast skin changes where nobody looks. In a second the busiest modelled hand
(`etd_body.course.BUSY`, peeling left out) changes the conductance of a contact by less than 45 % in
99 of 100 cases, which is less than what counts as peeling; in two seconds it is 84 %, and from then
on a resistance tells next to nothing of the one before. A finger can be taken off and laid down
again within a second; that is why a touch after none is soft, however short the time between.
"""

from __future__ import annotations

MAX_AGE_NS = 1_000_000_000
#: Where looks are wanted, the next one comes so long after the last: two for what one may miss.
CONTACT_POLL_NS = 500_000_000
#: Outside of these no contact with skin is believed to be one.
MIN_SKIN_OHM, MAX_SKIN_OHM = 1_000.0, 2_000_000.0


def is_stale(told_ns: int | None, now_ns: int) -> bool:
    """Whether what was told then is no longer believed; None: nobody told anything."""
    return told_ns is None or now_ns - told_ns >= MAX_AGE_NS
