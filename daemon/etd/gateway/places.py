"""How many may be connected to a socket, and who gives way to a newcomer when there is no room.

Owns: that rule. Must not know: sockets, what a message means.

A connection that has sent something which is not read yet never gives way: it may be a stop.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

from etd.gateway.connection import Connection

#: On each of three sockets: far below a process's usual limit of 1 024 descriptors.
MOST_CONNECTIONS = 80
#: Beside these on the control socket, heard only to stop: newcomers of a user whose processes have
#: all the places.
MOST_GUESTS = 16
#: Of one process: a client tries whether its address is served, by a connection that it closes, and
#: then connects.
_MOST_GUESTS_OF_A_PROCESS = 4


class Verdict(NamedTuple):
    """On a newcomer, and who has to leave before it is let in."""

    is_let_in: bool
    leaving: Connection | None = None
    is_guest: bool = False


def let_in(
    newcomer: Connection, held: Sequence[Connection], most_guests: int, is_last: bool = False
) -> Verdict:
    """`held`: all that are connected, the oldest first. `is_last`: it has the last descriptor, so
    one of them leaves or it does.
    """
    seated = [made for made in held if not made.is_guest]
    if len(seated) < MOST_CONNECTIONS and not is_last:
        return Verdict(True)
    leaving = _gives_way(newcomer, seated)
    if leaving is not None:
        return Verdict(True, leaving)
    return _as_guest(newcomer, held, 0 if is_last else most_guests)


def seat_a_guest(held: Sequence[Connection]) -> None:
    """The oldest of them takes a place, if one is free now."""
    guests = [made for made in held if made.is_guest]
    if guests and len(held) - len(guests) < MOST_CONNECTIONS:
        guests[0].is_guest = False


def silent_one(held: Sequence[Connection]) -> Connection | None:
    """The oldest that never sent a byte, or else the oldest that never completed its handshake."""
    unspoken = (made for made in held if not made.has_spoken)
    unready = (made for made in held if not made.is_ready)
    both = itertools.chain(unspoken, unready)
    return next((made for made in both if not made.has_sent_more()), None)


def _gives_way(newcomer: Connection, seated: Sequence[Connection]) -> Connection | None:
    """The longest silent one, of the process that has most first, and of no process that has fewer
    than the newcomer's: else one that connects again and again would end others during their
    handshake. Or else one of the user, or of the process, that has the most, if it has more than
    the newcomer's. For a newcomer of the process that has most only a silent one of its own does.
    """
    of_process = Counter(made.sender for made in seated)
    heaviest = max(of_process.values(), default=0)
    if of_process[newcomer.sender] >= heaviest:
        return silent_one([made for made in seated if made.sender == newcomer.sender])
    silent = silent_one([made for made in seated if of_process[made.sender] == heaviest])
    newcomers = of_process[newcomer.sender]
    silent = silent or silent_one([it for it in seated if of_process[it.sender] > newcomers])
    if silent is not None:
        return silent
    owner: Callable[[Connection], object]
    for owner in (lambda made: made.uid, lambda made: made.sender):
        counts = Counter(map(owner, seated))
        ((most_of, most),) = counts.most_common(1)
        if most > counts[owner(newcomer)] + 1:
            return _youngest_of_the_heaviest([it for it in seated if owner(it) == most_of])
    return None


def _youngest_of_the_heaviest(theirs: Sequence[Connection]) -> Connection | None:
    """Of those of their processes that have most, past its handshake and with nothing unread."""
    places = Counter(made.sender for made in theirs)
    most = max(places.values())
    heaviest = (made for made in reversed(theirs) if places[made.sender] == most and made.is_ready)
    return next((made for made in heaviest if not made.has_sent_more()), None)


def _as_guest(newcomer: Connection, held: Sequence[Connection], most_guests: int) -> Verdict:
    """Of a process that has no place; where the room of guests is taken, one leaves."""
    guests = [made for made in held if made.is_guest]
    own = [made for made in held if made.sender == newcomer.sender]
    if not all(made.is_guest for made in own) or len(own) >= _MOST_GUESTS_OF_A_PROCESS:
        return Verdict(False)
    if len(guests) < most_guests:
        return Verdict(True, is_guest=True)
    said_all = (made for made in guests if not made.has_sent_more())
    leaving = silent_one(guests) or next(said_all, None)
    return Verdict(leaving is not None, leaving, is_guest=True)
