"""Makes the board safe through GPIO when a message is 1 ms overdue.

Owns: the watch over the scan thread's message, the one GPIO call, and whether that watch is kept.
Must not know: states, frames, SPI. The message itself cannot be stopped; its outputs can be
disconnected.

Whether the stopper is alive is measured: it stores the time of each check, and the scan thread
judges the age of the last one.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from etd.protocol.errors import EtdError
from etd_hal.board import OVERDUE_NS, Board
from etd_hal.ports import Clock

_PERIOD_S = 0.0005
#: A stopper without a check for so long has ended or hangs: it normally checks a thousand times in
#: this. A scan may go on that long without it; a busy machine can keep a thread from its processor
#: for tenths of a second, and that is no fault of the board.
SILENT_NS = 500_000_000
#: Of the time between two calls of `judge`, which come every few milliseconds, at most so much
#: counts: while the whole process was stopped, the stopper was not silent.
_COUNTED_NS = 10_000_000


class Stopper:
    """A check of the scan thread's message; `StopperThread` repeats it."""

    def __init__(self, board: Board, clock: Clock) -> None:
        self._board = board
        self._clock = clock
        #: Set once it has acted; the scan thread halts when it sees it.
        self.has_acted = False
        #: When its last check began; set when that check is over, so that a check that hangs leaves
        #: no time.
        self.looked_ns = 0

    def check(self) -> None:
        """Act if a message is overdue. Any thread may call it."""
        # The time is read first: a message that ends between the two reads is not overdue.
        now_ns = self._clock.now_ns()
        due_ns = self._board.cut.message_due_ns
        if due_ns and not self.has_acted and now_ns > due_ns + OVERDUE_NS:
            self.has_acted = True
            try:
                self._board.cut_off()
            except EtdError:
                # The scan thread's own safe_off tries again and reports what did not work.
                pass
        self.looked_ns = now_ns


class StopperLiveness:
    """The time without a check of the stopper, as the scan thread judges it at each poll."""

    def __init__(self, stopper: Stopper) -> None:
        self._stopper = stopper
        self._begun_ns = 0
        self._looked_ns = 0
        self._judged_ns = 0
        #: As judged last.
        self.silent_ns = 0

    def begin(self, now_ns: int) -> None:
        """The stopper has just been woken: an earlier check is no sign of life."""
        self._begun_ns = self._judged_ns = now_ns
        self.silent_ns = 0

    @property
    def has_looked(self) -> bool:
        """Whether the stopper has checked since `begin`."""
        return self._stopper.looked_ns >= self._begun_ns

    def judge(self, now_ns: int) -> bool:
        """Called at each poll of the scan thread. True: the stopper was silent for too long."""
        looked_ns, since_ns = self._stopper.looked_ns, now_ns - self._judged_ns
        self._judged_ns = now_ns
        if looked_ns != self._looked_ns:
            self._looked_ns = looked_ns
            self.silent_ns = 0
            return False
        self.silent_ns += since_ns if since_ns < _COUNTED_NS else _COUNTED_NS
        return self.silent_ns > SILENT_NS

    @property
    def problem(self) -> str | None:
        """What is wrong with a stopper that has stopped checking; None while it checks."""
        if self.silent_ns <= SILENT_NS:
            return None
        return (
            f"the stopper made no check for {self.silent_ns // 1_000_000} ms, its thread has ended"
            " or hangs: restart the daemon"
        )


class StopperThread(threading.Thread):
    """Checks twice a millisecond while the supply is on, else waits."""

    def __init__(self, stopper: Stopper, prepare: Callable[[], object] = lambda: None) -> None:
        """`prepare` is called in the thread first, to give it a higher priority than the thread it
        watches.
        """
        super().__init__(name="etd-stopper", daemon=True)
        self._stopper = stopper
        self._prepare = prepare
        self._awake = threading.Event()
        self._pause = threading.Event()
        self._is_ending = False

    def watch(self, is_needed: bool) -> None:
        """Supply on or off."""
        if is_needed:
            self._awake.set()
        else:
            self._awake.clear()

    def run(self) -> None:
        self._prepare()
        while not self._is_ending:
            self._awake.wait()
            self._stopper.check()
            self._pause.wait(_PERIOD_S)

    def end(self) -> None:
        """Idempotent."""
        self._is_ending = True
        self._pause.set()
        self._awake.set()
        self.join(timeout=2.0)
