"""The stopper's thread, played on a stepped clock: its looks fall into whatever the engine does.

Owns: when it looks. Must not know: what a look does.
"""

from __future__ import annotations

from etd.engine.loop import Engine
from etd_hal.fake.clock import SteppedClock
from etd_hal.stopper import Stopper
from etd_hal.supply_note import SupplyNote

#: As the thread does.
PERIOD_NS = 500_000


class _WithDisk(Stopper):
    """A disk that takes its time would hold up the one thread that there is here."""

    is_noting = True

    def note_supply(self) -> None:
        if self.is_noting:
            super().note_supply()


class SteppedStopper:
    """Looks while the supply is on, in the middle of calls and sleeps too."""

    def __init__(
        self,
        engine: Engine,
        clock: SteppedClock,
        period_ns: int = PERIOD_NS,
        note: SupplyNote | None = None,
    ) -> None:
        board, now_ns = engine.components.board, engine.components.backend.clock.now_ns
        self._stopper = _WithDisk(board.cut.words, now_ns, board.blank_now, note)
        self._clock = clock
        self.period_ns = period_ns
        #: False: it has ended, or hangs.
        self.is_looking = True
        self._is_awake = False
        self._is_under_way = False
        self._next_ns = 0
        engine.supervisor.supply.watched = self.watch

    @property
    def is_noting(self) -> bool:
        """False: its disk takes its time."""
        return self._stopper.is_noting

    @is_noting.setter
    def is_noting(self, is_noting: bool) -> None:
        self._stopper.is_noting = is_noting

    def watch(self, is_needed: bool) -> None:
        """Supply on or off; woken it looks at once."""
        self._is_awake = is_needed
        if self.is_looking and not is_needed:
            self._stopper.note_supply()
        if is_needed and not self._is_under_way:
            self._is_under_way = True
            self._next_ns = self._clock.now_ns()
            self._turn()

    def check(self) -> None:
        """One look."""
        self._stopper.check()

    def end(self, *, cuts: bool = True) -> None:
        """Of the engine: it cuts, settles the note, and is over. Or it was killed as well."""
        self._is_awake = False
        if cuts:
            self._stopper.cut()
            self._stopper.note_supply()

    def _turn(self) -> None:
        if not self._is_awake:
            self._is_under_way = False
            return
        if self.is_looking:
            self.check()
        self._next_ns += self.period_ns
        self._clock.at(self._next_ns, self._turn)
