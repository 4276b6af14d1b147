"""The source's gain and the latch of the switches, checked with no electrode on the source.

Owns: when a check is due, and its pulses. Must not know: what the node may read
(`etd_hal.source_rules`), scans, states, what follows from a fault.

Skin takes a part of the current, so that a source with a wrong gain looks like other skin: what
the node reads in a pulse tells it only where it is above current x leak (`node_check.py`). With
nothing connected the node is current x leak. So before each arming, and each second, a pulse is
fired with all outputs blanked; see docs/decisions/0038.

A latch that does not take over what is shifted sends the pulses of all electrodes to one. So after
that, and each tenth of a second while armed, a pulse is fired with the outputs live and
none selected: it must read the same; see docs/decisions/0078.

The first pulse is a third of a probe, as in a self-test: a source that makes three times what it is
told is still within the probe's bound. A source that is wrong above some current only passes that.
So the whole probe follows, with the outputs blanked. Between two scans there is time for one
message: while armed the pulses with the outputs live tell of a third of a probe, so the blanked one
of that is left out, and the others come one by one.
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
        whole_ua = maxima.now.probe_current_ua
        self._part_ua = whole_ua // _PART
        #: When the last one began; 0 before the first.
        self.checked_ns = self._exposed_ns = 0
        self._has_latch = board.can_fire_unselected
        #: A frame is, so that another scan follows.
        self._is_shown = False
        why = self._why_untold(self._part_ua)
        #: Where the board's figures allow no check: the sentence that says so.
        self.limitations: tuple[str, ...] = ()
        if why is not None:
            self.limitations = (f"the source is not checked while armed: {why}",)
        #: None: the node would come higher than can be read.
        self._whole_ua = None if self._why_untold(whole_ua) else whole_ua

    def _why_untold(self, current_ua: int) -> str | None:
        source = self._board.file.source
        commanded_ua = source.current_of(source.code_for(current_ua))
        return self._board.rules.why_untold(int(commanded_ua))

    def is_due(self, now_ns: int, room_ns: int | None, *, is_ready: bool = True) -> bool:
        """Whether a second has passed since the last check; a tenth, of the latch. `room_ns`: until
        the next scan, 0 where it waits for an edge; None: no frame is shown. A scan that would be
        late for it goes first, once: so does the first of a frame, since the latch is looked at in
        silence as well. And so does one for which the chain has been rewritten (not `is_ready`): to
        shift zeros in would take as long as the message.
        """
        self._is_shown = room_ns is not None
        if self.limitations:
            return False
        if room_ns is not None and room_ns < _TAKES_NS and not is_ready:
            return False
        if now_ns - self.checked_ns >= PERIOD_NS:
            return True
        if not self._has_latch:
            return False
        is_late = room_ns is not None and room_ns < _TAKES_NS
        return now_ns - self._exposed_ns >= (2 if is_late else 1) * LATCH_PERIOD_NS

    def check(self, now_ns: int, *, is_before_arming: bool = False) -> BoardFault | None:
        """Between two pulses, with the outputs blanked. Returns what is wrong with the source, or
        with what is connected to it.

        Raises: BusError, GuardRefusal; BoardFault for a message or samples that are not valid.
        """
        is_whole = is_before_arming or now_ns - self.checked_ns >= PERIOD_NS
        if is_whole:
            self.checked_ns = now_ns
        if self.limitations:
            return None
        self._board.isolate()
        fault = self._blanked(is_before_arming) if is_whole else None
        # Between two scans there is time for one message; that with the outputs live comes soon.
        is_alone = is_whole and self._is_shown and not is_before_arming
        if fault is not None or not self._has_latch or is_alone:
            return fault
        self._exposed_ns = now_ns
        fault = self._exposed()
        if fault is not None and not is_whole:
            # Which of the two it is: a source that is wrong is so without an electrode as well.
            fault = self._unloaded(self._part_ua) or fault
        return fault

    def _probe(self, current_ua: int) -> tuple[Pulse, PulseRequest]:
        given = PulseRequest(current_ua, self._maxima.now.probe_width_us)
        return self._board.pulse(given.current_ua, given.width_us), given

    def _blanked(self, is_before_arming: bool) -> BoardFault | None:
        """A third of a probe, where nothing has told of it lately, and the whole."""
        is_told = self._has_latch and not is_before_arming and self._whole_ua is not None
        fault = None if is_told else self._unloaded(self._part_ua)
        if fault is not None or self._whole_ua is None:
            return fault
        return self._unloaded(self._whole_ua)

    def _unloaded(self, current_ua: int) -> BoardFault | None:
        pulse, given = self._probe(current_ua)
        result = self._firing.fire_unloaded(pulse, given)
        return self._board.rules.unloaded_fault(
            pulse.commanded_ua, result.baseline_v, result.early_v, result.voltage_v
        )

    def _exposed(self) -> BoardFault | None:
        pulse, given = self._probe(self._part_ua)
        result = self._firing.fire_unselected(pulse, given)
        return self._board.rules.unselected_fault(
            pulse.commanded_ua, result.baseline_v, result.early_v, result.voltage_v
        )
