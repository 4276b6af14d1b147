"""The numbers of a display's frames, whichever of its threads sends them.

Owns: which number is next, and whether a frame is the next one of what it belongs to. Must not
know: frames, leases, sockets.
"""

from __future__ import annotations

import threading

from etd.protocol.errors import Refused


class FrameNumbers:
    """Under a lease each frame has a higher number than the one before it."""

    def __init__(self) -> None:
        #: Held while a number is taken, and while the lease that it is of is looked at.
        self.lock = threading.Lock()
        self.newest = 0
        #: What goes on by the newest frame; None: nothing, or the program itself.
        self.newest_of: object = None
        #: How often the program has disarmed.
        self.disarms = 0

    def take(self, after: int | None, of: object) -> int:
        """The next number. Raises: Refused (`old_seq`) if the newest frame is not the one `after`
        which this is to be sent.
        """
        if after is not None and self.newest != after:
            raise Refused("old_seq", "the program has sent another frame meanwhile")
        self.newest += 1
        self.newest_of = of
        return self.newest

    def disarm(self) -> None:
        """What goes on by a frame that was sent before is over: the next arming is not for it."""
        with self.lock:
            self.newest += 1
            self.newest_of = None
            self.disarms += 1

    def begin_lease(self) -> None:
        self.newest = 0
