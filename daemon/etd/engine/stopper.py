"""Whether the stopper is alive, and whether it has acted; and the stopper as a thread.

Owns: the judgement of its last check, as the scan thread makes it at each poll. Must not know:
states, frames, when a message is overdue (`etd_hal.stopper`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from etd_hal.cutlatch import CUTS, LOOKED_NS, CutLatch
from etd_hal.stopper import PERIOD_NS, Stopper

#: A stopper without a check for so long has ended or hangs: it normally checks a thousand times in
#: this. A scan may go on that long without it; a busy machine can keep a process from its processor
#: for tenths of a second, and that is no fault of the board.
SILENT_NS = 500_000_000
#: Of the time between two calls of `judge`, which come every few milliseconds, at most so much
#: counts: while everything was stopped, the stopper was not silent.
_COUNTED_NS = 10_000_000
#: A thread that has begun says so within this time.
_BEGUN_WITHIN_S = 2.0


class StopperLiveness:
    """The time without a check of the stopper, and its cuts, as the scan thread sees them."""

    def __init__(self, latch: CutLatch) -> None:
        self._words = latch.words
        #: So many cuts have led to a halt that was cleared.
        self._cleared = 0
        self._begun_ns = 0
        self._looked_ns = 0
        self._judged_ns = 0
        #: As judged last.
        self.silent_ns = 0

    @property
    def has_acted(self) -> bool:
        """Since the last `clear`: it has cut the outputs off."""
        return self._words[CUTS] != self._cleared

    def clear(self) -> None:
        """The halt that its cuts led to was cleared."""
        self._cleared = self._words[CUTS]

    def begin(self, now_ns: int) -> None:
        """The stopper has just been woken: an earlier check is no sign of life."""
        self._begun_ns = self._judged_ns = now_ns
        self.silent_ns = 0

    @property
    def has_looked(self) -> bool:
        """Whether the stopper has checked since `begin`."""
        return self._words[LOOKED_NS] >= self._begun_ns

    def judge(self, now_ns: int) -> bool:
        """Called at each poll of the scan thread. True: the stopper was silent for too long, or has
        acted.
        """
        looked_ns, since_ns = self._words[LOOKED_NS], now_ns - self._judged_ns
        self._judged_ns = now_ns
        if looked_ns != self._looked_ns:
            self._looked_ns = looked_ns
            self.silent_ns = 0
        else:
            self.silent_ns += since_ns if since_ns < _COUNTED_NS else _COUNTED_NS
        return self.silent_ns > SILENT_NS or self._words[CUTS] != self._cleared

    @property
    def problem(self) -> str | None:
        """What is wrong with a stopper that has stopped checking; None while it checks."""
        if self.silent_ns <= SILENT_NS:
            return None
        return (
            f"the stopper made no check for {self.silent_ns // 1_000_000} ms, it has ended or"
            " hangs: restart the daemon"
        )


class StopperThread(threading.Thread):
    """The stopper of a board whose ports are in this process: a fake one's. Checks twice a
    millisecond while the supply is on, else waits.
    """

    def __init__(self, stopper: Stopper, prepare: Callable[[], str | None] = lambda: None) -> None:
        """`prepare` is called in the thread first, to give it a higher priority than the thread it
        watches; it returns a sentence if that was not granted.
        """
        super().__init__(name="etd-stopper", daemon=True)
        self._stopper = stopper
        self._prepare = prepare
        self._refusal: str | None = None
        self._has_begun = threading.Event()
        self._awake = threading.Event()
        self._pause = threading.Event()
        self._is_ending = False

    @property
    def refusals(self) -> tuple[str, ...]:
        """What was not granted, a sentence each."""
        self._has_begun.wait(_BEGUN_WITHIN_S)
        return () if self._refusal is None else (self._refusal,)

    def watch(self, is_needed: bool) -> None:
        if is_needed:
            self._awake.set()
        else:
            self._awake.clear()

    def run(self) -> None:
        self._refusal = self._prepare()
        self._has_begun.set()
        while not self._is_ending:
            self._awake.wait()
            self._stopper.check()
            self._pause.wait(PERIOD_NS / 1e9)

    def end(self) -> None:
        """Idempotent."""
        self._is_ending = True
        self._pause.set()
        self._awake.set()
        self.join(timeout=2.0)
