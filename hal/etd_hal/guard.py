"""The last guard: decodes the bytes and levels about to go out, and refuses those that break a
rule.

Owns: its own decoding of DAC words, typed apart from the encoders; its own worst case for the
timing; the rules below.
Must not know: frames, persons, stabilizers; how a message or a selection was made.

It stands between the board and the ports: `guard.spi` and `guard.gpio` are the only ports that
`board.py` fires through. Before each pulse the engine passes an `Approval` with what the limits let
through; the guard compares it with what the bytes would do. The only path around the guard is
`Board.safe_off`, which can only switch off.

Rules for SPI: 2-byte words with control bits 00, each under a chip select of its own, which
changes after words only; at most 32 words and 511 transfers; no delay above 10 us; ends in zero;
from the first word on one level besides zero, or two of which the second is higher: a prepulse
and its pulse. For a message that is not silent: permitted in this state; approved, this one
pulse, each step of it, for just these outputs; worst-case width and charge of its steps together
within 1.2 times the maxima, which bound the plan; not more often than the rate; outputs un-blanked,
latch closed, one output alone on its side and at least one on the other. What counts to the rate,
and which messages are one visit, is in `visitrule.py`.
A message within the probe's bounds may also be approved for outputs that are blanked, or relays
that are all open.
The rules for GPIO are in `switch_shadow.py`, with the decoding of the switch.

While the stopper's cut stands (`cutlatch.py`) nothing passes to the lines, and no message that was
given a plan to the bus: the lines are not as the guard's picture has them, and a change that is
harmless in the picture (POL 0 while un-blanked) may connect all outputs to the source.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from etd_hal.boardfile import BoardFile, MachineFile, Relays
from etd_hal.cutlatch import CUTS, DUE_NS, CutLatch
from etd_hal.errors import GuardRefusal
from etd_hal.ports import Changes, Clock, Edge, Gpio, Message, Spi, Transfer
from etd_hal.switch_shadow import Approval, Figures, HalfBridgeShadow, RelayShadow, SwitchShadow
from etd_hal.visitrule import VisitRule, longest_flip_ns

_LONGEST_DELAY_US = 10
_MOST_WORDS = 32
_MOST_TRANSFERS = 511
#: Worst case over plan: the 20 % accuracy that IEC 60601-2-10 asks of duration and amplitude.
_TOLERANCE = 1.2


@dataclass(slots=True)
class Step:
    """A level of a message, from its first word on, by the guard's own constants."""

    code: int
    current_ua: float
    shortest_us: float = 0.0
    longest_us: float = 0.0


class Decoded:
    """What the bytes of a message would do: nothing, a pulse, or a prepulse and a pulse."""

    __slots__ = ("figures", "is_probe", "longest_nc", "longest_us", "permitted_ua", "steps")

    def __init__(
        self, steps: tuple[Step, ...], longest_us: float, longest_nc: float, is_probe: bool
    ) -> None:
        self.steps: Final = steps
        #: The worst case of all steps together.
        self.longest_us: Final = longest_us
        self.longest_nc: Final = longest_nc
        self.is_probe: Final = is_probe
        #: The figures of an approval that the message was found to keep within, and what was
        #: permitted then. A message never changes, so the same figures need no second judgement.
        self.figures: Figures | None = None
        self.permitted_ua = 0


