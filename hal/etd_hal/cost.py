"""How long a pulse will take on this board and machine: for planning, never for limits.

Owns: the sum of calls, message and rest of a pulse, and the part of it in which the processor is
busy. Must not know: frames, persons.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd_hal.boardfile import BoardFile, MachineFile, Relays
from etd_hal.ports import SPIN_NS
from etd_hal.timing import Timing


@dataclass(frozen=True, slots=True)
class Cost:
    """The cost of a pulse in us: until the next may begin, and the part with the processor busy."""

    slot_us: float
    busy_us: float


class CostModel:
    """Costs from the board's rest, the machine's calls and the calibrated timing."""

    def __init__(self, board: BoardFile, machine: MachineFile, timing: Timing) -> None:
        self._board = board
        self._machine = machine
        self._timing = timing
        self._call_us = machine.gpio_call_us

    def visit(self, width_us: int, phases: int, clocks: int, probe_us: int = 0) -> Cost:
        """A pulse whose selection is `clocks` shifts away from the one before. With a probe first,
        everything is decided anew after the probe, with the electrodes still connected.
        """
        switch = self._board.switch
        message_us = self._timing.message_us + width_us
        shift_us = 2 * clocks * self._call_us
        work_us = self._machine.visit_us
        probing_us = self._timing.message_us + probe_us + work_us if probe_us else 0.0
        if isinstance(switch, Relays):
            stages = 2 * switch.outputs
            relay_us = switch.ton_us + switch.toff_us
            # With all relays open, before any close, the node is looked at: a message of one word.
            calls_us = (4 * stages + 4) * self._call_us + self._timing.message_us
            active_us = phases * (message_us + calls_us) + probing_us
            slot_us = active_us + phases * relay_us + self._board.rest_us + work_us
            return Cost(slot_us, active_us + work_us + phases * 2 * SPIN_NS / 1_000)
        active_us = phases * (message_us + self._call_us) + self._call_us + probing_us
        prepare_us = shift_us + work_us
        slept_us = max(0.0, self._board.rest_us - prepare_us - SPIN_NS / 1_000)
        slot_us = active_us + max(float(self._board.rest_us), prepare_us)
        return Cost(slot_us, slot_us - slept_us)

    def clocks(self, before: int, output: int) -> int:
        """Shifts from one selection to another: the distance, or once around, until the old
        selection has left the chain and the new one has come in.
        """
        if output >= before:
            return output - before
        return max(self._board.switch.outputs - before, output + 1)

    def rewrite_us(self) -> float:
        """Rewriting the whole chain once a scan, less the part that fits into the rest."""
        switch = self._board.switch
        if isinstance(switch, Relays):
            return 2 * 2 * switch.outputs * self._call_us
        return max(0.0, 2 * switch.outputs * self._call_us - self._board.rest_us)
