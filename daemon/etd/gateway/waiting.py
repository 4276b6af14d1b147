"""Requests that were read and are not handled yet, none of them a stop.

Owns: whose is next, and how much of a client and of a user may wait. Must not know: what a request
does, replies.

Of each client so much waits as it may leave unread, and of each user so much as that of as many
clients as there may be: one that connects, asks and leaves, again and again, is no new client each
time for the memory.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Final

from etd.gateway.connection import Connection
from etd.gateway.inbound import InboundMessage
from etd.gateway.places import MOST_CONNECTIONS
from etd.gateway.turns import Turns

#: Of one connection: so many, and so many bytes once one waits.
MOST_OF_A_CLIENT: Final = 64
MOST_BYTES_OF_A_CLIENT: Final = 131_072
#: Of one user, of clients that have left too.
MOST_OF_A_USER: Final = MOST_CONNECTIONS * MOST_OF_A_CLIENT
MOST_BYTES_OF_A_USER: Final = MOST_CONNECTIONS * MOST_BYTES_OF_A_CLIENT
#: What one takes beside its own bytes.
_OVERHEAD_BYTES: Final = 64


class WaitingRequests:
    def __init__(self) -> None:
        self._of_client: dict[Connection, deque[InboundMessage]] = {}
        self._bytes_of_client: Counter[Connection] = Counter()
        self._of_user: Counter[int] = Counter()
        self._bytes_of_user: Counter[int] = Counter()
        self._turns: Turns[Connection] = Turns()

    def bytes_of(self, client: Connection) -> int:
        return self._bytes_of_client[client]

    @property
    def may_go_on(self) -> bool:
        """Something waits for its turn alone, and not for a client that does not read."""
        return any(not client.has_unread for client in self._turns)

    def add(self, client: Connection, inbound: InboundMessage) -> str | None:
        """None if it waits now; or else why there is no room for it."""
        waiting, size_bytes = self._of_client.get(client, ()), _size_bytes(inbound)
        is_over = self._bytes_of_client[client] + size_bytes > MOST_BYTES_OF_A_CLIENT
        if waiting and (len(waiting) >= MOST_OF_A_CLIENT or is_over):
            return f"{len(waiting)} requests of this connection wait: read their replies first"
        count = self._of_user[client.uid]
        is_over = self._bytes_of_user[client.uid] + size_bytes > MOST_BYTES_OF_A_USER
        if count >= MOST_OF_A_USER or is_over:
            return f"{count} requests of this user wait: send again"
        self._of_client.setdefault(client, deque()).append(inbound)
        self._count(client, 1, size_bytes)
        self._turns.add(client.sender, client)
        return None

    def take(self) -> InboundMessage | None:
        """The oldest of the client whose turn it is, of those that have read their replies."""
        client = self._turns.take(lambda client: not client.has_unread)
        if client is None:
            return None
        waiting = self._of_client[client]
        inbound = waiting.popleft()
        self._count(client, -1, -_size_bytes(inbound))
        if waiting:
            self._turns.add(client.sender, client)
        else:
            del self._of_client[client], self._bytes_of_client[client]
        return inbound

    def _count(self, client: Connection, more: int, more_bytes: int) -> None:
        self._bytes_of_client[client] += more_bytes
        self._of_user[client.uid] += more
        self._bytes_of_user[client.uid] += more_bytes
        if not self._of_user[client.uid]:
            del self._of_user[client.uid], self._bytes_of_user[client.uid]


def _size_bytes(inbound: InboundMessage) -> int:
    """All its parts: what is no request, for its parts, waits for its refusal as well."""
    return len(inbound.data) + sum(map(len, inbound.route)) + _OVERHEAD_BYTES
