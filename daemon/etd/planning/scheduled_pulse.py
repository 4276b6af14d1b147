"""One electrode of a frame, ready to be visited: what a plan makes and a scan goes through.

Owns: the one struct that plan, pace, scan and visits share. Must not know: how it came about, when
it is visited, what becomes of it there.
"""

from __future__ import annotations

import msgspec
from msgspec.structs import replace

from etd.planning.headroom import pc_of
from etd.safety.limits import Path
from etd.stabilize.pipeline import PulseBounds, PulseRequest
from etd_hal.selection import Selection


class ScheduledPulse(msgspec.Struct, frozen=True):
    """One electrode of a frame, ready to be visited once a scan or less often.

    `returns` None means all others; then the path's share is decided at each visit.
    """

    electrode: int
    selection: Selection
    #: What the frame itself asks for.
    request: PulseRequest
    phases: tuple[bool, ...]
    rate_hz: float
    returns: tuple[int, ...] | None
    path: Path
    #: What stabilizers may make of it at the most; its slot in the scan is this wide.
    bounds: PulseBounds
    #: What goes before its pulse, in the same visit; its charge and its time are planned for.
    probe: PulseRequest | None = None

    @property
    def probe_pc(self) -> int:
        """The charge that goes before each of its pulses."""
        return pc_of(self.probe)

    @property
    def current_ua(self) -> int:
        return self.request.current_ua

    @property
    def width_us(self) -> int:
        return self.request.width_us

    def within(self, widest_us: int) -> ScheduledPulse:
        """The same, with no more room for stabilizers than such a pulse, all steps together."""
        width_us = min(self.bounds.width_us, widest_us - self.bounds.prepulse_us)
        return replace(self, bounds=replace(self.bounds, width_us=width_us))

    def lowered_to(self, newer: ScheduledPulse | None) -> ScheduledPulse | None:
        """What is left of it in a scan under way when a newer frame has come, which asks for
        `newer` (None: silence). What has not fallen stays, and its rise waits for the next scan; no
        law makes more of it than of the newer one. A pulse that fell in one part and not in all
        cannot be made of the two: None, none.
        """
        if newer is None:
            return None
        falls = newer.current_ua < self.current_ua or newer.width_us < self.width_us
        rises = newer.current_ua > self.current_ua or newer.width_us > self.width_us
        if not falls:
            return replace(self, bounds=self.bounds.not_above(newer.bounds))
        if rises or (newer.phases, newer.returns) != (self.phases, self.returns):
            return None
        return replace(newer, rate_hz=self.rate_hz, bounds=newer.bounds.not_above(self.bounds))
