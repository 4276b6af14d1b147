"""The requests that arrived and are not handled yet: a stop never waits behind another.

Owns: reading the control socket, in which order, and the stops among what it read.
Must not know: what a request does, replies.

Whether one is a stop is known of its op alone. All others are decoded when their turn comes: what
waits are the bytes that came, so that a bound of these is one of the memory; decoded, arrays take
ten times as much.

A request may take the gateway long (a calibration that is read from a disk), and more of them may
wait than it handles in a turn. So what has arrived is read before each request is handled, and
stops go first. A flood is not known by who sends it: one user may be all there is, and a program
may have as many processes as connections. It is known by what it has sent already. A client of
which little is stored here, as of one that wants nothing but to stop, is read before each request;
all others are read in turn. What waits is bounded: a client that sends more than it is answered is
refused. And a request of a client that has not read its last replies waits until it has.
"""

from __future__ import annotations

import itertools
from collections import deque
from typing import Final, TypeAlias

from etd.gateway.connection import Connection
from etd.gateway.inbound import (
    InboundMessage,
    Unreadable,
    id_of,
    inbound_of,
    is_stop,
    read_request,
    without_frames,
)
from etd.gateway.sockets import Sockets
from etd.gateway.waiting import WaitingRequests
from etd.protocol.errors import Refused
from etd.protocol.messages import Id, Request

Waiting: TypeAlias = tuple[Request | Unreadable, InboundMessage]

#: So many are read before each request that is handled, beside one of each client of which little
#: is stored: a flood leaves room for handling.
MOST_A_LOOK: Final = 8
#: Not handled, or not whole, yet: some short requests, or the half of a handshake.
LITTLE_BYTES: Final = 512
_NO_PLACE = (
    "this user has all connections: this one is heard only to stop; close some of the others"
)


class RequestQueue:
    def __init__(self, sockets: Sockets) -> None:
        self._sockets = sockets
        self._stops: deque[Waiting] = deque()
        self._others = WaitingRequests()
        #: Guests that asked for something else than to stop: they get a reply to that, and leave.
        self._leaving: list[Connection] = []
        #: How many were read, stops and refused ones included.
        self.read = 0

    def look(self) -> list[tuple[Refused, Id | None, InboundMessage]]:
        """Read what has arrived. Returns what is refused, since too much waits already."""
        refused = []
        leaving, self._leaving = self._leaving, []
        self._sockets.look()
        control = self._sockets.control
        of_each, in_turn = control.take_each(self._has_little), control.take(MOST_A_LOOK)
        for connection, parts in itertools.chain(of_each, in_turn):
            self.read += 1
            inbound = inbound_of(connection, parts)
            if is_stop(inbound):
                self._stops.append((_read(inbound), inbound))
                continue
            if connection.is_guest:
                self._leaving.append(connection)
                why: str | None = _NO_PLACE
            else:
                why = self._others.add(connection, inbound)
            if why is not None:
                refused.append((Refused("busy", why), id_of(inbound), inbound))
        for guest in leaving:
            control.turn_away(guest)
        return refused

    def take_stop(self) -> Waiting | None:
        return self._stops.popleft() if self._stops else None

    def take(self) -> Waiting | None:
        """No stop, and there is room for its reply: the oldest of the client whose turn it is."""
        inbound = self._others.take()
        return None if inbound is None else (_read(inbound), inbound)

    @property
    def is_idle(self) -> bool:
        """Nothing waits but for a client that does not read."""
        return not self._stops and not self._others.may_go_on

    def _has_little(self, client: Connection) -> bool:
        return client.stored_bytes + self._others.bytes_of(client) < LITTLE_BYTES


def _read(inbound: InboundMessage) -> Request | Unreadable:
    try:
        return read_request(inbound)
    except Unreadable as unreadable:
        return without_frames(unreadable)
