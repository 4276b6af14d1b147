"""The requests that arrived and are not handled yet: a stop never waits behind another.

Owns: reading the control socket, the stops among what it read, and how much may wait of a client
and of all. Must not know: what a request does, replies.

A request may take the gateway long (a calibration that is read from a disk), and more of them may
wait than it handles in a turn. So what has arrived is read before each request is handled, and
stops go first. What waits then is bounded: a client that sends more than it is answered is refused.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Final, TypeAlias

from etd.gateway.inbound import InboundMessage, Unreadable, inbound_of, read_request, without_frames
from etd.gateway.sockets import Socket, arrived
from etd.protocol.errors import Refused
from etd.protocol.messages import Id, Request, Stop

Waiting: TypeAlias = tuple[Request | Unreadable, InboundMessage]

#: So many are read at once: a stop of one connection is among them whatever 63 others send, since
#: ZeroMQ reads connections in turn.
MOST_A_LOOK: Final = 64
#: Of one connection, and of all together.
MOST_OF_A_CLIENT: Final = 64
MOST_BYTES: Final = 4_000_000


class RequestQueue:
    def __init__(self, socket: Socket) -> None:
        self._socket = socket
        self._stops: deque[Waiting] = deque()
        self._others: deque[Waiting] = deque()
        self._of_client: Counter[tuple[bytes, ...]] = Counter()
        self._bytes = 0

    def look(self) -> list[tuple[Refused, Id | None, InboundMessage]]:
        """Read what has arrived. Returns what is refused, since too much waits already."""
        refused = []
        for parts in arrived(self._socket, MOST_A_LOOK):
            inbound = inbound_of(parts)
            request = _read(inbound)
            if isinstance(request, Stop):
                self._stops.append((request, inbound))
            elif (why := self._why_not(inbound)) is not None:
                refused.append((Refused("busy", why), request.id, inbound))
            else:
                self._others.append((request, inbound))
                self._of_client[inbound.route] += 1
                self._bytes += len(inbound.data)
        return refused

    def take_stop(self) -> Waiting | None:
        return self._stops.popleft() if self._stops else None

    def take(self) -> Waiting | None:
        """The oldest that is no stop."""
        if not self._others:
            return None
        found = self._others.popleft()
        inbound = found[1]
        self._bytes -= len(inbound.data)
        self._of_client[inbound.route] -= 1
        if not self._of_client[inbound.route]:
            del self._of_client[inbound.route]
        return found

    @property
    def is_empty(self) -> bool:
        return not self._stops and not self._others

    def _why_not(self, inbound: InboundMessage) -> str | None:
        if self._of_client[inbound.route] >= MOST_OF_A_CLIENT:
            return f"{MOST_OF_A_CLIENT} requests of this connection wait: await their replies first"
        if self._bytes + len(inbound.data) > MOST_BYTES:
            return "the daemon has more requests than it can hold: send again"
        return None


def _read(inbound: InboundMessage) -> Request | Unreadable:
    try:
        return read_request(inbound)
    except Unreadable as unreadable:
        return without_frames(unreadable)
