"""The flags shared by the thread that drives a board and the stopper beside it.

Owns: the time by which the message under way must have returned, and the mark that the outputs were
cut off. Must not know: ports, clocks, threads, how the stopper works.

Each side writes its own mark and reads the other's; both are plain values, without a lock, because
neither side may wait for the other. The order of the writes is what makes that safe:

- The stopper sets `is_cut` *first*, and then makes the outputs safe. A cut whose GPIO call is still
  to come is known already.
- The driving thread reads `is_cut` before each of its GPIO calls and before each message, and once
  more *after* each GPIO call: a cut may come between the first reading and the call, and the call
  then switches on again what was cut. It is undone at once, before anything is fired.

So one of two things always happens: the driving thread sees the mark, and does nothing or undoes
its call; or its call came before the mark, and the stopper's own call, which comes after, undoes
it. Between such a call and its undoing the DAC is at zero: before a message the mark is read again.
"""

from __future__ import annotations

from etd_hal.errors import BoardFault


class CutLatch:
    """See the module. One per board, held by the board and by its stopper."""

    __slots__ = ("is_cut", "message_due_ns")

    def __init__(self) -> None:
        #: Set by the stopper; only a completed `Board.safe_off` resets it.
        self.is_cut = False
        #: When the message under way must have returned, 0 when there is none. Set directly before
        #: the port's transfer and reset directly after, so that no other work of the thread counts.
        self.message_due_ns = 0

    def check(self) -> None:
        """Raises: BoardFault while a cut stands."""
        if self.is_cut:
            raise BoardFault(
                "outputs",
                "cut off by the stopper, because a message was overdue",
                "a board that was made safe since",
            )