class Guard:
    """See the module. One instance per board."""

    def __init__(
        self,
        board: BoardFile,
        machine: MachineFile,
        spi: Spi,
        gpio: Gpio,
        clock: Clock,
        cut: CutLatch,
        safe_changes: Changes,
    ) -> None:
        """`safe_changes`: the levels of the safe state, sent again if a cut came meanwhile."""
        self._board = board
        self._machine = machine
        self._clock = clock
        self._permitted_ua = 0
        self._approval: Approval | None = None
        self.switch: SwitchShadow = (
            RelayShadow(board.switch, clock)
            if isinstance(board.switch, Relays)
            else HalfBridgeShadow(board.switch, _hv_line(board))
        )
        flip_ns = longest_flip_ns(board, machine)
        self._visits = VisitRule(board.maxima.rate_hz, flip_ns, self.switch)
        self.spi = GuardedSpi(self, spi, clock, cut)
        self.gpio = GuardedGpio(self.switch, gpio, cut, safe_changes)

    def permit(self, current_ua: int) -> None:
        """Set the highest current of the present state: 0, the probe bound, or the maximum."""
        self._permitted_ua = min(current_ua, self._board.maxima.current_ua)
        self._approval = None

    def approve(self, approval: Approval) -> None:
        """Approve the next pulse, and no other."""
        self._approval = approval

    def reset(self, levels: Changes) -> None:
        """After safe_off: these levels are known, the registers are not. A supply line that is not
        among them keeps its state.
        """
        self._approval = None
        self._visits.reset()
        self.switch.reset(levels)

    def check(self, message: Message) -> None:
        """Raises: GuardRefusal. Nothing has been sent then."""
        decoded: Decoded | None = message.made.get(self)
        if decoded is None:
            decoded = message.made[self] = self._decode(message)
        if not decoded.steps:
            return
        approval = self._approval
        if (
            approval is None
            or approval.figures != decoded.figures
            or self._permitted_ua != decoded.permitted_ua
        ):
            approval = self._judged(decoded, approval)
        visits = self._visits
        if visits.state == "probed":
            self._check_charge(decoded.longest_nc + visits.probe_nc(approval))
        self.switch.check_selection(approval)
        visits.take(
            approval, decoded.longest_us, decoded.longest_nc, decoded.is_probe, self._clock.now_ns()
        )
        self._approval = None

    def lets_width_pass(self, message: Message) -> bool:
        """Whether the message's worst case is within the board's maximum width. Nothing is sent."""
        return self._decode(message).longest_us <= self._board.maxima.width_us * _TOLERANCE

    def _decode(self, message: Message) -> Decoded:
        transfers = message.transfers
        if not transfers or len(transfers) > _MOST_TRANSFERS:
            raise GuardRefusal("transfers", str(len(transfers)), f"1 to {_MOST_TRANSFERS}")
        if transfers[-1].cs_change:
            raise GuardRefusal("chip select", "held after the message", "released")
        codes: list[int] = []
        steps: list[Step] = []
        is_word_waiting = False
        for transfer in transfers:
            if not 0 <= transfer.delay_us <= _LONGEST_DELAY_US:
                raise GuardRefusal("delay", f"{transfer.delay_us} us", f"{_LONGEST_DELAY_US} us")
            if transfer.tx:
                if is_word_waiting:
                    raise GuardRefusal("chip select", "two words under one", "one word each")
                codes.append(_code_in(transfer.tx))
                is_word_waiting = not transfer.cs_change
            elif transfer.cs_change:
                raise GuardRefusal("chip select", "changed after a delay", "after a word only")
            if steps:
                self._lengthen(steps[-1], transfer)
            # The DAC follows the rise of chip select; until then the level before it holds.
            if transfer.cs_change and (not steps or steps[-1].code != codes[-1]):
                steps.append(Step(codes[-1], self._current_ua(codes[-1])))
        if steps and not steps[-1].code:
            steps.pop()
        self._check_codes(codes, steps)
        return self._summed(steps)

    def _lengthen(self, step: Step, transfer: Transfer) -> None:
        """Lengthen a step by a word with its chip select, or by a pure delay: at best and
        at worst.
        """
        machine = self._machine
        best_us = machine.word_us.low if transfer.tx else 0.0
        worst_us = machine.guard_word_us if transfer.tx else machine.guard_delay_extra_us
        step.shortest_us += transfer.delay_us + best_us
        step.longest_us += transfer.delay_us + worst_us

    def _summed(self, steps: list[Step]) -> Decoded:
        return Decoded(
            tuple(steps),
            sum(step.longest_us for step in steps),
            sum(step.current_ua * step.longest_us for step in steps) / 1_000,
            self._is_probe(steps),
        )

    @staticmethod
    def _check_codes(codes: list[int], steps: list[Step]) -> None:
        if not 1 <= len(codes) <= _MOST_WORDS:
            raise GuardRefusal("words", str(len(codes)), f"1 to {_MOST_WORDS}")
        if codes[-1] != 0:
            raise GuardRefusal("end of message", f"DAC code {codes[-1]}", "DAC code 0")
        levels = [0, *(step.code for step in steps)]
        if len(levels) > 3 or any(later <= before for before, later in pairwise(levels)):
            raise GuardRefusal(
                "levels", str(codes), "from the first word one level, or a lower and a higher one"
            )

    def _judged(self, decoded: Decoded, approval: Approval | None) -> Approval:
        """Check what follows from message, approval and permission alone. Returns the approval."""
        maxima, longest_us = self._board.maxima, decoded.longest_us
        current_ua = decoded.steps[-1].current_ua
        if current_ua > self._permitted_ua:
            raise GuardRefusal("state", f"{current_ua:.0f} uA", f"{self._permitted_ua} uA now")
        if longest_us > maxima.width_us * _TOLERANCE:
            raise GuardRefusal("width", f"{longest_us:.0f} us", f"{maxima.width_us} us")
        self._check_charge(decoded.longest_nc)
        if approval is None:
            raise GuardRefusal("approval", "a pulse that no limit has seen", "approve it first")
        self._check_steps(decoded.steps, approval)
        if (approval.is_blanked or not approval.source) and not decoded.is_probe:
            raise GuardRefusal("switch", "a pulse with nothing connected", "a probe alone")
        decoded.figures, decoded.permitted_ua = approval.figures, self._permitted_ua
        return approval

    def _check_charge(self, charge_nc: float) -> None:
        most_nc = self._board.maxima.charge_nc
        if charge_nc > most_nc * _TOLERANCE:
            raise GuardRefusal("charge", f"{charge_nc:.0f} nC", f"{most_nc} nC")

    def _current_ua(self, code: int) -> float:
        source = self._board.source
        return code * source.full_scale_ua / (source.codes - 1)

    def _check_steps(self, steps: tuple[Step, ...], approval: Approval) -> None:
        """Check each step against its own current and width, so that the sums fit as well."""
        self._check_step(steps[-1], approval.current_ua, approval.width_us)
        for step in steps[:-1]:
            if approval.prepulse is None:
                raise GuardRefusal("approval", "a prepulse", "a pulse of one level")
            self._check_step(step, approval.prepulse.current_ua, approval.prepulse.width_us)

    def _check_step(self, step: Step, most_ua: int, most_us: int) -> None:
        if step.current_ua > most_ua or step.shortest_us > most_us + 1:
            raise GuardRefusal(
                "approval",
                f"{step.current_ua:.0f} uA for {step.shortest_us:.0f} us or more",
                f"{most_ua} uA for {most_us} us",
            )

    def _is_probe(self, steps: list[Step]) -> bool:
        maxima = self._board.maxima
        return (
            len(steps) == 1
            and steps[0].current_ua <= maxima.probe_current_ua
            and steps[0].shortest_us <= maxima.probe_width_us + 1
        )


