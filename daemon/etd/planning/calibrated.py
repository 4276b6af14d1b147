"""What the calibrations of a lease say of a frame: currents of levels, polarities, caps.

Owns: which calibration holds for an electrode's pulse, by its polarity, and the refusals where none
does. Must not know: schedules, rates of scans, hardware, what was felt.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from etd.protocol.calibration import (
    Calibration,
    check_conditions_of_levels,
    check_shape_of_caps,
    check_shape_of_levels,
    currents_of_levels,
)
from etd.protocol.calibration_set import check_covered, currents_of_mixed_levels
from etd.protocol.errors import Refused
from etd.protocol.frame import PHASES, Frame, Polarity
from etd.safety.limits import PersonLimits
from etd.stabilize.shape import Shape


class Calibrated:
    """Made once per lease, for its person and the shape that the body site makes of pulses."""

    def __init__(self, person: PersonLimits, shape: Shape) -> None:
        #: The first one; all conditions but the polarity are those of the others as well.
        self.first: Final = person.calibration
        self._others = person.others
        self._shape = shape
        self._caps_ua = person.caps_ua
        #: By the phases of a pulse: only where each polarity has caps of its own.
        self._own_caps_ua: dict[tuple[bool, ...], tuple[int, ...]] = {
            PHASES[polarity]: caps_ua for polarity, caps_ua in person.own_caps_ua.items()
        }

    def currents_ua(
        self, frame: Frame, polarities: Sequence[Polarity], most_hz: float
    ) -> Sequence[int]:
        """The frame's current at each electrode. `polarities`: those of its pulses; `most_hz`: the
        highest rate here. Raises: Refused.
        """
        if frame.level is None:
            wanted_ua: Sequence[int] = frame.current_ua or ()
            if self._others:
                check_covered(self._all(), wanted_ua, polarities)
        else:
            wanted_ua = self._of_levels(frame, frame.level, polarities, most_hz)
        if self.first is not None and any(wanted_ua):
            # That of the others is the same.
            check_shape_of_caps(self.first, self._shape)
        return wanted_ua

    def _of_levels(
        self,
        frame: Frame,
        levels: Sequence[float],
        polarities: Sequence[Polarity],
        most_hz: float,
    ) -> tuple[int, ...]:
        first = self.first
        if first is None:
            raise Refused(
                "level_needs_calibration",
                "level needs a calibration: open the lease with one, or send current_ua",
            )
        check_conditions_of_levels(first, frame, most_hz, self._others)
        check_shape_of_levels(first, self._shape)
        if self._others:
            return currents_of_mixed_levels(self._all(), levels, polarities)
        return currents_of_levels(first, levels)

    def cap_ua(self, electrode: int, phases: tuple[bool, ...]) -> int:
        """That of the electrode where it is stimulated with these phases. As a return it has the
        smallest of its caps.
        """
        return self._own_caps_ua.get(phases, self._caps_ua)[electrode]

    def _all(self) -> tuple[Calibration, ...]:
        return self._others if self.first is None else (self.first, *self._others)
