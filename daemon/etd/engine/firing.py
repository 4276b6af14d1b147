"""The messages of one visit, fired: each is booked at once, and checked against its plan.

Owns: what is fired of a wish that the limits let through, its ledger entry, the halt when a message
took too long, and the drift of their durations. Must not know: who wished, limits, what is learned.
"""

from __future__ import annotations

import math

from etd.engine.visit import Visit
from etd.errors import BoardFault
from etd.ledger import Entry, Ledger
from etd.stabilize.pipeline import Wish
from etd_hal.board import Board, Pulse, Shot
from etd_hal.watch import Prepulse

#: Of the mean deviation from plan, by which drift is seen.
_DRIFT_WEIGHT = 0.02


class Firing:
    """See the module. Raises, from its methods: BusError, GuardRefusal, BoardFault."""

    def __init__(self, board: Board, ledger: Ledger) -> None:
        self._board = board
        self._ledger = ledger
        self._halt_excess_ns = int(board.machine.halt_excess_us * 1_000)
        self._drift_ns = board.machine.drift_us * 1_000
        self._deviation_ns = 0.0

    @property
    def has_drifted(self) -> bool:
        """Messages take longer or shorter than calibrated, on the mean: calibrate again."""
        return abs(self._deviation_ns) > self._drift_ns

    def forget_drift(self) -> None:
        """After a calibration."""
        self._deviation_ns = 0.0

    def first(self, visit: Visit, pulse: Pulse, entry: Entry, given: Wish) -> Shot:
        """One message, the way that the first phase goes; all stays connected."""
        shot = self._board.fire(pulse, visit.selection, visit.phases[0], *_allowed(given))
        self._ledger.book(entry, shot.begun_ns)
        self._check_duration(shot, pulse, entry)
        return shot

    def fire(self, visit: Visit, pulse: Pulse, entry: Entry, given: Wish) -> tuple[Shot, Shot]:
        """All phases, and the discharge: the first and the last phase's."""
        board = self._board
        first_shot = shot = self.first(visit, pulse, entry, given)
        for is_anodic in visit.phases[1:]:
            board.flip(visit.selection, is_anodic)
            shot = board.fire(pulse, visit.selection, is_anodic, *_allowed(given))
            self._check_duration(shot, pulse, entry)
        board.discharge()
        return first_shot, shot

    def _check_duration(self, shot: Shot, pulse: Pulse, entry: Entry) -> None:
        """What a message took over its plan bounds what the current flowed too long."""
        excess_ns = shot.excess_ns
        self._deviation_ns += _DRIFT_WEIGHT * (excess_ns - self._deviation_ns)
        if excess_ns <= 0:
            return
        excess_pc = math.ceil(pulse.told_ua * excess_ns / 1_000)
        self._ledger.book_excess(entry, excess_pc, shot.begun_ns)
        if excess_ns > self._halt_excess_ns:
            raise BoardFault(
                f"message for electrode {entry.electrode}",
                f"{excess_ns / 1_000:.0f} us over its plan",
                f"at most {self._halt_excess_ns / 1_000:.0f} us",
            )


def entry_of(visit: Visit, given: Wish, share: float, pulses: int = 1) -> Entry:
    """All phases of it. `pulses` 0: the visit is booked already."""
    phases = len(visit.phases)
    on_us = given.whole_us * phases
    return Entry(visit.electrode, given.charge_pc * phases, on_us, visit.returns, share, pulses)


def prepulse_of(given: Wish) -> Prepulse | None:
    """As the board takes it."""
    return Prepulse(given.prepulse_ua, given.prepulse_us) if given.prepulse_us else None


def _allowed(given: Wish) -> tuple[int, int, Prepulse | None]:
    return given.current_ua, given.width_us, prepulse_of(given)
