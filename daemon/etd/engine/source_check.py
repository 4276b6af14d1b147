"""The current source's gain, checked with nothing connected: before each arming, and each second.

Owns: when a check is due, and its pulse. Must not know: what the node may read
(`etd_hal.source_rules`), scans, states, what follows from a fault.

Skin takes a part of the current, so that a source with a wrong gain looks like other skin: what
the node reads in a pulse tells it only where it is above current x leak (`node_check.py`). With
nothing connected the node is current x leak. The check's pulse is a third of a probe, as in a
self-test: a source that makes three times what it is told is still within the probe's bound.
See docs/decisions/0038.
"""

from __future__ import annotations

from etd.firing import Firing
from etd.protocol.errors import BoardFault
from etd.pulse.request import PulseRequest
from etd.safety.maxima import MaximaInForce
from etd_hal.board import Board

PERIOD_NS = 1_000_000_000
#: Of the probe's current.
_PART = 3


class SourceCheck:
    def __init__(self, board: Board, maxima: MaximaInForce, firing: Firing) -> None:
        self._board = board
        self._maxima = maxima
        self._firing = firing
        self._current_ua = maxima.now.probe_current_ua // _PART
        #: When the last one began; 0 before the first.
        self.checked_ns = 0
        source = board.file.source
        commanded_ua = source.current_of(source.code_for(self._current_ua))
        why = board.rules.why_untold(int(commanded_ua))
        #: Where the board's figures allow no check: the sentence that says so.
        self.limitations = () if why is None else (f"the source is not checked while armed: {why}",)

    def is_due(self, now_ns: int) -> bool:
        """Whether a second has passed since the last check."""
        return not self.limitations and now_ns - self.checked_ns >= PERIOD_NS

    def check(self, now_ns: int) -> BoardFault | None:
        """Between two pulses, with the outputs blanked. Returns what is wrong with the source.

        Raises: BusError, GuardRefusal; BoardFault for a message or samples that are not valid.
        """
        self.checked_ns = now_ns
        if self.limitations:
            return None
        board, given = self._board, PulseRequest(self._current_ua, self._maxima.now.probe_width_us)
        board.isolate()
        pulse = board.pulse(given.current_ua, given.width_us)
        result = self._firing.fire_unloaded(pulse, given)
        return board.rules.unloaded_fault(
            pulse.commanded_ua, result.baseline_v, result.early_v, result.voltage_v
        )
