"""The only way to fire the board: a pulse is booked at its worst case, sent, and corrected.

Owns: what the ledger holds of a message before it is sent, after it, and when it failed; the halt
when a message took too long; the drift of message durations. Engine and self-test fire through it.
Must not know: why a pulse is wanted, limits and whether a pulse fits the ledger (both are checked
before), what is learned from it.

The worst case is booked before the electrodes are connected: all phases as planned, each with the
excess at which a message halts (`halt_excess_us` of the machine file). After each message its
measured excess replaces that. When the pulse is not valid any more once they are connected, or the
guard refuses the first message, nothing was sent, and the booking is taken back.

Net charge is booked by phases, in the direction in which more of it may have been left: what a
phase took over its plan has flowed, or has not.

After its last message a pulse is over: the electrodes are discharged first, and then the message is
judged, whatever it was. Between two phases it is judged before the polarity is changed.

A message that fails may have left the source on. So the board is made safe at once, and the current
counts as having flowed from the booking until that was done; further phases stay booked. The same
holds for a message whose samples are not valid. A pulse that ends in any other way stays booked at
its worst case. See docs/decisions/0035.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from etd.protocol.errors import BoardFault, BusError, GuardRefusal
from etd.pulse.request import PulseRequest
from etd.safety.bookings import Booking, Entry
from etd.safety.ledger import Ledger
from etd_hal.board import Board
from etd_hal.phase import Pulse, PulseResult
from etd_hal.ports import Clock
from etd_hal.selection import Selection
from etd_hal.switch_shadow import Approval, Prepulse

#: Weight of a new value in the mean deviation from plan, which shows drift.
_DRIFT_WEIGHT = 0.02


class Flowed(NamedTuple):
    """The least and the most charge that one phase may have had."""

    least_pc: int
    most_pc: int


_NOTHING: Final = Flowed(0, 0)


class ReadyPulse:
    """A pulse that limits and ledger let through, its electrodes, and what the guard is told of
    each phase: all that can be made before the electrodes are connected.
    """

    __slots__ = ("approvals", "entry", "given", "phases", "pulse", "selection")

    def __init__(
        self,
        entry: Entry,
        selection: Selection,
        phases: tuple[bool, ...],
        pulse: Pulse,
        given: PulseRequest,
        is_blanked: bool = False,
    ) -> None:
        """`phases`: the way of each message (True: anodic). `is_blanked`: a probe after
        `Board.release`, which must reach no electrode.
        """
        #: Of all its phases.
        self.entry: Final = entry
        self.selection: Final = selection
        self.phases: Final = phases
        self.pulse: Final = pulse
        #: The request that `pulse` was made from; no part of the pulse is more.
        self.given: Final = given
        self.approvals: Final = [
            _approval(selection, is_anodic, given, is_blanked) for is_anodic in phases
        ]


def _approval(
    selection: Selection, is_anodic: bool, given: PulseRequest, is_blanked: bool
) -> Approval:
    return Approval(
        selection.source(is_anodic),
        selection.ground(is_anodic),
        given.current_ua,
        given.width_us,
        prepulse_of(given),
        is_blanked,
    )


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
        self._drift_ns = board.machine.drift_us * 1_000
        self._deviation_ns = 0.0

    @property
    def has_drifted(self) -> bool:
        """The mean duration of messages has left the calibrated one: calibrate again."""
        return abs(self._deviation_ns) > self._drift_ns

    def reset_drift(self) -> None:
        """After a calibration."""
        self._deviation_ns = 0.0

    def book(self, ready: ReadyPulse) -> Booking:
        """Books the worst case. `fire` or `take_back` follows."""
        excess_pc = len(ready.phases) * self._most_excess_pc(ready)
        return self._ledger.book(ready.entry, self._now_ns(), ready.entry.charge_pc + excess_pc)

    def connect(self, ready: ReadyPulse) -> Booking:
        """Books the worst case, then connects the electrodes; `fire` or `take_back` follows."""
        booking = self.book(ready)
        try:
            self._board.connect(ready.selection, ready.phases[0])
        except (BusError, GuardRefusal, BoardFault):
            self._ledger.take_back(booking)
            raise
        return booking

    def take_back(self, booking: Booking) -> None:
        """Nothing was sent of what was booked last."""
        self._ledger.take_back(booking)

    def fire(
        self, booking: Booking, ready: ReadyPulse, *, stays_connected: bool = False
    ) -> tuple[PulseResult, PulseResult]:
        """Send one message for each phase. The electrodes are discharged directly after the last
        one, before it is looked at; or, a probe before its pulse, stay connected. Returns the
        results of the first and the last phase.
        """
        phases, last_at = ready.phases, len(ready.phases) - 1
        flowed: list[Flowed] = []
        try:
            is_over = not (last_at or stays_connected)
            first = last = self._play(booking, ready, flowed, is_over)
            for at in range(1, last_at + 1):
                self._board.flip(ready.selection, phases[at])
                last = self._play(booking, ready, flowed, is_over=at == last_at)
        finally:
            # Nothing flowed where the first message was refused, whose booking was taken back.
            self._ledger.settle_net(booking, left_pc(is_anodic=phases[0], flowed=flowed))
        return first, last

    def fire_unloaded(self, pulse: Pulse, given: PulseRequest) -> PulseResult:
        """Send a probe into the node alone, after `Board.isolate`. Nothing is booked, because
        nothing is selected behind outputs that are blanked: see docs/decisions/0038.
        """
        return self._timely(self._board.fire_unloaded(pulse, given.current_ua, given.width_us))

    def fire_unselected(self, pulse: Pulse, given: PulseRequest) -> PulseResult:
        """The same with the outputs un-blanked: it reaches an electrode only where the latch is not
        what it was told. Nothing is booked: see docs/decisions/0078.
        """
        return self._timely(self._board.fire_unselected(pulse, given.current_ua, given.width_us))

    def _timely(self, result: PulseResult) -> PulseResult:
        if result.excess_ns > self._halt_excess_ns:
            raise self._too_long(result.excess_ns, "with nothing connected")
        return result

    def _play(
        self, booking: Booking, ready: ReadyPulse, flowed: list[Flowed], is_over: bool
    ) -> PulseResult:
        """Send the message of the next phase, then book and judge it; in between, the electrodes
        are discharged if the visit `is_over`. `flowed` is added to, unless the guard refused it.
        """
        at = len(flowed)
        try:
            received = self._board.send(ready.pulse, ready.approvals[at])
        except (BusError, BoardFault) as fault:
            self._make_safe(booking, ready, flowed, fault)
            raise
        except GuardRefusal:
            if at == 0:
                self._ledger.take_back(booking)
            raise
        try:
            if is_over:
                self._board.discharge()
        finally:
            result = self._judge(booking, ready, flowed, received)
        return result

    def _judge(
        self,
        booking: Booking,
        ready: ReadyPulse,
        flowed: list[Flowed],
        received: tuple[bytes, ...],
    ) -> PulseResult:
        """Take the message's excess in place of the worst: the current cannot have flowed longer
        than planned by more than that. Then look at what came back.
        """
        try:
            result = self._board.result(ready.pulse, received)
        except BoardFault as fault:
            self._make_safe(booking, ready, flowed, fault)
            raise
        at = len(flowed)
        excess_ns = result.excess_ns
        self._deviation_ns += _DRIFT_WEIGHT * (excess_ns - self._deviation_ns)
        excess_pc = _flowed_pc(ready.given, excess_ns) if excess_ns > 0 else 0
        charge_pc = booking.charge_pc - self._most_excess_pc(ready) + excess_pc
        flowed.append(Flowed(ready.given.charge_pc, ready.given.charge_pc + excess_pc))
        self._ledger.correct(booking, charge_pc, booking.begun_ns if at else result.begun_ns)
        if excess_ns > self._halt_excess_ns:
            raise self._too_long(excess_ns, f"at electrode {ready.entry.electrode}")
        self._inspect(ready, ready.phases[at], result)
        return result

    def _make_safe(
        self,
        booking: Booking,
        ready: ReadyPulse,
        flowed: list[Flowed],
        fault: BusError | BoardFault,
    ) -> None:
        """Raises: BoardFault, with what went wrong, if the board does not become safe."""
        problems = self._board.safe_off()
        flowed.append(Flowed(0, self._keep_worst(booking, ready)))
        if problems:
            what = f"message for electrode {ready.entry.electrode} failed"
            unsafe = BoardFault(what, f"{fault}; {'; '.join(problems)}", "a safe board")
            # Compiled, `from` alone does not set it.
            unsafe.__cause__ = fault
            raise unsafe from fault

    def _keep_worst(self, booking: Booking, ready: ReadyPulse) -> int:
        """The board is safe now: the current flowed from the beginning of the last message until
        now at the longest; from the booking, if none was sent since. Returns the most that this
        phase had.
        """
        since_ns, now_ns = max(booking.begun_ns, self._board.sent_ns), self._now_ns()
        booked_pc = ready.given.charge_pc + self._most_excess_pc(ready)
        more_pc = max(0, _flowed_pc(ready.given, now_ns - since_ns) - booked_pc)
        self._ledger.correct(booking, booking.charge_pc + more_pc, now_ns)
        return booked_pc + more_pc

    def _most_excess_pc(self, ready: ReadyPulse) -> int:
        """Of one message that does not halt."""
        return _flowed_pc(ready.given, self._halt_excess_ns)

    def _too_long(self, excess_ns: int, where: str) -> BoardFault:
        return BoardFault(
            "length of a message",
            f"{excess_ns / 1_000:.0f} us over its plan {where}",
            f"at most {self._halt_excess_ns / 1_000:.0f} us",
        )


def left_pc(*, is_anodic: bool, flowed: Sequence[Flowed]) -> int:
    """What phases in turn left, the first one `is_anodic` or not, positive into the skin: of all
    that they may have left, what is furthest from nothing.
    """
    first, second = (*flowed, _NOTHING, _NOTHING)[:2]
    most_pc = first.most_pc - second.least_pc
    least_pc = first.least_pc - second.most_pc
    furthest_pc = most_pc if most_pc >= -least_pc else least_pc
    return furthest_pc if is_anodic else -furthest_pc


def prepulse_of(given: PulseRequest) -> Prepulse | None:
    """The prepulse of a request, as `Board.pulse` takes it."""
    return Prepulse(given.prepulse_ua, given.prepulse_us) if given.prepulse_us else None


def _flowed_pc(given: PulseRequest, duration_ns: int) -> int:
    """The charge of the full current over `duration_ns`, rounded up."""
    return -(-given.current_ua * duration_ns // 1_000)
