"""What takes several requests with pauses between them: holding a frame, and the opening.

Owns: the order of frames and pauses, and how each ends silent. Must not know: sockets, threads,
whether the caller blocks or awaits.

A course is a generator. It yields a flow of `Session`, and is sent its result, or a `Pause`.
`Display` and `AsyncDisplay` differ only in how they do both. Its time comes from a `Now`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from etd.client import values
from etd.client.opening import Opening
from etd.client.options import renewal_s, silent_fields
from etd.client.session import Flow, Session
from etd.protocol.errors import EtdError, Refused
from etd.protocol.messages import FrameReply

R = TypeVar("R")


class Ended(BaseException):
    """The program has ended a presentation that goes on beside it: an end, not an error."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Nothing is to be sent for so long."""

    seconds: float


#: The daemon's CLOCK_MONOTONIC, in ns.
Now: TypeAlias = Callable[[], int]
Course: TypeAlias = Generator[Flow[Any] | Pause, Any, R]


def holding(
    session: Session, fields: dict[str, object], seconds: float, now_ns: Now
) -> Course[None]:
    """The frame for so long, renewed within its ttl, then silence."""
    held_s = values.above_zero_s("seconds", seconds)
    if fields.get("on_trigger"):
        raise Refused("bad_frame", "on_trigger: use present, which goes on after the edge")
    end_ns, is_shown = now_ns() + int(held_s * 1e9), False
    try:
        while (left_s := (end_ns - now_ns()) / 1e9) > 0:
            yield session.frame({**fields, "sent_ns": now_ns()})
            is_shown = True
            yield Pause(min(renewal_s(fields), left_s))
    except Refused:
        if is_shown:
            yield from falling_silent(session, fields, now_ns)
        raise
    except EtdError:
        raise
    except BaseException:
        yield from falling_silent(session, fields, now_ns)
        raise
    yield session.frame(silent_fields(fields, now_ns()))


def opening(session: Session, course: Opening, now_ns: Now) -> Course[None]:
    """See `Opening`. Raises: Refused (`wrong_state`, `over_limit`); then the skin is silent."""
    try:
        while not course.is_done((yield from _shown(session, course, now_ns)), now_ns()):
            yield Pause(course.renewal_s)
    except BaseException:
        yield from falling_silent(session, course.frame(now_ns()), now_ns)
        raise
    yield session.frame(course.silence(now_ns()))


def _shown(session: Session, course: Opening, now_ns: Now) -> Course[FrameReply]:
    """A frame that came too late on a busy machine is sent again."""
    while True:
        try:
            reply: FrameReply = yield session.frame(course.frame(now_ns()))
        except Refused as refusal:
            if refusal.code != "expired" or course.is_overdue(now_ns()):
                raise
        else:
            return reply


def falling_silent(session: Session, fields: dict[str, object], now_ns: Now) -> Course[None]:
    """Where a course is cut short: as far as the daemon answers. The end of its lease has silenced
    it: no other is opened for it.
    """
    if session.lease is not None:
        with contextlib.suppress(EtdError):  # the frame expires by itself
            yield session.frame(silent_fields(fields, now_ns()), lease=session.lease)
