"""For how long what a pulse told of an electrode is believed.

Owns: the one bound that contact, resistance, factors and shares go by, and how often a look keeps
it. Must not know: what is
believed, what follows when it is not, clocks.

A second, because of how fast skin changes where nobody looks. In a second the busiest modelled hand
(`etd_body.course.BUSY`, peeling left out) changes the conductance of a contact by less than 45 % in
99 of 100 cases, which is less than what counts as peeling; in two seconds it is 84 %, and from then
on a resistance tells next to nothing of the one before. A finger can be taken off and laid down
again within a second; that is why a touch after none is soft, however short the time between.
"""

from __future__ import annotations

BELIEVED_NS = 1_000_000_000
#: Where looks are wanted, the next one comes so long after the last: two for what one may miss.
LOOK_AGAIN_NS = 500_000_000


def is_old(told_ns: int | None, now_ns: int) -> bool:
    """Whether what was told then is no longer believed; None: nobody told anything."""
    return told_ns is None or now_ns - told_ns >= BELIEVED_NS
