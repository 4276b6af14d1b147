"""Cuts the outputs off when a message is 1 ms overdue, and when the driving side is silent.

Owns: when to cut, and how often; when the note of the supply is kept and dropped. Must not know:
processes, threads, clocks, SPI, how outputs are cut. The message itself cannot be stopped; its
outputs can be disconnected.

Whether the stopper is alive is measured: it stores the time of each check, and the driving side
judges the age of the last one.

The driving side in turn stores the time of each of its polls. While the supply may be on, it must
do so within the heartbeat's window. Only time in which the stopper itself had the processor counts:
a machine that stood still as a whole was not a silent engine. What was shown on it expires by the
clock, which stands still too while a machine is suspended.
"""

from __future__ import annotations

import errno
from collections.abc import Callable

from etd_hal.cutlatch import (
    ALIVE_NS,
    CAUSE,
    CUTS,
    DUE_NS,
    LOOKED_NS,
    NOTE_ERROR,
    NOTED,
    OVERDUE,
    POWER,
    SEEN,
    SILENT,
    WINDOW_NS,
)
from etd_hal.errors import EtdError
from etd_hal.supply_note import SupplyNote

#: It acts when a message is this much over its plan.
OVERDUE_NS = 1_000_000
#: Its checks are so far apart while the supply is on.
PERIOD_NS = 500_000
#: Of the time between two checks at most so much counts as silence.
COUNTED_NS = 5_000_000


class Stopper:
    """The stopper's side of a cut latch."""

    def __init__(
        self,
        words: memoryview[int],
        now_ns: Callable[[], int],
        cut_off: Callable[[], None],
        note: SupplyNote | None = None,
    ) -> None:
        """`cut_off` makes the outputs safe by one GPIO call; where it raises OSError or EtdError,
        the next check repeats it. Without a `note` nothing outlasts this process.
        """
        self._words = words
        self._now_ns = now_ns
        self._cut_off = cut_off
        self._note = note
        #: Of the last message that was cut, and of the last poll before a silence that was.
        self._cut_due_ns = 0
        self._cut_alive_ns = -1
        #: The last poll that was seen, how long it has been the last, and when that was judged.
        self._alive_ns = 0
        self._silent_ns = 0
        self._judged_ns = 0

    def check(self) -> None:
        """Cut if a message is overdue, or the driving side silent; once more if the last cut has
        not been seen yet.
        """
        words = self._words
        # The time is read first: a message that ends between the two reads is not overdue.
        now_ns = self._now_ns()
        due_ns = words[DUE_NS]
        is_silent = self._is_silent(now_ns)
        if due_ns and due_ns != self._cut_due_ns and now_ns > due_ns + OVERDUE_NS:
            self._cut_due_ns = due_ns
            self._cut_because(OVERDUE)
        elif is_silent:
            self._cut_alive_ns = self._alive_ns
            self._cut_because(SILENT)
        elif words[CUTS] != words[SEEN]:
            self.cut()
        # When it is over, so that a check that hangs leaves no time.
        words[LOOKED_NS] = now_ns
        # Last of all, since it waits for the disk: what is noted, is so without supply.
        self.note_supply()

    def _is_silent(self, now_ns: int) -> bool:
        words = self._words
        alive_ns, since_ns = words[ALIVE_NS], now_ns - self._judged_ns
        self._judged_ns = now_ns
        if alive_ns != self._alive_ns or not words[POWER] & 1:
            self._alive_ns = alive_ns
            self._silent_ns = 0
            return False
        self._silent_ns += since_ns if since_ns < COUNTED_NS else COUNTED_NS
        window_ns = words[WINDOW_NS]
        return 0 < window_ns < self._silent_ns and alive_ns != self._cut_alive_ns

    def _cut_because(self, cause: int) -> None:
        """In this order: see `cutlatch`."""
        words = self._words
        if words[CUTS] == words[SEEN]:
            words[CAUSE] = cause
        words[CUTS] += 1
        self.cut()

    def cut(self) -> None:
        """The call alone: nothing is left to be told to a driving side that has ended."""
        try:
            self._cut_off()
        except (OSError, EtdError):
            # The driving side's own safe_off tries as well, and reports what did not work.
            pass

    def note_supply(self) -> None:
        """Keep the note before the supply goes on, drop it once the board has been made safe. After
        the end of the driving side: drop it, if that was its last word.
        """
        words = self._words
        power = words[POWER]
        if power == words[NOTED]:
            return
        note = self._note
        if note is not None:
            try:
                if power & 1:
                    note.keep()
                    words[NOTE_ERROR] = 0
                else:
                    note.drop()
            except OSError as error:
                words[NOTE_ERROR] = error.errno or errno.EIO
        words[NOTED] = power
