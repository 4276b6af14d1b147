"""One electrode of a frame, ready to be visited: what a plan makes and a scan goes through.

Owns: the one struct that plan, pace, scan and visits share. Must not know: how it came about, when
it is visited, what becomes of it there.
"""

from __future__ import annotations

import msgspec
from msgspec.structs import replace

from etd.engine.limits import Path
from etd.engine.room import pc_of
from etd.stabilize.pipeline import Most, Wish
from etd_hal.selection import Selection


class Visit(msgspec.Struct, frozen=True):
    """One electrode of a frame, ready to be visited once a scan or less often.

    `returns` None means all others; then the path's share is decided at each visit.
    """

    electrode: int
    selection: Selection
    #: What the frame itself asks for.
    wish: Wish
    phases: tuple[bool, ...]
    rate_hz: float
    returns: tuple[int, ...] | None
    path: Path
    #: What stabilizers may make of it at the most; its slot in the scan is this wide.
    most: Most
    #: What goes before its pulse, in the same visit; its charge and its time are planned for.
    probe: Wish | None = None

    @property
    def probe_pc(self) -> int:
        """The charge that goes before each of its pulses."""
        return pc_of(self.probe)

    @property
    def current_ua(self) -> int:
        return self.wish.current_ua

    @property
    def width_us(self) -> int:
        return self.wish.width_us

    def within(self, widest_us: int) -> Visit:
        """The same, with no more room for stabilizers than such a pulse, all steps together."""
        width_us = min(self.most.width_us, widest_us - self.most.prepulse_us)
        return replace(self, most=replace(self.most, width_us=width_us))

    def lowered_to(self, newer: Visit | None) -> Visit | None:
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
            return replace(self, most=self.most.not_above(newer.most))
        if rises or (newer.phases, newer.returns) != (self.phases, self.returns):
            return None
        return replace(newer, rate_hz=self.rate_hz, most=newer.most.not_above(self.most))
