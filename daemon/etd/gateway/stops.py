"""Stops on their way to the engine: one of each user at a time.

Owns: which stop is sent at once, and which waits for the next one of its user. Must not know: what
the engine does with one, sockets, how a reply looks.

A user's stop is sent at once, unless one of the same user is on its way: then it is answered by the
next one, which follows as soon as the engine has answered the first. So a flood of stops fills
neither the link to the engine nor a bound that another user's stop would meet.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Final

from etd.gateway.engine_link import EngineLink
from etd.gateway.inbound import InboundMessage
from etd.gateway.pending import PendingRequest, PendingRequests
from etd.gateway.replies import done
from etd.protocol.errors import Refused
from etd.protocol.link import StopNow
from etd.protocol.messages import Stop
from etd.protocol.who import who

#: Of one user, so many wait for the next one together.
MOST_TOGETHER: Final = 256
#: An engine that runs hears a stop within 20 ms (docs/evidence.md); `etd stop` waits for a second.
ANSWERED_WITHIN_NS: Final = 700_000_000


class _OfUser:
    """`sent` is the ref of the stop on its way, `following` of the one that others wait for."""

    __slots__ = ("client", "following", "sent")

    def __init__(self, sent: int) -> None:
        self.sent = sent
        self.following: int | None = None
        self.client = ""


class Stops:
    def __init__(self, engine: EngineLink, pending: PendingRequests) -> None:
        self._engine = engine
        self._pending = pending
        self._of_user: dict[int, _OfUser] = {}

    def ask(self, stop: Stop, inbound: InboundMessage, now_ns: int) -> None:
        """It is answered later. Raises: Refused (`engine_gone`; `busy`: one is on its way all the
        same).
        """
        client = who(stop.client, inbound.uid)
        of_user = self._of_user.get(inbound.uid)
        if of_user is not None and not self._pending.has(of_user.sent):
            # It was given up; what waits for the next one must not wait for that answer.
            self.answered(of_user.sent)
            of_user = self._of_user.get(inbound.uid)
        if of_user is None:
            ref = self._pending.next_ref()
            self._engine.stop(StopNow(ref=ref, client=client, uid=inbound.uid))
            self._of_user[inbound.uid] = _OfUser(ref)
            self._add(ref, stop, inbound, now_ns)
            return
        waiting = None if of_user.following is None else self._pending.get(of_user.following)
        if waiting is None:
            of_user.following, of_user.client = self._pending.next_ref(), client
            self._add(of_user.following, stop, inbound, now_ns)
        elif len(waiting.others) < MOST_TOGETHER:
            waiting.others.append((inbound, stop.id))
        else:
            raise Refused(
                "busy",
                f"{MOST_TOGETHER} stops of this user wait for their answer: a stop is on its way to"
                " the engine, and another one follows it",
            )

    def answered(self, ref: int) -> None:
        """The engine has answered this ref."""
        for uid, of_user in list(self._of_user.items()):
            if of_user.sent != ref:
                continue
            following = of_user.following
            if following is None or not self._pending.has(following):
                del self._of_user[uid]
                return
            self._of_user[uid] = _OfUser(following)
            # Where the engine is gone, all that is pending is refused when that is noticed.
            with suppress(Refused):
                self._engine.stop(StopNow(ref=following, client=of_user.client, uid=uid))

    def _add(self, ref: int, stop: Stop, inbound: InboundMessage, now_ns: int) -> None:
        deadline_ns = now_ns + ANSWERED_WITHIN_NS * self._engine.timeout_factor
        self._pending.add(ref, PendingRequest(inbound, stop.id, done, deadline_ns, "stop"))
