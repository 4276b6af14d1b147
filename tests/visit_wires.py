"""The rule of visits with the watch that it goes by, moved line by line.

Owns: what a rule is told, and what room it leaves to an output. Must not know: what is a visit.
"""

from __future__ import annotations

from board_rig import machine_file
from etd_hal.boardfile import HalfBridges
from etd_hal.errors import GuardRefusal
from etd_hal.switch_shadow import Approval, HalfBridgeShadow
from etd_hal.visitrule import VisitRule, longest_flip_ns
from stepped_board import shipped_board

MS = 1_000_000
SECOND_NS = 1_000 * MS
RATE_HZ = 3
HALF_BRIDGES, RELAYS = "kajimoto-hv507", "feetthrough-relay"
#: What is sent is told to last so long, at worst.
LONGEST_US = 130.0
FLIP_NS = longest_flip_ns(shipped_board(HALF_BRIDGES), machine_file())


class Wires:
    """The rule, and the watch that it goes by, moved line by line."""

    def __init__(self) -> None:
        switch = shipped_board(HALF_BRIDGES).switch
        assert isinstance(switch, HalfBridges)
        self.lines = switch.lines
        self.watch = HalfBridgeShadow(switch, None)
        self.rule = VisitRule(RATE_HZ, FLIP_NS, self.watch)
        self.watch.follow(((self.lines.BL, 1),))
        self.now_ns = 7 * SECOND_NS
        self.pol = 1

    def flip(self) -> None:
        self.pol = 1 - self.pol
        self.watch.follow(((self.lines.POL, self.pol),))

    def let_go(self) -> None:
        """Blanked, and un-blanked again as it was."""
        for line, value in (
            *((self.lines.POL, 1), (self.lines.BL, 0)),
            *((self.lines.BL, 1), (self.lines.POL, self.pol)),
        ):
            self.watch.follow(((line, value),))

    def send(
        self, source: int, ground: int, *, is_probe: bool = False, is_blanked: bool = False
    ) -> None:
        approval = Approval(source, ground, 1_000, 100, is_blanked=is_blanked)
        self.rule.take(approval, LONGEST_US, 100.0, is_probe, self.now_ns)

    def room(self, output: int) -> int:
        """How many visits an output may still have now; afterwards it has none."""
        for found in range(RATE_HZ + 1):
            try:
                # Blanked ones begin a visit, whatever was before.
                self.send(1 << output, 1 << 40 | 1 << 41, is_blanked=True)
            except GuardRefusal:
                return found
        raise AssertionError("more than the rate")
