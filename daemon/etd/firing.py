"""The only way to fire the board: a pulse is booked at its worst case, sent, and corrected.

Owns: what the ledger holds of a message before it is sent, after it, and when it failed; the halt
when a message took too long; the drift of message durations. Engine and self-test fire through it.
Must not know: why a pulse is wanted, limits and whether a pulse fits the ledger (both are checked
before), what is learned from it.

The worst case is booked before the first message of a pulse is sent: all phases as planned, each
with the excess at which a message halts (`halt_excess_us` of the machine file). After each message
its measured excess replaces that. When the guard refuses the first message, nothing was sent, and
the booking is taken back.

A message that fails may have left the source on. So the board is made safe at once, and the current
counts as having flowed from the booking until that was done; further phases stay booked. The same
holds for a message whose samples are not valid. A pulse that ends in any other way stays booked at
its worst case. See docs/decisions/0035.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from etd.protocol.errors import BoardFault, BusError, GuardRefusal
from etd.pulse.request import PulseRequest
from etd.safety.ledger import Booking, Entry, Ledger
from etd_hal.board import Board
from etd_hal.phase import Pulse, PulseResult
from etd_hal.ports import Clock
from etd_hal.selection import Selection
from etd_hal.switch_shadow import Prepulse

#: Weight of a new value in the mean deviation from plan, which shows drift.
_DRIFT_WEIGHT = 0.02


class ReadyPulse:
    """A pulse that limits and ledger let through, and its electrodes."""

    __slots__ = ("entry", "given", "is_blanked", "pulse", "selection")

    def __init__(
        self,
        entry: Entry,
        selection: Selection,
        pulse: Pulse,
        given: PulseRequest,
        is_blanked: bool = False,
    ) -> None:
        #: Of all its phases.
        self.entry: Final = entry
        self.selection: Final = selection
        self.pulse: Final = pulse
        #: The request that `pulse` was made from; no part of the pulse is more.
        self.given: Final = given
        #: A probe after `Board.release`, which must reach no electrode.
        self.is_blanked: Final = is_blanked


class Firing:
    """See the module. Raises, from its methods: BusError, GuardRefusal, BoardFault."""

    def __init__(
        self,
        board: Board,
        ledger: Ledger,
        clock: Clock,
        inspect: Callable[[ReadyPulse, bool, PulseResult], None] = lambda *_: None,
    ) -> None:
        """`inspect`: called with each message that was sent, its way (True: anodic) and what came
        back, when it is booked. What it raises ends the visit.
        """
        self._board = board
        self._inspect = inspect
        self._ledger = ledger
        self._now_ns = clock.now_ns
        self._halt_excess_ns = int(board.machine.halt_excess_us * 1_000)
        #: Of one message that does not halt.
        self._most_excess_us = math.ceil(board.machine.halt_excess_us)
        self._drift_ns = board.machine.drift_us * 1_000
        self._deviation_ns = 0.0

    @property
    def has_drifted(self) -> bool:
        """The mean duration of messages has left the calibrated one: calibrate again."""
        return abs(self._deviation_ns) > self._drift_ns

    def reset_drift(self) -> None:
        """After a calibration."""
        self._deviation_ns = 0.0

    def fire(self, ready: ReadyPulse, phases: Sequence[bool]) -> tuple[PulseResult, PulseResult]:
        """Book, then send one message for each phase (True: anodic). The electrodes stay connected.
        Returns the results of the first and the last phase.
        """
        excess_pc = len(phases) * ready.given.current_ua * self._most_excess_us
        worst_pc = ready.entry.charge_pc + excess_pc
        booking = self._ledger.book(ready.entry, self._now_ns(), worst_pc)
        first = last = self._send_first(booking, ready, phases[0])
        for is_anodic in phases[1:]:
            self._board.flip(ready.selection, is_anodic)
            last = self._send_next(booking, ready, is_anodic)
        return first, last

    def fire_unloaded(self, pulse: Pulse, given: PulseRequest) -> PulseResult:
        """Send a probe into the node alone, after `Board.isolate`. Nothing is booked, because
        nothing is selected behind outputs that are blanked: see docs/decisions/0038.
        """
        result = self._board.fire_unloaded(pulse, given.current_ua, given.width_us)
        self._check_excess(result.excess_ns, "with nothing connected")
        return result

    def _send_first(self, booking: Booking, ready: ReadyPulse, is_anodic: bool) -> PulseResult:
        try:
            result = self._send(booking, ready, is_anodic, booking.begun_ns)
        except GuardRefusal:
            self._ledger.take_back(booking)
            raise
        self._settle(booking, ready, result, result.begun_ns)
        self._inspect(ready, is_anodic, result)
        return result

    def _send_next(self, booking: Booking, ready: ReadyPulse, is_anodic: bool) -> PulseResult:
        result = self._send(booking, ready, is_anodic, self._now_ns())
        self._settle(booking, ready, result, booking.begun_ns)
        self._inspect(ready, is_anodic, result)
        return result

    def _send(
        self, booking: Booking, ready: ReadyPulse, is_anodic: bool, since_ns: int
    ) -> PulseResult:
        """`since_ns`: no current of this message can have flowed before."""
        given = ready.given
        try:
            return self._board.fire(
                ready.pulse,
                ready.selection,
                is_anodic,
                given.current_ua,
                given.width_us,
                prepulse_of(given),
                is_blanked=ready.is_blanked,
            )
        except (BusError, BoardFault) as fault:
            problems = self._board.safe_off()
            self._keep_worst(booking, ready, since_ns)
            if problems:
                what = f"message for electrode {ready.entry.electrode} failed"
                unsafe = BoardFault(what, f"{fault}; {'; '.join(problems)}", "a safe board")
                # Compiled, `from` alone does not set it.
                unsafe.__cause__ = fault
                raise unsafe from fault
            raise

    def _keep_worst(self, booking: Booking, ready: ReadyPulse, since_ns: int) -> None:
        """The board is safe now: the current flowed from `since_ns` until now at the longest."""
        now_ns = self._now_ns()
        booked_pc = ready.given.charge_pc + ready.given.current_ua * self._most_excess_us
        more_pc = max(0, _flowed_pc(ready.given, now_ns - since_ns) - booked_pc)
        self._ledger.correct(booking, booking.charge_pc + more_pc, now_ns)

    def _settle(
        self, booking: Booking, ready: ReadyPulse, result: PulseResult, begun_ns: int
    ) -> None:
        """The current cannot have flowed longer than planned by more than the message's excess."""
        excess_ns = result.excess_ns
        self._deviation_ns += _DRIFT_WEIGHT * (excess_ns - self._deviation_ns)
        charge_pc = booking.charge_pc - ready.given.current_ua * self._most_excess_us
        if excess_ns > 0:
            charge_pc += _flowed_pc(ready.given, excess_ns)
        self._ledger.correct(booking, charge_pc, begun_ns)
        self._check_excess(excess_ns, f"at electrode {ready.entry.electrode}")

    def _check_excess(self, excess_ns: int, where: str) -> None:
        if excess_ns > self._halt_excess_ns:
            raise BoardFault(
                "length of a message",
                f"{excess_ns / 1_000:.0f} us over its plan {where}",
                f"at most {self._halt_excess_ns / 1_000:.0f} us",
            )


def prepulse_of(given: PulseRequest) -> Prepulse | None:
    """The prepulse of a request, as `Board.pulse` takes it."""
    return Prepulse(given.prepulse_ua, given.prepulse_us) if given.prepulse_us else None


def _flowed_pc(given: PulseRequest, duration_ns: int) -> int:
    """The charge of the full current over `duration_ns`, rounded up."""
    return -(-given.current_ua * duration_ns // 1_000)
