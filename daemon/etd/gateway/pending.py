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
#: Stops are counted separately, so that they are answered while other requests are refused.
MAX_STOPS = 32
#: Arming may take seconds; after this long an answer is not expected any more.
MAX_WAIT_NS = 15_000_000_000


#: What makes a reply of an answer: or else the ref of another one to wait for, and what makes it of
#: that.
Done = Callable[[Answer], "Success | tuple[int, Done]"]


@dataclass(frozen=True, slots=True)
class PendingRequest:
    """`done` makes the reply from an answer without an error."""

    inbound: InboundMessage
    id: Id | None
    done: Done
    deadline_ns: int
    is_stop: bool = False


class PendingRequests:
    """Numbered from 1; the engine does not answer ref 0."""

    def __init__(self) -> None:
        self._pending: dict[int, PendingRequest] = {}
        self._last_ref = 0

    def next_ref(self, is_stop: bool = False) -> int:
        """A ref to send along. Raises: Refused (`busy`) if too many wait already."""
        same = sum(request.is_stop == is_stop for request in self._pending.values())
        if same >= (MAX_STOPS if is_stop else MAX_REQUESTS):
            raise Refused("busy", f"{same} requests are waiting for the engine: send again")
        self._last_ref += 1
        return self._last_ref

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
