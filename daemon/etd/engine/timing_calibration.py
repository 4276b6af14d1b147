"""The timing calibration of an engine that starts, and again if the machine was busy just then.

Owns: how often it is tried. Must not know: what is plausible (`etd_hal.timing`).

An engine that was killed comes up again beside whatever killed it, and a calibration that is
disturbed ends it for good: the unit does not restart after a check that said no. So a few attempts,
each judged like the first, each told. What is really wrong fails every time.
"""

from __future__ import annotations

from collections.abc import Callable

from etd_hal.board import Board
from etd_hal.errors import BoardFault
from etd_hal.ports import Clock

ATTEMPTS = 3
#: Longer than what starts beside it takes at a stretch; systemd waits 30 s for all of them.
_PAUSE_NS = 1_000_000_000


def calibrate_at_start(
    board: Board, clock: Clock, tell: Callable[[str], object]
) -> tuple[str, ...]:
    """A sentence for each attempt that failed before one did not; `on_rejected` hears it at once.

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
