"""The source's gain and the latch of the switches, checked with no electrode on the source.

Owns: when a check is due, and its pulses. Must not know: what the node may read
(`etd_hal.source_rules`), scans, states, what follows from a fault.

Skin takes a part of the current, so that a source with a wrong gain looks like other skin: what
the node reads in a pulse tells it only where it is above current x leak (`node_check.py`). With
nothing connected the node is current x leak. So before each arming, and each second, a pulse is
fired with all outputs blanked; see docs/decisions/0038.

A latch that does not take over what is shifted sends the pulses of all electrodes to one. So after
that, and each tenth of a second while a frame is shown, a pulse is fired with the outputs live and
none selected: it must read the same; see docs/decisions/0078.

The pulse is a third of a probe, as in a self-test: a source that makes three times what it is told
is still within the probe's bound. A source that is wrong above some current only passes that. So
where the outputs are blanked the whole probe follows: a source that held at a third of it is not
far off at three times that.
"""

from __future__ import annotations

from etd.firing import Firing
from etd.protocol.errors import BoardFault
from etd.pulse.request import PulseRequest
from etd.safety.maxima import MaximaInForce
from etd_hal.board import Board
from etd_hal.phase import Pulse

PERIOD_NS = 1_000_000_000
LATCH_PERIOD_NS = 100_000_000
#: At most, with what is shifted for it and for the scan after it.
_TAKES_NS = 1_000_000
#: Of the probe's current.
_PART = 3


class SourceCheck:
    def __init__(self, board: Board, maxima: MaximaInForce, firing: Firing) -> None:
        self._board = board
        self._maxima = maxima
        self._firing = firing
        self._current_ua = maxima.now.probe_current_ua // _PART
        whole_ua = maxima.now.probe_current_ua
        #: When the last one began; 0 before the first.
        self.checked_ns = self._exposed_ns = 0
        self._has_latch = board.can_fire_unselected
        why = self._why_untold(self._current_ua)
        #: Fired in turn, with the outputs blanked.
        self._blanked_ua = [self._current_ua]
        if self._why_untold(whole_ua) is None:
            self._blanked_ua.append(whole_ua)
        #: Where the board's figures allow no check: the sentence that says so.
        self.limitations = () if why is None else (f"the source is not checked while armed: {why}",)

    def _why_untold(self, current_ua: int) -> str | None:
        source = self._board.file.source
        commanded_ua = source.current_of(source.code_for(current_ua))
        return self._board.rules.why_untold(int(commanded_ua))

    def is_due(self, now_ns: int, room_ns: int | None) -> bool:
        """Whether a second has passed since the last check; a tenth, where pulses are fired.
        `room_ns`: until the next scan; None: no frame is shown. A scan that would be late for it
        goes first, once.
        """
        if self.limitations:
            return False
        if now_ns - self.checked_ns >= PERIOD_NS:
            return True
        if room_ns is None or not self._has_latch:
            return False
        since_ns = now_ns - self._exposed_ns
        return since_ns >= (LATCH_PERIOD_NS if room_ns >= _TAKES_NS else 2 * LATCH_PERIOD_NS)

    def check(self, now_ns: int) -> BoardFault | None:
        """Between two pulses, with the outputs blanked. Returns what is wrong with the source, or
        with what is connected to it.

        Raises: BusError, GuardRefusal; BoardFault for a message or samples that are not valid.
        """
        is_whole = now_ns - self.checked_ns >= PERIOD_NS
        if is_whole:
            self.checked_ns = now_ns
        self._exposed_ns = now_ns
        if self.limitations:
            return None
        self._board.isolate()
        fault = self._blanked() if is_whole else None
        if fault is not None or not self._has_latch:
            return fault
        fault = self._exposed()
        if fault is not None and not is_whole:
            # Which of the two it is: a source that is wrong is so without an electrode as well.
            fault = self._blanked() or fault
        return fault

    def _probe(self, current_ua: int) -> tuple[Pulse, PulseRequest]:
        given = PulseRequest(current_ua, self._maxima.now.probe_width_us)
        return self._board.pulse(given.current_ua, given.width_us), given

    def _blanked(self) -> BoardFault | None:
        """At each current, up to the first that is wrong."""
        for current_ua in self._blanked_ua:
            pulse, given = self._probe(current_ua)
            result = self._firing.fire_unloaded(pulse, given)
            fault = self._board.rules.unloaded_fault(
                pulse.commanded_ua, result.baseline_v, result.early_v, result.voltage_v
            )
            if fault is not None:
                return fault
        return None

    def _exposed(self) -> BoardFault | None:
        pulse, given = self._probe(self._current_ua)
        result = self._firing.fire_unselected(pulse, given)
        return self._board.rules.unselected_fault(
            pulse.commanded_ua, result.early_v, result.voltage_v
        )
