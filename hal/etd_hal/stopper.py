"""Cuts the outputs off when a message is 1 ms overdue.

Owns: when to cut, and how often. Must not know: processes, threads, clocks, SPI, how outputs are
cut. The message itself cannot be stopped; its outputs can be disconnected.

Whether the stopper is alive is measured: it stores the time of each check, and the driving side
judges the age of the last one.
"""

from __future__ import annotations

from collections.abc import Callable

from etd_hal.cutlatch import CUTS, DUE_NS, LOOKED_NS, SEEN
from etd_hal.errors import EtdError

#: It acts when a message is this much over its plan.
OVERDUE_NS = 1_000_000
#: Its checks are so far apart while the supply is on.
PERIOD_NS = 500_000


class Stopper:
    """The stopper's side of a cut latch."""

    def __init__(
        self, words: memoryview[int], now_ns: Callable[[], int], cut_off: Callable[[], None]
    ) -> None:
        """`cut_off` makes the outputs safe by one GPIO call; where it raises OSError or EtdError,
        the next check repeats it.
        """
        self._words = words
        self._now_ns = now_ns
        self._cut_off = cut_off
        #: Of the last message that was cut.
        self._cut_due_ns = 0

    def check(self) -> None:
        """Cut if a message is overdue; once more if the last cut has not been seen yet."""
        words = self._words
        # The time is read first: a message that ends between the two reads is not overdue.
        now_ns = self._now_ns()
        due_ns = words[DUE_NS]
        if due_ns and due_ns != self._cut_due_ns and now_ns > due_ns + OVERDUE_NS:
            self._cut_due_ns = due_ns
            # In this order: see `cutlatch`.
            words[CUTS] += 1
            self.cut()
        elif words[CUTS] != words[SEEN]:
            self.cut()
        # When it is over, so that a check that hangs leaves no time.
        words[LOOKED_NS] = now_ns

    def cut(self) -> None:
        """The call alone: nothing is left to be told to a driving side that has ended."""
        try:
            self._cut_off()
        except (OSError, EtdError):
            # The driving side's own safe_off tries as well, and reports what did not work.
            pass
