"""The timing calibration, at the engine's start and while it runs, repeated on a busy machine.

Owns: how many attempts there are, and the pause between them. Must not know: which timing is
plausible (`etd_hal.timing`), when messages have drifted.

An engine that was killed restarts beside the load that killed it, and a disturbed calibration would
end it for good: the unit does not restart after a failed check. So there are a few attempts, each
judged like the first, each reported. A real fault fails every time. While the engine runs, nothing
is fired until an attempt has succeeded, and all else goes on in the pauses.

Clocks that follow the load of the machine change the timing and change it back. A timing that held
before is recognized, which takes a millisecond.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from etd_hal.board import Board
from etd_hal.errors import BoardFault
from etd_hal.ports import Clock

ATTEMPTS = 3
_UNSTEADY = (
    "the clocks of this machine change while it runs, so that pulses are up to a fifth wider or"
    " narrower until that is noticed: fix them (force_turbo, or the performance governor)"
)
#: Longer than the load of a starting machine lasts at a stretch; systemd waits 30 s for all
#: attempts.
_PAUSE_NS = 1_000_000_000


def calibrate_at_start(
    board: Board, clock: Clock, tell: Callable[[str], object]
) -> tuple[str, ...]:
    """Returns a sentence for each attempt that failed before one succeeded; `tell` gets it at once.

    Raises: BoardFault of the last attempt; BusError at once.
    """
    failed: list[str] = []
    while True:
        try:
            board.calibrate()
        except BoardFault as fault:
            failed.append(f"attempt {len(failed) + 1} of {ATTEMPTS}: {fault}")
            tell(failed[-1])
            if len(failed) == ATTEMPTS:
                raise
            clock.doze_until_ns(clock.now_ns() + _PAUSE_NS)
        else:
            return tuple(failed)


def limitations(counters: Counter[str]) -> tuple[str, ...]:
    """What is to be told while it lasts."""
    return (_UNSTEADY,) if counters["clock_steps"] else ()


class Retiming:
    """The timing of a running engine, whose messages have drifted from it."""

    def __init__(self, board: Board, counters: Counter[str], meanwhile: Callable[[], None]) -> None:
        """`meanwhile` is called before each message that is timed."""
        self._board = board
        self._counters = counters
        self._meanwhile = meanwhile
        self._failed = 0
        #: No attempt before.
        self.not_before_ns = 0

    def attempt(self, now_ns: int) -> bool:
        """True: a timing holds again. False: the calibration failed, and is due again after the
        pause. Raises: BoardFault of the last attempt; BusError at once.
        """
        before = self._board.timing
        if self._board.recognize_timing(self._meanwhile):
            if self._board.timing is not before:
                self._counters["clock_steps"] += 1
            self._failed = 0
            return True
        try:
            self._board.calibrate(self._meanwhile)
        except BoardFault:
            self._failed += 1
            self._counters["calibration_attempts_failed"] += 1
            if self._failed == ATTEMPTS:
                # Who clears the halt has as many again.
                self._failed = 0
                raise
            self.not_before_ns = now_ns + _PAUSE_NS
            return False
        self._failed = 0
        self._counters["recalibrated"] += 1
        return True
