"""The words shared by the process that drives a board and the stopper beside it.

Owns: the time by which the message under way must have returned, the driving side's sign of life,
the count of cuts and why, and what is known of the supply. Must not know: ports, clocks, processes,
how the stopper works.

Each word is written by one side alone and read by the other, without a lock, because neither side
may wait for the other. The order of the writes is what makes that safe:

- The stopper counts a cut *first*, and then makes the outputs safe. A cut whose GPIO call is still
  to come is known already. It repeats the call until the driving side has seen the cut.
- The driving side looks at the count before each of its GPIO calls and before each message, and
  once more *after* each GPIO call: a cut may come between the first look and the call, and the call
  then switches on again what was cut. It is undone at once, before anything is fired.

So one of two things always happens: the driving side sees the cut, and does nothing or undoes
its call; or its call came before the count, and the stopper's own call, which comes after, undoes
it. Between such a call and its undoing the DAC is at zero: before a message the count is read
again. That both sides see the two in this order is the kernel's doing: docs/decisions/0047.
"""

from __future__ import annotations

from etd_hal.errors import BoardFault
from etd_hal.shared_memory import WORD_BYTES, SharedMemory

#: By the driving side: when the message under way must have returned, 0 when there is none (set
#: directly before the port's transfer and reset directly after, so that no other work counts); and
#: how many cuts it has seen.
DUE_NS, SEEN = 0, 1
#: By the stopper: how many cuts it has made, and when its last check began.
CUTS, LOOKED_NS = 2, 3
#: By the driving side: when it last polled; for how long it may be silent while the supply is on
#: (0: it is not judged); and how often the supply was switched or a halt was cleared: odd while the
#: supply may be on.
ALIVE_NS, WINDOW_NS, POWER = 4, 5, 6
#: By the stopper: why the first cut that was not seen was made; which POWER is on the disk, and the
#: error number of the last note that could not be kept.
CAUSE, NOTED, NOTE_ERROR = 7, 8, 9
SIZE = 10 * WORD_BYTES
#: What CAUSE says.
OVERDUE, SILENT = 1, 2
_WHY = {
    OVERDUE: "because a message was overdue",
    SILENT: "because the engine was silent for longer than the heartbeat's window",
}


class CutLatch:
    """The driving side's view; the stopper's is in `stopper.py`. One per board."""

    __slots__ = ("ended", "memory", "words")

    def __init__(self) -> None:
        self.memory = SharedMemory(SIZE)
        self.words = self.memory.words
        #: So many cuts are over, because the board was made safe after them.
        self.ended = 0

    @property
    def is_cut(self) -> bool:
        """Whether a cut stands: only a completed `Board.safe_off` ends it."""
        return self.words[CUTS] != self.ended

    def expect(self, due_ns: int) -> None:
        """The stopper is told of a message that is due then; 0: of none. Each message tells it by
        itself: this is for trying the stopper out.
        """
        self.words[DUE_NS] = due_ns

    def see(self) -> int:
        """From now on no call switches on what was cut; the stopper need not repeat its call.
        Returns how many cuts there were.
        """
        cuts = self.words[SEEN] = self.words[CUTS]
        return cuts

    @property
    def why(self) -> str:
        """Why the first cut was made that had not been seen, as a clause."""
        return _WHY.get(self.words[CAUSE], "for no reason that is known")

    def check(self) -> None:
        """Raises: BoardFault while a cut stands."""
        if self.is_cut:
            self.see()
            raise BoardFault(
                "outputs",
                f"cut off by the stopper, {self.why}",
                "a board that was made safe since",
            )
