"""Outputs and supply: that they go off, and that the stopper knows when they may be on.

Owns: what of the last attempt to make the board safe did not work, and that it is repeated until it
does; whether the stopper is awake, and its note of the supply. Must not know: states, leases, why
the board is made safe.

One call that fails leaves the supply on where nothing else switches it off. So the board is not
given up: it is tried again between two polls, and until it has worked the stopper stays awake, and
the note stands, by which a crash in between would be known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from etd.engine.stopper import StopperLiveness
from etd_hal.board import Board
from etd_hal.ports import Clock

#: So long between two attempts: a board that is gone must not keep a core busy.
AGAIN_NS: Final = 10_000_000


class Supply:
    def __init__(self, board: Board, liveness: StopperLiveness, clock: Clock) -> None:
        self._board = board
        self._liveness = liveness
        self._now_ns = clock.now_ns
        #: Called with whether the stopper must be awake.
        self.watched: Callable[[bool], None] = lambda _: None
        #: What the last attempt left undone, as sentences.
        self.problems: tuple[str, ...] = ()
        self._again_ns = 0
        self._leaves_note = False

    def rises(self) -> None:
        """Told before it is on."""
        self._liveness.supply_rises()
        self.watched(True)

    def off(self) -> tuple[str, ...]:
        """Make the board safe. Returns what did not work, as sentences; `again` repeats it."""
        self.problems = problems = self._board.safe_off()
        if not self._leaves_note:
            self._liveness.made_safe(problems)
        if not problems:
            self.watched(False)
        self._again_ns = self._now_ns() + AGAIN_NS
        return problems

    def remember_defect(self, *, is_powered: bool) -> None:
        """Told before the last `off` of an engine that a defect ends; from then on that leaves the
        note. `is_powered`: by its state, which changes after the supply has gone off. What was not
        powered leaves nothing.
        """
        self._leaves_note = is_powered or self._liveness.is_supply_told

    def note_defect(self) -> None:
        """Once the stopper has ended, in words of its own: what the stopper noted says only that
        the supply was on, and is gone where it was off already. Raises: OSError.
        """
        if self._leaves_note:
            self._liveness.note_defect()

    def cleared(self) -> None:
        """A halt was cleared; the stopper is woken, to drop its note."""
        self._liveness.clear()
        self.watched(False)

    def again(self, now_ns: int) -> bool:
        """Called at each poll: the next attempt, if the last one failed and has been over for long
        enough. True: the board has become safe by it.
        """
        if not self.problems or now_ns < self._again_ns:
            return False
        return not self.off()