def _code_in(sent: bytes) -> int:
    """The DAC code in two bytes: bits 13 to 2; bits 15, 14 are the command, 1 and 0 unused."""
    if len(sent) != 2:
        raise GuardRefusal("word", f"{len(sent)} bytes", "2 bytes: 16 clocks a chip select")
    high, low = sent
    if high >> 6:
        raise GuardRefusal("DAC command", f"{high >> 6:02b}", "00 (load and update)")
    if low & 3:
        raise GuardRefusal("DAC word", sent.hex(), "zeros in the two unused bits")
    return (high & 0x3F) << 6 | low >> 2


def _hv_line(board: BoardFile) -> tuple[int, int] | None:
    enable = board.guards.hv_enable
    return None if enable == "absent" else (enable.line, enable.on)


class GuardedSpi:
    """The port that fires. It records when the last message began and ended, without the guard's
    own work and the driver's preparation.
    """

    def __init__(self, guard: Guard, spi: Spi, clock: Clock, cut: CutLatch) -> None:
        self._guard = guard
        self._spi = spi
        self._clock = clock
        self._cut = cut
        self.begun_ns = 0
        self.ended_ns = 0

    def prepare(self, message: Message) -> None:
        """See `ports.Spi`. Nothing is sent, so nothing is checked."""
        self._spi.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        """As the port's `transfer`, for messages without a planned duration: those that calibrate
        timing.
        """
        self._make_ready(message)
        self.begun_ns = self._clock.now_ns()
        received = self._spi.transfer(message)
        self.ended_ns = self._clock.now_ns()
        return received

    def fire(self, message: Message, planned_ns: int) -> tuple[bytes, ...]:
        """The same for a message planned to take `planned_ns`, watched by the stopper.

        A cut during the message is refused by the next call: samples and duration of this message
        are still returned. Raises: as `transfer`, and BoardFault while a cut stands.
        """
        self._make_ready(message)
        cut = self._cut
        words = cut.words
        if words[CUTS] != cut.ended:
            cut.check()
        self.begun_ns = begun_ns = self._clock.now_ns()
        words[DUE_NS] = begun_ns + planned_ns
        try:
            received = self._spi.transfer(message)
        finally:
            words[DUE_NS] = 0
        self.ended_ns = self._clock.now_ns()
        return received

    def _make_ready(self, message: Message) -> None:
        self._guard.check(message)
        # Otherwise `transfer` prepares it, and the driver's work would count as time with current.
        self._spi.prepare(message)


class GuardedGpio:
    """The port that switches."""

    def __init__(
        self, switch: SwitchShadow, gpio: Gpio, cut: CutLatch, safe_changes: Changes
    ) -> None:
        self._switch = switch
        self._gpio = gpio
        self._cut = cut
        self._safe_changes = safe_changes
        #: While the board is made safe, after the call that blanked it: a cut does not block this.
        self.is_making_safe = False

    def set(self, changes: Changes) -> None:
        """As the port's `set`. Also raises GuardRefusal, and BoardFault for a cut that came
        meanwhile: the lines are at their safe levels again then.
        """
        cut = self._cut
        words = cut.words
        if words[CUTS] != cut.ended:
            self._heed_cut()
        self._switch.follow(changes)
        self._gpio.set(changes)
        if words[CUTS] != cut.ended:
            self._heed_cut()

    def _heed_cut(self) -> None:
        if self.is_making_safe:
            return
        self._gpio.set(self._safe_changes)
        self._cut.check()

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self._gpio.edges()
