"""Frames read from the link and not planned yet.

Owns: which of them are planned, and in what order: every frame that wants an answer, and only the
newest streamed frame, in the order of arrival. Must not know: sockets, what a frame asks for, time
beyond the `came_host_ns` that it keeps.
"""

from __future__ import annotations

from collections import deque

import msgspec

from etd.protocol.link import NewFrame

#: No more frames are read while so many wait; the gateway has at most half as many requests under
#: way.
_MOST_WAITING = 64


class CameFrame(msgspec.Struct, frozen=True):
    """A frame, and the earliest time at which it may have come, on the machine's clock."""

    message: NewFrame
    came_host_ns: int


class FrameQueue:
    def __init__(self) -> None:
        self._waiting: deque[CameFrame] = deque()
        self._newest_streamed: CameFrame | None = None
        self._superseded = 0

    @property
    def is_full(self) -> bool:
        return len(self._waiting) >= _MOST_WAITING

    def put(self, message: NewFrame, came_host_ns: int) -> None:
        """Appends the next frame that was read."""
        came = CameFrame(message, came_host_ns)
        if not message.ref:
            before = self._newest_streamed
            if before is not None:
                self._superseded += 1
                if message.frame.seq <= before.message.frame.seq:
                    return
                self._waiting = deque(
                    came_frame for came_frame in self._waiting if came_frame is not before
                )
            self._newest_streamed = came
        self._waiting.append(came)

    def next(self) -> CameFrame | None:
        """Removes and returns the next frame to plan."""
        if not self._waiting:
            return None
        came = self._waiting.popleft()
        if came is self._newest_streamed:
            self._newest_streamed = None
        return came

    def take_superseded(self) -> int:
        """How many streamed frames a newer one has replaced since the last call."""
        found, self._superseded = self._superseded, 0
        return found

    def clear(self) -> None:
        """Their gateway is gone: an answer would reach another gateway."""
        self._waiting.clear()
        self._newest_streamed = None
