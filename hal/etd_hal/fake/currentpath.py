"""From the DAC's code to the skin: source, one-shot, switch, body, and the ADC's divider.

Owns: what flows at each instant, and the body's own account of each phase of a pulse.
Must not know: buses, words, registers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from etd_body.interface import Body, Side, Sides
from etd_hal.boardfile import BoardFile
from etd_hal.fake.faults import (
    AdcBitStuck,
    AdcScale,
    AdcStuck,
    DacGain,
    DacOffset,
    DacStuck,
    GainAbove,
    Overshoot,
    Saturation,
    SourceShort,
)
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.rail import Rail
from etd_hal.fake.trace import Trace

_CACHED_SELECTIONS = 4_096
#: While a current flows, the body hears of its rail as often.
_RAIL_STEP_NS = 500_000
#: Of a source that is short: more than anything connected can take of any rail; and how often what
#: is really taken is looked at, since that empties a supply which was switched off.
_SHORT_UA = 1e9
_SHORT_STEP_NS = 100_000


@dataclass(frozen=True, slots=True)
class _Phase:
    electrode: int
    direction: int
    from_ns: int
    code: int
    charge_pc: float


class CurrentPath:
    def __init__(
        self,
        board: BoardFile,
        body: Body,
        rail: Rail,
        faults: Faults,
        trace: Trace,
        sides: Sides,
        settle_switch: Callable[[int], None],
    ) -> None:
        self._source = board.source
        one_shot = board.guards.one_shot
        self._one_shot_ns = None if one_shot == "absent" else one_shot.on_us * 1_000
        self._body = body
        self._rail = rail
        self._faults = faults
        self._trace = trace
        self._sides = sides
        self._settle_switch = settle_switch
        self._compliance_v = -1.0
        self._drawn_ua = 0.0
        self._is_short = False
        #: By electrode, when a source that is short was looked at last.
        self._taken_pc: list[float] = []
        #: Up to when the body has heard of the rail.
        self._supplied_ns = 0
        self._cut_at_ns: int | None = None
        self._cut = False
        #: Until then a source with an `Overshoot` makes more.
        self._overshoots_until_ns: int | None = None
        #: The body has heard of the last change; a call that was broken off leaves it ignorant.
        self._is_driven = True
        #: Which faults the body has heard of.
        self._fault_changes = faults.changes
        self._phase: _Phase | None = None
        self._selections: dict[int, tuple[Sides, tuple[int, int] | None]] = {}
        self.code = 0
        #: The latest time that the body has heard of.
        self.reached_ns = 0
        #: A relay board's two relays of one electrode are both closed: the node is on ground.
        self.shorted = False

    def set_code(self, t_ns: int, code: int) -> None:
        """The DAC's output changes."""
        self.settle(t_ns)
        if code == self.code and self._is_driven:
            return
        if self._one_shot_ns is not None and not self.code:
            self._cut_at_ns = t_ns + self._one_shot_ns
        if not code:
            self._cut_at_ns, self._cut, self._overshoots_until_ns = None, False, None
        elif not self.code:
            for shoots in self._faults.of(Overshoot):
                self._overshoots_until_ns = t_ns + int(shoots.until_us * 1_000)
        self.code = code
        self._drive(t_ns)
        self._close_phase(t_ns)
        self._open_phase(t_ns)

    def set_sides(self, t_ns: int, sides: Sides, shorted: bool = False) -> None:
        """The switch connects the electrodes differently."""
        self.settle(t_ns)
        self._sides = sides
        self.shorted = shorted
        self._drive(t_ns)

    def node_code(self, t_ns: int) -> int:
        """What the ADC makes of the source's node at `t_ns`."""
        self.settle(t_ns)
        self._follow_rail(t_ns)
        volts = 0.0 if self.shorted else self._body.node_voltage_v(t_ns)
        for scale in self._faults.of(AdcScale):
            volts *= scale.factor
        noise = self._faults.adc_noise()
        code = round(volts * 1_000_000 / self._source.node_uv_per_code + noise)
        for stuck in self._faults.of(AdcStuck):
            code = stuck.code
        code = min(max(code, 0), self._source.adc_codes - 1)
        for stands in self._faults.of(AdcBitStuck):
            code = code & ~(1 << stands.bit) | stands.level << stands.bit
        return code

    def settle(self, t_ns: int) -> None:
        """What went on by itself until `t_ns`: relays on their way, the one-shot's end, faults that
        came or went.
        """
        if self.reached_ns < t_ns:
            self.reached_ns = t_ns
        self._settle_switch(t_ns)
        if self._overshoots_until_ns is not None and t_ns >= self._overshoots_until_ns:
            at_ns, self._overshoots_until_ns = self._overshoots_until_ns, None
            self._drive(at_ns)
        if self._cut_at_ns is not None and t_ns >= self._cut_at_ns:
            at_ns, self._cut_at_ns, self._cut = self._cut_at_ns, None, True
            self._drive(at_ns)
        if self._fault_changes != self._faults.changes:
            self._fault_changes = self._faults.changes
            self._drive(t_ns)
        if self._drawn_ua > 0.0:
            self._follow_rail(t_ns)

    def _drive(self, t_ns: int) -> None:
        self._is_driven = False
        self._follow_rail(t_ns)
        self._is_short = bool(self._faults.of(SourceShort))
        idle = self.shorted or (self._cut and not self._is_short)
        self._drawn_ua = 0.0 if idle else _SHORT_UA if self._is_short else self._current_ua()
        if not self._is_short:
            self._rail.load(t_ns, self._drawn_ua)
        self._body.drive(t_ns, self._drawn_ua, self._sides)
        self._is_driven = True

    def _current_ua(self) -> float:
        """What the source really makes of the code."""
        if not self._faults.are_there:
            return self.code * self._source.full_scale_ua / (self._source.codes - 1)
        code = next((stuck.code for stuck in self._faults.of(DacStuck)), self.code)
        current_ua = code * self._source.full_scale_ua / (self._source.codes - 1)
        for gain in self._faults.of(DacGain):
            current_ua *= gain.factor
        for above in self._faults.of(GainAbove):
            current_ua *= above.factor if code > above.code else 1.0
        for shoots in self._faults.of(Overshoot):
            current_ua *= 1.0 if self._overshoots_until_ns is None else shoots.factor
        for most in self._faults.of(Saturation):
            current_ua = min(current_ua, most.current_ua)
        return current_ua + sum(offset.offset_ua for offset in self._faults.of(DacOffset))

    def _follow_rail(self, t_ns: int) -> None:
        """The source reaches as far as its rail, whatever the board file says of either."""
        step_ns = _SHORT_STEP_NS if self._is_short else _RAIL_STEP_NS
        while self._drawn_ua > 0.0 and self._supplied_ns + step_ns < t_ns:
            self._supply(self._supplied_ns + step_ns)
        self._supply(t_ns)

    def _supply(self, t_ns: int) -> None:
        if self._is_short:
            self._load_as_taken(t_ns)
        self._supplied_ns = t_ns
        compliance_v = self._rail.volts(t_ns)
        if compliance_v != self._compliance_v:
            self._body.supply(t_ns, compliance_v)
            self._compliance_v = compliance_v

    def _load_as_taken(self, t_ns: int) -> None:
        """What a source that is short draws is what went through the skin since the last look."""
        if t_ns <= self._supplied_ns:
            return
        node_v = self._body.node_voltage_v(t_ns)
        before_pc = self._taken_pc
        count = self._body.electrode_count
        self._taken_pc = [self._body.absolute_charge_pc(electrode) for electrode in range(count)]
        if before_pc:
            # In at one side and out at the other.
            moved_pc = (sum(self._taken_pc) - sum(before_pc)) / 2
            through_ua = moved_pc * 1_000 / (t_ns - self._supplied_ns)
            self._rail.load(t_ns, through_ua + node_v / self._source.leak_ohm * 1e6)

    # The body's account

    def _open_phase(self, t_ns: int) -> None:
        selection = self._selection() if self.code else None
        if selection is not None:
            electrode, direction = selection
            charge_pc = self._body.charge_pc(electrode)
            self._phase = _Phase(electrode, direction, t_ns, self.code, charge_pc)

    def _close_phase(self, t_ns: int) -> None:
        phase, self._phase = self._phase, None
        if phase is None or t_ns == phase.from_ns:
            return
        asked_ua = phase.code * self._source.full_scale_ua / (self._source.codes - 1)
        delivered_pc = self._body.charge_pc(phase.electrode) - phase.charge_pc
        mean_ua = delivered_pc * 1_000 / (t_ns - phase.from_ns)
        self._trace.body(
            phase.electrode,
            phase.from_ns,
            t_ns,
            round(asked_ua) * phase.direction,
            round(mean_ua),
        )

    def _selection(self) -> tuple[int, int] | None:
        found = self._selections.get(id(self._sides))
        if found is None:
            if len(self._selections) >= _CACHED_SELECTIONS:
                self._selections.clear()
            found = self._selections[id(self._sides)] = (self._sides, selected(self._sides))
        return found[1]


def selected(sides: Sides) -> tuple[int, int] | None:
    """The electrode that stands alone on its side, with +1 on the source's and -1 on ground.

    With one on each side it is the source's. None when no electrode stands alone against others.
    """
    sources = sides.count(Side.SOURCE)
    grounds = sides.count(Side.GROUND)
    if sources == 1 and grounds:
        return sides.index(Side.SOURCE), 1
    if grounds == 1 and sources:
        return sides.index(Side.GROUND), -1
    return None
