"""The daemon's telemetry, as typed reports.

Owns: the subscription, and its reports, waited for (`Telemetry`; `aio_telemetry.py` awaits them).
Must not know: requests, leases, asyncio.

Both first subscribe to `state` as well: the daemon sends one to each new subscriber, which shows
that the subscription is complete.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Generic, TypeAlias, TypeVar

import msgspec
import zmq

from etd.client import clock, values
from etd.protocol.errors import HELD_UP, DaemonGone, Refused
from etd.protocol.messages import TELEMETRY_OF_TOPIC, TOPICS, Topic
from etd.protocol.messages import Telemetry as Report

Item: TypeAlias = tuple[Topic, Report]
S = TypeVar("S", bound="zmq.Socket[Any]")

_decoders: dict[bytes, tuple[Topic, msgspec.json.Decoder[Any]]] = {
    topic.encode(): (topic, msgspec.json.Decoder(TELEMETRY_OF_TOPIC[topic])) for topic in TOPICS
}


class Subscription(Generic[S]):
    """What both share; no topics: all of them. Raises: Refused (`bad_message`), if one is none."""

    def __init__(
        self,
        context: zmq.Context[S],
        address: str,
        topics: tuple[Topic, ...] = (),
        timeout_s: float | None = None,
        join_s: float = 2.0,
    ) -> None:
        unknown = [topic for topic in topics if topic not in TOPICS]
        if unknown:
            reason = f"there is no topic {unknown[0]!r}: choose of {', '.join(TOPICS)}"
            raise Refused("bad_message", reason)
        self._address = address
        self._wanted = topics or TOPICS
        self._timeout_s = None if timeout_s is None else values.above_zero_s("timeout_s", timeout_s)
        self._join_s = join_s
        self._socket = _subscribe(context.socket(zmq.SUB), address, self._wanted)
        #: Until the subscription is complete, `state` is received as well.
        self._received: tuple[Topic, ...] = TOPICS
        self._first: Item | None = None

    def close(self) -> None:
        """Idempotent."""
        self._socket.close()

    def _joined(self, item: Item | None) -> None:
        """`item`: the first one. Raises: DaemonGone if there is none."""
        if item is None:
            self.close()
            raise DaemonGone(self._address, f"no telemetry within {self._join_s:g} s", HELD_UP)
        self._first = item if item[0] in self._wanted else None
        self._received = self._wanted
        if "state" not in self._wanted:
            self._socket.setsockopt(zmq.UNSUBSCRIBE, b"state")

    def _silent(self) -> DaemonGone:
        return DaemonGone(self._address, f"no telemetry for {self._timeout_s:g} s", HELD_UP)

    def _take_first(self) -> Item | None:
        first, self._first = self._first, None
        return first

    def _decoded(self, parts: list[bytes]) -> Item | None:
        """None for a topic that is not received, or that this version does not know."""
        if len(parts) != 2 or parts[0] not in _decoders:
            return None
        topic, decoder = _decoders[parts[0]]
        return (topic, decoder.decode(parts[1])) if topic in self._received else None


class Telemetry(Subscription["zmq.Socket[bytes]"]):
    """Iterate, in a `with`, over (topic, report). No topics: all of them.

    With `timeout_s`, the iteration raises `DaemonGone` after that long without a report; without,
    it waits for ever.
    """

    def __enter__(self) -> Telemetry:
        """Returns when the subscription stands. Raises: DaemonGone if it does not come to."""
        self._joined(self.receive(self._join_s))
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Item]:
        while True:
            item = self.receive(self._timeout_s)
            if item is None:
                raise self._silent()
            yield item

    def receive(self, timeout_s: float | None = 0.0) -> Item | None:
        """The next (topic, report), or None if there is none within `timeout_s` (None: wait).
        Raises: Refused (`bad_message`), for more than a week.
        """
        if (first := self._take_first()) is not None:
            return first
        deadline_ns = deadline(timeout_s)
        while self._socket.poll(left_ms(deadline_ns)):
            item = self._decoded(self._socket.recv_multipart())
            if item is not None:
                return item
        return None


def _subscribe(socket: S, address: str, topics: tuple[Topic, ...]) -> S:
    """`state` comes last: when it arrives, the subscriptions before it stand."""
    socket.setsockopt(zmq.LINGER, 0)
    for topic in (*(topic for topic in topics if topic != "state"), "state"):
        socket.setsockopt(zmq.SUBSCRIBE, topic.encode())
    socket.connect(address)
    return socket


def deadline(timeout_s: float | None) -> int | None:
    """None: never; of nothing, or less: now. Raises: Refused (`bad_message`)."""
    if timeout_s is None:
        return None
    wait_s = 0.0 if timeout_s <= 0 else values.above_zero_s("timeout_s", timeout_s)
    return clock.now_ns() + int(wait_s * 1e9)


def left_ms(deadline_ns: int | None) -> int | None:
    """None: for ever."""
    return None if deadline_ns is None else max(0, (deadline_ns - clock.now_ns()) // 1_000_000)
