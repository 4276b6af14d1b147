"""Requests that wait for an answer: of the engine, or of the process that reads calibrations.

Owns: refs, their bounds, and how long a request may wait. Must not know: what was requested.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from etd.gateway.inbound import InboundMessage
from etd.protocol.errors import Refused
from etd.protocol.link import Answer
from etd.protocol.messages import Id, Success

#: More than these under way at the engine are refused; stops have a bound of their own.
MAX_REQUESTS = 32
#: Of a user, so many that wait for a calibration to be read.
MAX_READS_OF_A_USER = 8
#: Arming may take seconds; after this long an answer is not expected any more.
MAX_WAIT_NS = 15_000_000_000


#: What a request waits for.
Kind = Literal["engine", "reading", "stop"]
#: What makes a reply of an answer, or else names another one to wait for.
Done = Callable[[Answer], "Success | Awaited"]


class Awaited(NamedTuple):
    """The ref of an answer, and what makes a reply of it."""

    ref: int
    done: Done
    kind: Kind = "engine"


@dataclass(frozen=True, slots=True)
class PendingRequest:
    """`done` makes the reply from an answer without an error. `others`: who has the same reply."""

    inbound: InboundMessage
    id: Id | None
    done: Done
    deadline_ns: int
    kind: Kind = "engine"
    others: list[tuple[InboundMessage, Id | None]] = field(default_factory=list)

    @property
    def all_of_them(self) -> tuple[tuple[InboundMessage, Id | None], ...]:
        return (self.inbound, self.id), *self.others


class PendingRequests:
    """Numbered from 1; the engine does not answer ref 0."""

    def __init__(self) -> None:
        self._pending: dict[int, PendingRequest] = {}
        self._last_ref = 0

    def next_ref(self) -> int:
        """A ref to send along, of what has a bound of its own."""
        self._last_ref += 1
        return self._last_ref

    def next_engine_ref(self) -> int:
        """Raises: Refused (`busy`) if too many wait for the engine already."""
        count = sum(request.kind == "engine" for request in self._pending.values())
        if count >= MAX_REQUESTS:
            raise Refused("busy", f"{count} requests are waiting for the engine: send again")
        return self.next_ref()

    def next_reading_ref(self, uid: int) -> int:
        """Raises: Refused (`busy`) if too many of this user wait for a calibration already."""
        count = sum(
            request.kind == "reading" and request.inbound.uid == uid
            for request in self._pending.values()
        )
        if count >= MAX_READS_OF_A_USER:
            raise Refused(
                "busy", f"{count} requests of this user wait for a calibration: send again"
            )
        return self.next_ref()

    def get(self, ref: int) -> PendingRequest | None:
        return self._pending.get(ref)

    def has(self, ref: int) -> bool:
        return ref in self._pending

    def add(self, ref: int, pending: PendingRequest) -> None:
        """Call after the command with this ref has been sent."""
        self._pending[ref] = pending

    def take(self, ref: int) -> PendingRequest | None:
        """The request with this ref, or None if it is not pending any more."""
        return self._pending.pop(ref, None)

    def take_all(self) -> list[PendingRequest]:
        """All of them: the engine is gone."""
        requests = list(self._pending.values())
        self._pending.clear()
        return requests

    def take_late(self, now_ns: int) -> list[PendingRequest]:
        """Those past their deadline."""
        late = [ref for ref, request in self._pending.items() if request.deadline_ns <= now_ns]
        return [self._pending.pop(ref) for ref in late]
