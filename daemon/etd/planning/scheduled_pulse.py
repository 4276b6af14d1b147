"""The pulse of one electrode of a frame: plans make it, schedules hold it.

Owns: the struct that plan, scan rate, schedule and engine share. Must not know: how it was planned,
when it is fired, how much of it is fired.
"""

from __future__ import annotations

from typing import Final

from etd.planning.headroom import pc_of
from etd.pulse.request import PulseBounds, PulseRequest
from etd.safety.limits import Path
from etd_hal.selection import Selection


class ScheduledPulse:
    """The pulse of one electrode of a frame, fired once a scan or less often.

    `returns` None means all others; then what these allow is decided at each pulse.
    """

    __slots__ = (
        "_probe_pc",
        "bounds",
        "electrode",
        "path",
        "phases",
        "probe",
        "rate_hz",
        "request",
        "returns",
        "selection",
    )

    def __init__(
        self,
        electrode: int,
        selection: Selection,
        request: PulseRequest,
        phases: tuple[bool, ...],
        rate_hz: float,
        returns: tuple[int, ...] | None,
        path: Path,
        bounds: PulseBounds,
        probe: PulseRequest | None = None,
    ) -> None:
        self.electrode: Final = electrode
        self.selection: Final = selection
        #: The frame's own request.
        self.request: Final = request
        self.phases: Final = phases
        self.rate_hz: Final = rate_hz
        self.returns: Final = returns
        self.path: Final = path
        #: The bounds of what stabilizers may request; its slot in the scan is this wide.
        self.bounds: Final = bounds
        #: The probe directly before its pulse; charge and time of the probe are planned for.
        self.probe: Final = probe
        self._probe_pc: Final = 0 if probe is None else pc_of(probe)

    @property
    def probe_pc(self) -> int:
        """The charge of the probe before each pulse."""
        return self._probe_pc

    @property
    def current_ua(self) -> int:
        return self.request.current_ua

    @property
    def width_us(self) -> int:
        return self.request.width_us

    def within(self, widest_us: int) -> ScheduledPulse:
        """The same pulse, with stabilizers bounded to `widest_us`, prepulse included."""
        width_us = min(self.bounds.width_us, widest_us - self.bounds.prepulse_us)
        return self._bounded(self.bounds.no_wider(width_us))

    def lowered_to(self, newer: ScheduledPulse | None) -> ScheduledPulse | None:
        """What is left of this pulse in a scan under way when a newer frame asks for `newer` (None:
        silence). What does not fall stays, and a rise waits for the next scan; no stabilizer may
        request more than for the newer pulse. None, no pulse, where the newer one is lower in one
        part and not in all: the two cannot be combined.
        """
        if newer is None or newer is self:
            return newer
        falls = newer.current_ua < self.current_ua or newer.width_us < self.width_us
        rises = newer.current_ua > self.current_ua or newer.width_us > self.width_us
        if not falls:
            return self._bounded(self.bounds.not_above(newer.bounds))
        if rises or (newer.phases, newer.returns) != (self.phases, self.returns):
            return None
        bounds = newer.bounds.not_above(self.bounds)
        return newer._bounded(bounds, self.rate_hz)

    def _bounded(self, bounds: PulseBounds, rate_hz: float | None = None) -> ScheduledPulse:
        """The same pulse, with these bounds of what stabilizers may request."""
        return ScheduledPulse(
            self.electrode,
            self.selection,
            self.request,
            self.phases,
            self.rate_hz if rate_hz is None else rate_hz,
            self.returns,
            self.path,
            bounds,
            self.probe,
        )
