"""Frames that were read from the link and are not planned yet.

Owns: which of them are planned, and in what order: each that wants an answer, and of the streamed
ones the newest alone, as they came. Must not know: sockets, what a frame asks for, time beyond the
`came_host_ns` that it keeps.
"""

from __future__ import annotations

from collections import deque

import msgspec

from etd.protocol.link import NewFrame

#: The gateway has half as many requests under way at most: no more are read while so many wait.
_MOST_WAITING = 64


class CameFrame(msgspec.Struct, frozen=True):
    """A frame, and the earliest that it may have come, on the machine's clock."""

    message: NewFrame
    came_host_ns: int


class FrameQueue:
    """See the module."""

    def __init__(self) -> None:
        self._waiting: deque[CameFrame] = deque()
        self._newest_streamed: CameFrame | None = None
        self._superseded = 0

    @property
    def is_full(self) -> bool:
        return len(self._waiting) >= _MOST_WAITING

    def put(self, message: NewFrame, came_host_ns: int) -> None:
        """The next one that was read."""
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
        """The next one to be planned."""
        if not self._waiting:
            return None
        came = self._waiting.popleft()
        if came is self._newest_streamed:
            self._newest_streamed = None
        return came

    def take_superseded(self) -> int:
        """How many streamed ones have lost their place to a newer one since this was last asked."""
        found, self._superseded = self._superseded, 0
        return found

    def clear(self) -> None:
        """Their gateway is gone: an answer would reach another one."""
        self._waiting.clear()
        self._newest_streamed = None
