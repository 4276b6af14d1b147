"""The guard's shadow of the switch: its state after the levels sent so far.

Owns: a decoding of register, latch and polarity from single line changes, typed apart from the
drivers in `chips/`; the rules for GPIO; the comparison of the selection with what was approved.
Must not know: currents, messages, how a selection was made.

Rules: never BL 0 with POL 0 while the supply may be on; never a shift into live outputs; relays:
never both of one output, never from one word to another without all being open in between, for
as long as that takes.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from etd_hal.boardfile import HalfBridges, Relays
from etd_hal.errors import GuardRefusal
from etd_hal.ports import Changes, Clock


class Prepulse(NamedTuple):
    """A weaker step directly before a pulse, in the same message."""

    current_ua: int
    width_us: int


#: Of an approval, all but its outputs; the last: whether it reaches any.
Figures = tuple[int, int, Prepulse | None, bool]


class Approval:
    """What the limits let through for the next pulse, step by step.

    `source` and `ground` are bit sets of outputs; for half-bridges all others are on the side
    opposite to the selected output.
    """

    __slots__ = ("current_ua", "figures", "ground", "is_blanked", "prepulse", "source", "width_us")

    def __init__(
        self,
        source: int,
        ground: int,
        current_ua: int,
        width_us: int,
        prepulse: Prepulse | None = None,
        is_blanked: bool = False,
    ) -> None:
        self.source: Final = source
        self.ground: Final = ground
        self.current_ua: Final = current_ua
        self.width_us: Final = width_us
        self.prepulse: Final = prepulse
        #: A probe while nothing is connected, which must reach no electrode: `source` and `ground`
        #: are the outputs that would get it if the switches failed to open. 0: no output is
        #: selected. A `source` of 0 without it is a probe with all outputs on ground.
        self.is_blanked: Final = is_blanked
        reaches_any = bool(source) and not is_blanked
        self.figures: Final[Figures] = (current_ua, width_us, prepulse, reaches_any)


class HalfBridgeShadow:
    """The state of an HV507 or a chain of HV513 after the levels sent so far."""

    def __init__(self, switch: HalfBridges, hv: tuple[int, int] | None) -> None:
        lines = switch.lines
        self._data, self._clk = lines.DATA, lines.CLK
        self._le, self._bl, self._pol = lines.LE, lines.BL, lines.POL
        self._hv = hv
        self._outputs = switch.outputs
        self._full = (1 << switch.outputs) - 1
        #: How often a line has changed: between two equal readings nothing has moved.
        self.edge_count = 0
        #: By how much a flip, a change of POL, raises `switched`.
        self.switched_by_flip = 1
        self._watched = {self._data, self._clk, self._le, self._bl, self._pol}
        self._level: dict[int, int] = {}
        #: By call, its changes of watched lines in the order of lines: the drivers repeat a few.
        self._ordered: dict[Changes, list[tuple[int, int]]] = {}
        if hv is not None:
            self._watched.add(hv[0])
            self._level[hv[0]] = 1 - hv[1]
        self.reset(())

    def reset(self, levels: Changes) -> None:
        """The start, and after safe_off: register and latch unknown, outputs blanked. The supply is
        off at the start, and later where the levels say so.

        CLK counts as high, so that only a rise that surely was one shifts the picture.
        """
        known = {self._data: 0, self._clk: 1, self._le: 0, self._bl: 0, self._pol: 1}
        self._level.update(known)
        self._level.update({line: value for line, value in levels if line in self._watched})
        self._register = 0
        self._unknown_stages = self._outputs
        self._latch = 0
        self._is_latch_known = False

    @property
    def switched(self) -> int:
        """How often what is connected may have changed: each move of a line counts."""
        return self.edge_count

    def follow(self, changes: Changes) -> None:
        """The changes of one call, in the order in which the lines will change.

        Raises: GuardRefusal before anything is sent.
        """
        level, ordered = self._level, self._ordered.get(changes)
        if ordered is None:
            ordered = self._order(changes)
        for line, value in ordered:
            if level[line] == value:
                continue
            level[line] = value
            self.edge_count += 1
            if line == self._clk:
                if value:
                    self._shift()
            elif line == self._le:
                if value:
                    self._open_latch()
            elif line != self._data:
                self._check_blanking(line, 1 - value)

    def _order(self, changes: Changes) -> list[tuple[int, int]]:
        watched = [change for change in changes if change[0] in self._watched]
        ordered = self._ordered[changes] = sorted(watched)
        return ordered

    def _shift(self) -> None:
        level = self._level
        is_open = level[self._le]
        if is_open and level[self._bl]:
            raise GuardRefusal("shift", "clock with latch open and outputs live", "blank first")
        self._register = (self._register << 1 | level[self._data]) & self._full
        if self._unknown_stages:
            self._unknown_stages -= 1
        if is_open:
            self._open_latch()

    def _open_latch(self) -> None:
        if self._level[self._bl]:
            raise GuardRefusal("latch", "opened while outputs are live", "blank first")
        self._latch = self._register
        self._is_latch_known = self._unknown_stages == 0

    def _check_blanking(self, line: int, was: int) -> None:
        level = self._level
        is_supplied = self._hv is None or level[self._hv[0]] == self._hv[1]
        if is_supplied and not level[self._bl] and not level[self._pol]:
            level[line] = was
            raise GuardRefusal("blanking", "BL 0 with POL 0: all outputs high", "POL 1 first")

    def check_selection(self, approval: Approval) -> None:
        """Check: one output alone, all others opposite, exactly as approved."""
        level = self._level
        if approval.is_blanked:
            self._check_blanked(approval)
            return
        if not level[self._bl] or level[self._le]:
            raise GuardRefusal("switch", "blanked, or its latch is open", "closed and un-blanked")
        if not self._is_latch_known:
            raise GuardRefusal("switch", "register not wholly written", "rewrite the chain")
        if not approval.source:
            if self._latch or not level[self._pol]:
                raise GuardRefusal("switch", f"{self._latch:x} selected", "none, with POL 1")
            return
        high = self._latch if level[self._pol] else ~self._latch & self._full
        low = ~high & self._full
        if self._latch.bit_count() != 1 or not high or not low:
            raise GuardRefusal(
                "switch", f"{self._latch.bit_count()} outputs selected", "one against all others"
            )
        if high != approval.source or low != approval.ground:
            raise GuardRefusal(
                "switch", f"outputs {high:x} on source", f"{approval.source:x} was approved"
            )

    def _check_blanked(self, approval: Approval) -> None:
        """Check: all outputs on ground, and behind the blanking exactly the approved one, or none
        if none was approved.
        """
        if self._level[self._bl] or not self._level[self._pol]:
            raise GuardRefusal("switch", "not blanked to ground", "BL 0 with POL 1")
        is_approved = self._latch.bit_count() <= 1 and self._latch == approval.source
        if not self._is_latch_known or not is_approved:
            raise GuardRefusal(
                "switch", f"{self._latch:x} behind the blanking", f"{approval.source:x} alone"
            )


class RelayShadow:
    """The state of a chain of 74HC595 and their relays after the levels sent so far."""

    def __init__(self, switch: Relays, clock: Clock) -> None:
        self._switch = switch
        self._clock = clock
        self._data, self._clk, self._le = switch.lines.DATA, switch.lines.CLK, switch.lines.LE
        self._stages = switch.outputs * 2
        self._full = (1 << self._stages) - 1
        #: How often a line has changed: between two equal readings nothing has moved.
        self.edge_count = 0
        #: How often what is connected may have changed: each copy to the relays counts. A flip
        #: opens all, and closes the reverse.
        self.switched = 0
        self.switched_by_flip = 2
        self._pairs = sum(1 << stage for stage in range(0, self._stages, 2))
        self.reset(())

    def reset(self, levels: Changes) -> None:
        """The start, and after safe_off: nothing is known; relays may be closed.

        CLK and LE count as high, so that only a rise that surely was one counts.
        """
        self._level = {self._data: 0, self._clk: 1, self._le: 1}
        self._level.update({line: value for line, value in levels if line in self._level})
        self._register = 0
        self._unknown_stages = self._stages
        self._latch: int | None = None
        self._copied_ns = self._clock.now_ns()

    def follow(self, changes: Changes) -> None:
        """The changes of one call, in the order in which the lines will change.

        Raises: GuardRefusal before anything is sent.
        """
        for line, value in sorted(changes):
            was = self._level.get(line)
            if was is None or was == value:
                continue
            self._level[line] = value
            self.edge_count += 1
            if value and line == self._clk:
                self._register = (self._register << 1 | self._level[self._data]) & self._full
                self._unknown_stages = max(0, self._unknown_stages - 1)
            elif value and line == self._le:
                self._copy()

    def _copy(self) -> None:
        word = self._register
        if self._unknown_stages:
            raise GuardRefusal("relays", "a word not wholly shifted", "shift the whole chain")
        if word & (word >> 1) & self._pairs:
            raise GuardRefusal("relays", "both relays of one electrode", "one of them")
        now_ns = self._clock.now_ns()
        if word and self._latch != word:
            self._check_break(now_ns - self._copied_ns)
        self._latch = word
        self._copied_ns = now_ns
        self.switched += 1

    def _check_break(self, waited_ns: int) -> None:
        if self._latch != 0:
            raise GuardRefusal("relays", "made before broken", "open all in between")
        if waited_ns < self._switch.toff_us * 1_000:
            raise GuardRefusal(
                "relays",
                f"made {waited_ns // 1_000} us after breaking",
                f"{self._switch.toff_us} us or later",
            )

    def check_selection(self, approval: Approval) -> None:
        """Check: closed long enough, one output alone on its side, exactly as approved."""
        waited_ns = self._clock.now_ns() - self._copied_ns
        if approval.is_blanked:
            if self._latch != 0 or waited_ns < self._switch.toff_us * 1_000:
                raise GuardRefusal("relays", "not all open", "all open, and settled")
            return
        if not self._latch or waited_ns < self._switch.ton_us * 1_000:
            raise GuardRefusal("relays", "not settled", f"{self._switch.ton_us} us after closing")
        source = self._side(self._latch, self._switch.on_bit)
        ground = self._side(self._latch, self._switch.return_bit)
        if min(source.bit_count(), ground.bit_count()) != 1:
            raise GuardRefusal("relays", "no output alone on its side", "one against its returns")
        if source != approval.source or ground != approval.ground:
            raise GuardRefusal(
                "relays",
                f"outputs {source:x} on source, {ground:x} on ground",
                f"{approval.source:x} and {approval.ground:x} were approved",
            )

    def _side(self, word: int, bit: int) -> int:
        """Every second bit, packed: bit i for output i."""
        return sum(
            (word >> (2 * output + bit) & 1) << output for output in range(self._switch.outputs)
        )


SwitchShadow = HalfBridgeShadow | RelayShadow
