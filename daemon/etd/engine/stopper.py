"""Makes the board safe through GPIO when a message is 1 ms overdue.

Owns: the watch over the scan thread's message, and the one GPIO call. Must not know: states,
frames, SPI. The message itself cannot be stopped; its outputs can be disconnected.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from etd.errors import EtdError
from etd_hal.board import OVERDUE_NS, Board
from etd_hal.ports import Clock

_PERIOD_S = 0.0005


class Stopper:
    """One look at the scan thread's message; a thread of its own looks all the time."""

    def __init__(self, board: Board, clock: Clock) -> None:
        self._board = board
        self._clock = clock
        #: Set once it has acted; the scan thread halts when it sees it.
        self.has_acted = False

    def look(self) -> None:
        """Act if a message is overdue. Any thread may call it."""
        due_ns = self._board.cut.message_due_ns
        if due_ns and not self.has_acted and self._clock.now_ns() > due_ns + OVERDUE_NS:
            self.has_acted = True
            try:
                self._board.cut_off()
            except EtdError:
                # The scan thread's own safe_off tries again and reports what did not work.
                return


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
            self._stopper.look()
            self._pause.wait(_PERIOD_S)

    def end(self) -> None:
        """Idempotent."""
        self._is_ending = True
        self._pause.set()
        self._awake.set()
        self.join(timeout=2.0)
