"""Makes the board safe through GPIO when a message is 1 ms overdue.

Owns: the watch over the scan thread's message, the one GPIO call, and whether that watch is kept.
Must not know: states, frames, SPI. The message itself cannot be stopped; its outputs can be
disconnected.

Whether the stopper is alive is measured: it leaves the time of each look, and the scan thread
judges how old that is.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from etd.protocol.errors import EtdError
from etd_hal.board import OVERDUE_NS, Board
from etd_hal.ports import Clock

_PERIOD_S = 0.0005
#: A stopper that has not looked for so long has ended or hangs: it looks a thousand times in this.
#: For as long the scan may go on without it; a busy machine keeps a thread from its processor for
#: tenths of a second, and that is no fault of the board.
SILENT_NS = 500_000_000
#: Of the time between two looks of the scan thread, which come every few milliseconds, so much
#: counts: where the whole process was stopped, the stopper has not been silent.
_COUNTED_NS = 10_000_000


class Stopper:
    """One look at the scan thread's message; a thread of its own looks all the time."""

    def __init__(self, board: Board, clock: Clock) -> None:
        self._board = board
        self._clock = clock
        #: Set once it has acted; the scan thread halts when it sees it.
        self.has_acted = False
        #: When its last look began; set when that look is over, so that one that hangs leaves none.
        self.looked_ns = 0

    def check(self) -> None:
        """Act if a message is overdue. Any thread may call it."""
        # The time is read first: a message that ends between the two readings is not overdue.
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
    """For how long the stopper has not looked, as the scan thread judges it at its own looks."""

    def __init__(self, stopper: Stopper) -> None:
        self._stopper = stopper
        self._begun_ns = 0
        self._looked_ns = 0
        self._judged_ns = 0
        #: As it was when it was judged last.
        self.silent_ns = 0

    def begin(self, now_ns: int) -> None:
        """The stopper has just been woken: what it did before is no sign of life."""
        self._begun_ns = self._judged_ns = now_ns
        self.silent_ns = 0

    @property
    def has_looked(self) -> bool:
        """Since `begin`."""
        return self._stopper.looked_ns >= self._begun_ns

    def judge(self, now_ns: int) -> bool:
        """At each look of the scan thread. True: it has been silent for too long."""
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
        """What to say of a stopper that does not look any more; None while it does."""
        if self.silent_ns <= SILENT_NS:
            return None
        return (
            f"the stopper has not looked for {self.silent_ns // 1_000_000} ms, its thread has ended"
            " or hangs: restart the daemon"
        )


class StopperThread(threading.Thread):
    """Looks twice a millisecond while the supply is on, else waits."""

    def __init__(self, stopper: Stopper, prepare: Callable[[], object] = lambda: None) -> None:
        """`prepare` is called in the thread first: it must be more urgent than what it watches."""
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
