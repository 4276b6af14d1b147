"""Requests that wait for the engine's answer.

Owns: refs, their bound, and how long a request may wait. Must not know: what was requested.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from etd.gateway.inbound import InboundMessage
from etd.protocol.errors import Refused
from etd.protocol.link import Answer
from etd.protocol.messages import Id, Success

#: More than these under way are refused.
MAX_REQUESTS = 32
#: Stops have places of their own, so that they are answered when everything else is full.
MAX_STOPS = 32
#: Arming may take seconds; an engine that says nothing for this long does not answer at all.
MAX_WAIT_NS = 15_000_000_000


@dataclass(frozen=True, slots=True)
class PendingRequest:
    """`done` makes the reply out of an answer without an error."""

    inbound: InboundMessage
    id: Id | None
    done: Callable[[Answer], Success]
    deadline_ns: int
    is_stop: bool = False


class PendingRequests:
    """Numbered from 1; 0 would ask the engine for no answer."""

    def __init__(self) -> None:
        self._pending: dict[int, PendingRequest] = {}
        self._last_ref = 0

    def next_ref(self, is_stop: bool = False) -> int:
        """A ref to send along. Raises: Refused (`busy`) if too many wait already."""
        same = sum(request.is_stop == is_stop for request in self._pending.values())
        if same >= (MAX_STOPS if is_stop else MAX_REQUESTS):
            raise Refused("busy", f"{same} requests wait for the engine already: send again")
        self._last_ref += 1
        return self._last_ref

    def add(self, ref: int, pending: PendingRequest) -> None:
        """Once the command with this ref is on its way."""
        self._pending[ref] = pending

    def take(self, ref: int) -> PendingRequest | None:
        """The client that waits for this, or None if it waits no more."""
        return self._pending.pop(ref, None)

    def take_all(self) -> list[PendingRequest]:
        """Everybody: the engine is gone."""
        everybody = list(self._pending.values())
        self._pending.clear()
        return everybody

    def take_late(self, now_ns: int) -> list[PendingRequest]:
        """Those whose time is up."""
        late = [ref for ref, request in self._pending.items() if request.deadline_ns <= now_ns]
        return [self._pending.pop(ref) for ref in late]
