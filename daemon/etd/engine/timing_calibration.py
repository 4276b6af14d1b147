"""The timing calibration at the engine's start, repeated if the machine was busy.

Owns: how many attempts there are. Must not know: which timing is plausible (`etd_hal.timing`).

An engine that was killed restarts beside the load that killed it, and a disturbed calibration would
end it for good: the unit does not restart after a failed check. So there are a few attempts, each
judged like the first, each reported. A real fault fails every time.
"""

from __future__ import annotations

from collections.abc import Callable

from etd_hal.board import Board
from etd_hal.errors import BoardFault
from etd_hal.ports import Clock

ATTEMPTS = 3
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
