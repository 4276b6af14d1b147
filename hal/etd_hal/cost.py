"""How long a pulse will take on this board and machine: for planning, never for limits.

Owns: the sum of calls, message, rest and computing of a pulse, and the part of it in which the
processor is busy. Must not know: frames, persons; how computing is measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from etd_hal.boardfile import BoardFile, MachineFile, Relays
from etd_hal.ports import SPIN_NS
from etd_hal.timing import Timing

#: The part of a pulse's computing that no rest can hide: from the call that un-blanks to the call
#: that blanks, the message apart. By `make bench`: 0.13 interpreted, 0.18 compiled.
FIRING_PART = 0.15
#: A poll where nothing is due, as a part of a pulse's computing.
IDLE_PART = 0.1
#: A scan's own computing, from its end to the next one's beginning, as a part of a pulse's: until
#: it is measured.
BETWEEN_PART = 1.0


class Computing(Protocol):
    """What this machine computes, and what its kernel leaves it."""

    @property
    def pulse_us(self) -> float:
        """For a pulse."""
        ...

    @property
    def between_us(self) -> float:
        """From the end of a scan to the beginning of the next: its report, polls, frames."""
        ...

    @property
    def spun_us(self) -> float:
        """Of each sleep."""
        ...

    @property
    def busy_fraction(self) -> float:
        """The scan may be busy for at most this part of the time."""
        ...

    @property
    def stretch(self) -> float:
        """How many times as long as planned scans take."""
        ...


@dataclass(frozen=True, slots=True)
class FiledComputing:
    """As the machine file has it, for a machine that is not measured."""

    pulse_us: float
    stretch: float = 1.0
    between_us: float = 0.0
    spun_us: float = SPIN_NS / 1_000
    busy_fraction: float = 0.8


class Cost(NamedTuple):
    """The cost of a pulse in us: until the next may begin, by its parts, and how long the processor
    is busy in that time.

    `wire`: messages and calls, as far as no rest hides them. `rest`: what the board's discharge
    takes. `processor`: computing, as far as no rest hides it.
    """

    wire_us: float
    rest_us: float
    processor_us: float
    busy_us: float

    @property
    def slot_us(self) -> float:
        return self.wire_us + self.rest_us + self.processor_us


class CostModel:
    """Costs from the board's rest, the machine's calls, the calibrated timing and the computing
    that was measured.
    """

    def __init__(
        self, board: BoardFile, machine: MachineFile, timing: Timing, computing: Computing
    ) -> None:
        self._board = board
        self._timing = timing
        self.computing = computing
        self._call_us = machine.gpio_call_us

    def visit(self, width_us: int, phases: int, clocks: int, probe_us: int = 0) -> Cost:
        """A pulse whose selection is `clocks` shifts away from the one before. With a probe first,
        everything is decided anew after the probe, with the electrodes still connected.
        """
        switch, rest_us = self._board.switch, float(self._board.rest_us)
        computing_us, spun_us = self.computing.pulse_us, self.computing.spun_us
        wire_us = self.wire_us(width_us, phases, probe_us)
        firing_us = FIRING_PART * computing_us * phases + (computing_us if probe_us else 0.0)
        resting_us = (1.0 - FIRING_PART) * computing_us
        if isinstance(switch, Relays):
            # Relays move between any two pulses, and the rest is waited out before they do.
            waits_us = phases * (switch.ton_us + switch.toff_us)
            busy_us = wire_us + firing_us + resting_us + phases * 2 * spun_us
            return Cost(wire_us + waits_us, rest_us, firing_us + resting_us, busy_us)
        shift_us = self.shift_us(clocks)
        spare_us = rest_us - shift_us - resting_us
        slept_us = max(0.0, spare_us - spun_us)
        cost = Cost(
            wire_us + max(0.0, shift_us - rest_us),
            rest_us,
            firing_us + max(0.0, -spare_us) - max(0.0, shift_us - rest_us),
            0.0,
        )
        return cost._replace(busy_us=cost.slot_us - slept_us)

    @property
    def idle_us(self) -> float:
        """Computing of a poll where nothing is due."""
        return IDLE_PART * self.computing.pulse_us

    def wire_us(self, width_us: int, phases: int, probe_us: int = 0) -> float:
        """Messages and calls of a pulse, from un-blanking to blanking."""
        switch, message_us = self._board.switch, self._timing.message_us
        probing_us = message_us + probe_us if probe_us else 0.0
        if isinstance(switch, Relays):
            # With all relays open, before any close, the node is looked at: a message of one word.
            calls_us = (4 * 2 * switch.outputs + 4) * self._call_us + message_us
            return phases * (message_us + width_us + calls_us) + probing_us
        return phases * (message_us + width_us + self._call_us) + self._call_us + probing_us

    def shift_us(self, clocks: int) -> float:
        """Shifting a selection in, which half-bridges do while the electrode before rests."""
        if isinstance(self._board.switch, Relays):
            return 0.0
        return 2 * clocks * self._call_us

    def clocks(self, before: int, output: int) -> int:
        """Shifts from one selection to another: the distance, or once around, until the old
        selection has left the chain and the new one has come in.
        """
        if output >= before:
            return output - before
        return max(self._board.switch.outputs - before, output + 1)

    def rewrite_us(self) -> float:
        """Rewriting the whole chain once a scan, less the part that fits into the rest."""
        hidden_us = 0 if isinstance(self._board.switch, Relays) else self._board.rest_us
        return max(0.0, self.chain_us() - hidden_us)

    def chain_us(self) -> float:
        """The calls that rewrite the whole chain."""
        switch = self._board.switch
        bits = 2 * switch.outputs if isinstance(switch, Relays) else switch.outputs
        return 2 * bits * self._call_us
