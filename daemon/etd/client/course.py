"""What takes several requests with pauses between them: holding a frame, and the opening.

Owns: the order of frames and pauses, and how each ends silent. Must not know: sockets, threads,
whether the caller blocks or awaits.

A course is a generator. It yields a flow of `Session`, and is sent its result, or a `Pause`.
`Display` and `AsyncDisplay` differ only in how they do both. Its time comes from a `Now`.
"""

from __future__ import annotations

import contextlib
from asyncio import CancelledError
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, TypeVar

from etd.client import values
from etd.client.opening import Opening
from etd.client.options import FrameOptions, renewal_s, silent_fields
from etd.client.session import Flow, Session
from etd.protocol.errors import EtdError

R = TypeVar("R")

#: What cuts a course short, which then ends silent.
CUT_SHORT: Final = (KeyboardInterrupt, CancelledError)


@dataclass(frozen=True, slots=True)
class Pause:
    """Nothing is to be sent for so long."""

    seconds: float


#: The daemon's CLOCK_MONOTONIC, in ns.
Now: TypeAlias = Callable[[], int]
Course: TypeAlias = Generator[Flow[Any] | Pause, Any, R]


def holding(
    session: Session,
    fields: dict[str, object],
    options: FrameOptions,
    seconds: float,
    now_ns: Now,
) -> Course[None]:
    """The frame for so long, renewed within its ttl, then silence."""
    held_s = values.above_zero_s("seconds", seconds)
    end_ns = now_ns() + int(held_s * 1e9)
    try:
        while (left_s := (end_ns - now_ns()) / 1e9) > 0:
            yield session.frame({**fields, "sent_ns": now_ns()})
            yield Pause(min(renewal_s(options), left_s))
    except CUT_SHORT:
        yield from falling_silent(session, fields, now_ns)
        raise
    yield session.frame(silent_fields(fields, now_ns()))


def opening(
    session: Session, levels: values.Numbers | float, electrodes: int, now_ns: Now
) -> Course[None]:
    """See `Opening`. Raises: Refused (`wrong_state`)."""
    course = Opening(levels, electrodes, now_ns())
    while not course.is_done((yield session.frame(course.frame(now_ns()))), now_ns()):
        yield Pause(course.renewal_s)
    yield session.frame(course.silence(now_ns()))


def falling_silent(session: Session, fields: dict[str, object], now_ns: Now) -> Course[None]:
    """Where a course is cut short: as far as the daemon answers."""
    with contextlib.suppress(EtdError):  # the frame expires by itself
        yield session.frame(silent_fields(fields, now_ns()))
