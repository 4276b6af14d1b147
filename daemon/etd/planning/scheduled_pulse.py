"""The pulse of one electrode of a frame: plans make it, schedules hold it.

Owns: the struct that plan, scan rate, schedule and engine share. Must not know: how it was planned,
when it is fired, how much of it is fired.
"""

from __future__ import annotations

import msgspec
from msgspec.structs import replace

from etd.planning.headroom import pc_of
from etd.pulse.request import PulseBounds, PulseRequest
from etd.safety.limits import Path
from etd_hal.selection import Selection


class ScheduledPulse(msgspec.Struct, frozen=True, gc=False):
    """The pulse of one electrode of a frame, fired once a scan or less often.

    `returns` None means all others; then what these allow is decided at each pulse.
    """

    electrode: int
    selection: Selection
    #: The frame's own request.
    request: PulseRequest
    phases: tuple[bool, ...]
    rate_hz: float
    returns: tuple[int, ...] | None
    path: Path
    #: The bounds of what stabilizers may request; its slot in the scan is this wide.
    bounds: PulseBounds
    #: The probe directly before its pulse; charge and time of the probe are planned for.
    probe: PulseRequest | None = None

    @property
    def probe_pc(self) -> int:
        """The charge of the probe before each pulse."""
        return 0 if self.probe is None else pc_of(self.probe)

    @property
    def current_ua(self) -> int:
        return self.request.current_ua

    @property
    def width_us(self) -> int:
        return self.request.width_us

    def within(self, widest_us: int) -> ScheduledPulse:
        """The same pulse, with stabilizers bounded to `widest_us`, prepulse included."""
        width_us = min(self.bounds.width_us, widest_us - self.bounds.prepulse_us)
        return replace(self, bounds=replace(self.bounds, width_us=width_us))

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
            return replace(self, bounds=self.bounds.not_above(newer.bounds))
        if rises or (newer.phases, newer.returns) != (self.phases, self.returns):
            return None
        return replace(newer, rate_hz=self.rate_hz, bounds=newer.bounds.not_above(self.bounds))
