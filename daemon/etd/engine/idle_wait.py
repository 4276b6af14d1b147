"""The wait between two polls, where nothing is due: until its time is over, or a message comes.

Owns: how soon after work a message may end a wait. Must not know: what is due, messages, sockets.

A frame that comes to an idle display is read at once. But a gateway may send without end: after
work for which a message ended a wait, the next wait goes on for a multiple of what that work took,
whatever comes, and for a tick at most.

Where no current can flow (SAFE, HALTED) there is nothing to notice within a millisecond: the engine
of a display that is not in use took a tenth of a core for that.
"""

from __future__ import annotations

from etd.planning.duty import TICK_US
from etd_hal.ports import Wait, WakingClock

TICK_NS = int(TICK_US * 1_000)
#: The same without supply. A gateway that connects, and the end of the process, wait for it.
UNPOWERED_TICK_NS = 5_000_000
#: Work for messages takes a quarter of the processor, unless it takes long: then a tick is slept.
_REST = 3
#: No wait that follows such work is shorter.
_SHORTEST_NS = 50_000


class IdleWait:
    """See the module. `message` waits for the gateway's next message."""

    def __init__(self, clock: WakingClock, message: Wait) -> None:
        self._clock = clock
        self._message = message
        #: When the last wait ended, if a message ended it, or none was listened for.
        self._working_since_ns: int | None = None

    def until_ns(self, deadline_ns: int) -> bool:
        """True if a message has come: the next poll is due before the deadline."""
        clock, since_ns = self._clock, self._working_since_ns
        if since_ns is not None:
            now_ns = clock.now_ns()
            rested_ns = now_ns + min(TICK_NS, max(_SHORTEST_NS, _REST * (now_ns - since_ns)))
            clock.doze_until_ns(min(deadline_ns, rested_ns))
            if rested_ns >= deadline_ns:
                self._working_since_ns = clock.now_ns()
                return False
        clock.doze_until_woken(deadline_ns, self._message)
        now_ns = clock.now_ns()
        is_woken = now_ns < deadline_ns
        self._working_since_ns = now_ns if is_woken else None
        return is_woken
