"""Those who read telemetry: each gets the topics it asked for, as long as it reads.

Owns: subscriptions, of topics that there are and of no others. Must not know: what a report says.
"""

from __future__ import annotations

from collections import Counter

from etd.gateway.connection import Connection
from etd.gateway.listener import Listener
from etd.protocol.messages import TOPICS
from etd.protocol.zmtp import message

#: A subscription is a byte and a topic, or the beginning of one.
MAX_SUBSCRIPTION_BYTES = 64
#: At most this many are read in one turn.
_SUBSCRIPTIONS_A_TURN = 64
#: A client of a later version may know some topics more; one that asks for these is no client.
_MOST_UNKNOWN = 32
_TOPICS = tuple(topic.encode() for topic in TOPICS)
_CANCEL, _SUBSCRIBE = b"\0", b"\1"


class Subscribers:
    """Never blocks: a report is lost for a subscriber that does not read, and for no other."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._counts: Counter[str] = Counter()

    def take_counts(self) -> Counter[str]:
        """Reports that did not fit, and subscriptions to no topic, since the last call."""
        counts, self._counts = self._counts, Counter()
        return counts

    def take_newcomers(self) -> set[Connection]:
        """Read what subscribers sent; those who subscribed to something."""
        newcomers = set()
        for connection, parts in self._listener.take(_SUBSCRIPTIONS_A_TURN):
            action, topic = parts[0][:1], parts[0][1:]
            if action == _CANCEL:
                connection.topics.discard(topic)
            elif action == _SUBSCRIBE and self._subscribe(connection, topic):
                newcomers.add(connection)
        return newcomers

    def publish(self, topic: bytes, body: bytes, only: set[Connection] | None = None) -> None:
        """To all who want it, or of them to `only` these."""
        data = message((topic, body))
        for connection in self._listener.connections() if only is None else only:
            is_wanted = any(topic.startswith(wanted) for wanted in connection.topics)
            if is_wanted and not self._listener.send(connection, data):
                self._counts["reports_not_delivered"] += 1

    def _subscribe(self, connection: Connection, topic: bytes) -> bool:
        if any(known.startswith(topic) for known in _TOPICS):
            connection.topics.add(topic)
            return True
        self._counts["subscriptions_to_nothing"] += 1
        connection.unknown_topics += 1
        if connection.unknown_topics > _MOST_UNKNOWN:
            self._listener.break_off(connection)
        return False
