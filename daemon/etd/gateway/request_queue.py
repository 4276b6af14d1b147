"""The requests that arrived and are not handled yet: a stop never waits behind another.

Owns: reading the control socket, the stops among what it read, and how much of a client may wait.
Must not know: what a request does, replies.

Whether one is a stop is known of its op alone. All others are decoded when their turn comes: what
waits are the bytes that came, so that a bound of these is one of the memory; decoded, arrays take
ten times as much.

A request may take the gateway long (a calibration that is read from a disk), and more of them may
wait than it handles in a turn. So what has arrived is read before each request is handled, and
stops go first. What waits is bounded: a client that sends more than it is answered is refused. And
a request of a client that has not read its last replies waits until it has.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
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
from etd.gateway.turns import Turns
from etd.protocol.errors import Refused
from etd.protocol.messages import Id, Request

Waiting: TypeAlias = tuple[Request | Unreadable, InboundMessage]

#: So many are read before each request that is handled: processes are read in turn, so a stop is
#: found within a few of them, and a flood leaves room for handling.
MOST_A_LOOK: Final = 8
#: Of one connection: so many, and so many bytes once one waits.
MOST_OF_A_CLIENT: Final = 64
MOST_BYTES_OF_A_CLIENT: Final = 131_072


@dataclass(frozen=True, eq=False)
class _Other:
    """No stop: it waits for its turn."""

    inbound: InboundMessage
    connection: Connection

    @property
    def has_room(self) -> bool:
        """For its reply."""
        return not self.connection.has_unread


class RequestQueue:
    def __init__(self, sockets: Sockets) -> None:
        self._sockets = sockets
        self._stops: deque[Waiting] = deque()
        self._others: Turns[_Other] = Turns()
        #: By connection.
        self._of_client: Counter[int] = Counter()
        self._bytes_of_client: Counter[int] = Counter()
        #: How many were read, stops and refused ones included.
        self.read = 0

    def look(self) -> list[tuple[Refused, Id | None, InboundMessage]]:
        """Read what has arrived. Returns what is refused, since too much waits already."""
        refused = []
        self._sockets.look()
        for connection, parts in self._sockets.control.take(MOST_A_LOOK):
            self.read += 1
            inbound = inbound_of(connection, parts)
            if is_stop(inbound):
                self._stops.append((_read(inbound), inbound))
            elif self._has_room(inbound):
                self._others.add(connection.pid, _Other(inbound, connection))
                self._of_client[inbound.connection] += 1
                self._bytes_of_client[inbound.connection] += len(inbound.data)
            else:
                count = self._of_client[inbound.connection]
                why = f"{count} requests of this connection wait: read their replies first"
                refused.append((Refused("busy", why), id_of(inbound), inbound))
        return refused

    def take_stop(self) -> Waiting | None:
        return self._stops.popleft() if self._stops else None

    def take(self) -> Waiting | None:
        """No stop, and there is room for its reply: the oldest of the process whose turn it is."""
        other = self._others.take(lambda other: other.has_room)
        if other is None:
            return None
        self._forget(other.inbound)
        return _read(other.inbound), other.inbound

    @property
    def is_idle(self) -> bool:
        """Nothing waits but for a client that does not read."""
        return not self._stops and not any(other.has_room for other in self._others)

    def _has_room(self, inbound: InboundMessage) -> bool:
        count, waiting_bytes = (
            counter[inbound.connection] for counter in (self._of_client, self._bytes_of_client)
        )
        fits = waiting_bytes + len(inbound.data) <= MOST_BYTES_OF_A_CLIENT
        return not count or (count < MOST_OF_A_CLIENT and fits)

    def _forget(self, inbound: InboundMessage) -> None:
        self._of_client[inbound.connection] -= 1
        self._bytes_of_client[inbound.connection] -= len(inbound.data)
        if not self._of_client[inbound.connection]:
            del self._of_client[inbound.connection], self._bytes_of_client[inbound.connection]


def _read(inbound: InboundMessage) -> Request | Unreadable:
    try:
        return read_request(inbound)
    except Unreadable as unreadable:
        return without_frames(unreadable)
