"""Requests that wait for an answer: of the engine, or of the process that reads calibrations.

Owns: refs, their bounds, and how long a request may wait. Must not know: what was requested.

Each kind has places of its own, so that none is refused for another: an account comes when its
frame is over, seconds later, and who says too strong meanwhile must be heard. Of each kind a user
has so many, and all together more than one of them can take; where they are taken, a user of whom
none waits is let in all the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from etd.gateway.inbound import InboundMessage
from etd.protocol.errors import Refused
from etd.protocol.link import MOST_ACCOUNTS, Answer
from etd.protocol.messages import Id, Success

#: Arming may take seconds; after this long an answer is not expected any more.
MAX_WAIT_NS = 15_000_000_000


#: What a request waits for; of stops see `stops.py`.
Kind = Literal["engine", "account", "too_strong", "reading", "stop"]


class _Bound(NamedTuple):
    """`in_all` None: as many as there are users. `refusal`: what waits, and what to do."""

    of_a_user: int
    in_all: int | None
    refusal: str


BOUNDS: Final[dict[Kind, _Bound]] = {
    "engine": _Bound(16, 32, "requests of {} wait for the engine: send again"),
    "account": _Bound(
        24,
        MOST_ACCOUNTS,
        "accounts are waited for by {}: ask again when one of the frames is over",
    ),
    "too_strong": _Bound(
        8,
        None,
        "times 'too_strong' of {} are on their way to the engine: send it again, or send stop",
    ),
    "reading": _Bound(8, None, "requests of {} wait for a calibration: send again"),
}
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

    def next_ref_of(self, uid: int, kind: Kind = "engine") -> int:
        """Raises: Refused (`busy`) if too many of its kind wait already."""
        bound = BOUNDS[kind]
        uids = [it.inbound.uid for it in self._pending.values() if it.kind == kind]
        of_user, in_all = uids.count(uid), len(uids)
        if of_user >= bound.of_a_user:
            raise Refused("busy", f"{of_user} {bound.refusal.format('this user')}")
        if of_user and bound.in_all is not None and in_all >= bound.in_all:
            raise Refused("busy", f"{in_all} {bound.refusal.format('all users')}")
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
