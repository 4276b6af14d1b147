"""From a frame to the pulses of a scan: levels to currents, maxima, foreseen clamps, and order.

Owns: everything that is decided once per frame, except its rate (`scan_rate.py`) and the headroom
of a pulse (`headroom.py`). Must not know: time of day, sockets, hardware calls; what was felt. A
plan is refused as a whole, with the reason; nothing is left out of it silently.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from etd.files.body_site import SiteDefaults
from etd.planning.calibrated import Calibrated
from etd.planning.headroom import Headroom, PlanRules, PulseKind
from etd.planning.net_balance import NetBalance, told_balanced
from etd.planning.net_forecast import NetForecast, NetLimit
from etd.planning.outlook import WHAT_TO_DO, Outlook
from etd.planning.scan_rate import Counted, Groups, ScanRate
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.calibration import Calibration, levels_hz_of, lower_than_calibrated
from etd.protocol.errors import CannotSelect, Refused
from etd.protocol.frame import PHASES, Frame, Polarity, Returns, Ring, per_electrode
from etd.protocol.outcome import Clamp, Shortfall
from etd.pulse.request import PulseRequest
from etd.safety.limits import Path, clamp_to_limits, path_of
from etd_hal.cost import CostModel
from etd_hal.selection import Selection

T = TypeVar("T")
#: Work done in steps: everything else is polled where it yields.
Steps = Generator[None, None, T]

#: Pulses that are planned, or looked at for clamps, in one step.
_A_STEP = 8
#: Kinds of pulses that are remembered. Most frames have one.
_MOST_KINDS = 1_024


class Selector(Protocol):
    """What a plan needs of a board: selections by output. `etd_hal.board.Board` implements it."""

    def selection(self, output: int, returns: tuple[int, ...] | None) -> Selection:
        """Raises: CannotSelect."""
        ...


@dataclass(frozen=True, slots=True)
class Plan:
    """A frame that can be shown: its pulses in chain order, and a period that they fit into.

    `groups` are the places in `schedule` that share a burst, in order; each place gets `pulses` in
    the burst, `interval_ns` apart. Without bursts there is one group, and one pulse.
    """

    frame: Frame
    schedule: tuple[ScheduledPulse, ...]
    rate_hz: float
    period_ns: int
    clamped: tuple[Clamp, ...]
    slowed: tuple[Shortfall, ...]
    groups: Groups
    pulses: int
    interval_ns: int
    #: What messages and calls of a scan take.
    wire_us: float
    #: The rate that its levels were calibrated at, where the frame asks for a lower one.
    calibrated_hz: float | None = None
    #: The same whatever it asks for; None: it has no levels.
    levels_hz: float | None = None


class _Planned:
    """An electrode's pulse of the frame before. A pulse that is the same is the same object, and
    what depends on it alone need not be decided again.
    """

    __slots__ = ("free_ua", "free_with", "kind", "mean_pc", "pulse")

    def __init__(self, pulse: ScheduledPulse, kind: PulseKind, mean_pc: float) -> None:
        self.pulse = pulse
        self.kind = kind
        self.mean_pc = mean_pc
        #: A pulse of this kind with so much current was not clamped, with these caps on its path.
        self.free_ua = 0
        self.free_with: Path | None = None

    def put(self, pulse: ScheduledPulse, kind: PulseKind, mean_pc: float) -> None:
        """Its pulse for the next frame."""
        if kind is not self.kind:
            self.free_with = None
        self.pulse, self.kind, self.mean_pc = pulse, kind, mean_pc

    def is_other(self, current_ua: int, kind: PulseKind) -> bool:
        """Whether its pulse was another one."""
        return kind is not self.kind or current_ua != self.pulse.request.current_ua


class Planner:
    def __init__(self, board: Selector, rules: PlanRules, cost: CostModel) -> None:
        self._board = board
        self._rules = rules
        self._headroom = Headroom(rules)
        self._scan_rate = ScanRate(rules, cost)
        self._net_forecast = NetForecast(
            rules.array.count, rules.maxima.net_charge_pc, self._headroom
        )
        self._balance = NetBalance(rules.site.balance, rules.person)
        self._outputs = rules.array.outputs()
        self._count = rules.array.count
        caps_ua = rules.person.caps_ua
        self._by_cap = sorted(range(self._count), key=lambda electrode: caps_ua[electrode])[:2]
        shape = rules.site.stabilize.shape
        self._calibrated = Calibrated(rules.person, shape)
        #: A clamp of these does not depend on how strong they are.
        self._is_plain = shape.strength_duration is None and shape.prepulse is None
        self._kinds: dict[tuple[object, ...], PulseKind] = {}
        #: By electrode, for the returns of the frame before.
        self._planned: dict[int, _Planned] = {}
        self._returns_before: Returns | None = None
        #: The electrodes of the frame and the kinds of their pulses; and of the frame that was
        #: counted last.
        self._alike: list[object] = []
        self._counted_alike: list[object] = []
        self._counted: Counted | None = None

    def plan(self, frame: Frame, outlook: Outlook | None = None) -> Plan:
        """All of `steps` at once. Raises: Refused."""
        steps = self.steps(frame, outlook)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                plan: Plan = end.value
                return plan

    def steps(self, frame: Frame, outlook: Outlook | None = None) -> Steps[Plan]:
        """Plan a frame electrode by electrode: a plan for hundreds takes longer than two polls may
        be apart. The generator's value is the plan.

        Raises: Refused. `outlook`: for the preview of clamps in the reply (None: nothing is known
        yet, all returns carry the same share).

        Where the body site balances, a frame that would leave too much direct current is planned
        with both phases, if it can be.
        """
        outlook = self._unknown() if outlook is None else outlook
        plan, limit, alone = yield from self._plan_of(frame, outlook)
        if alone is None:
            return _also_told(plan, self._net_forecast.told(limit))
        try:
            balanced = self._balance.form_of(frame, alone, self._defaults().polarity)
            if balanced is not None:
                both, left, _ = yield from self._plan_of(balanced, outlook)
                return _also_told(both, (*self._net_forecast.told(left), told_balanced(alone)))
        except Refused as refusal:
            return _also_told(plan, self._net_forecast.told(limit, refusal.reason))
        return _also_told(plan, self._net_forecast.told(limit))

    def _plan_of(
        self, frame: Frame, outlook: Outlook
    ) -> Steps[tuple[Plan, NetLimit | None, NetLimit | None]]:
        """The limits: what its net charge needs to be told, or refused; and, where the body site
        balances, what the frame by itself would leave, however returns conduct.
        """
        schedule = yield from self._pulses(frame)
        clamped = yield from self._preview(schedule, outlook)
        counted = self._cost_kinds(schedule)
        rate_hz, shortfalls = self._scan_rate.rate(frame, schedule, counted)
        self._check_array_mean(schedule, rate_hz, counted.wanted_hz)
        yield  # the forecast goes through all pulses for each account: a step of its own
        slowdown, pulses = rate_hz / counted.wanted_hz, self._scan_rate.pulses
        is_known = outlook.are_returns_known
        limit = self._net_forecast.limit(
            frame, schedule, slowdown, pulses, outlook.net, are_returns_known=is_known
        )
        alone = None
        if self._balance.is_allowed:
            alone = self._net_forecast.limit(frame, schedule, slowdown, pulses, ())
        if clamped:
            clamped = tuple([outlook.with_time(clamp, rate_hz) for clamp in clamped])
            if frame.strict:
                _refuse_strict(clamped[0])
        yield
        plan = Plan(
            frame,
            schedule,
            rate_hz,
            int(1e9 / rate_hz),
            clamped,
            shortfalls,
            counted.groups,
            self._scan_rate.pulses,
            math.ceil(self._scan_rate.interval_us * 1_000),
            counted.wire_us,
            lower_than_calibrated(self._rules.person.calibration, frame),
            levels_hz_of(self._rules.person.calibration, frame),
        )
        return plan, limit, alone

    @property
    def chain_us(self) -> float:
        """The calls that rewrite the chain."""
        return self._scan_rate.chain_us

    def wire_us(self, schedule: Sequence[ScheduledPulse]) -> float:
        """What messages and calls of these pulses take, one after another."""
        return self._scan_rate.wire_us(schedule)

    # --- pulses ----------------------------------------------------------------------------

    def _pulses(self, frame: Frame) -> Steps[tuple[ScheduledPulse, ...]]:
        is_level, default = frame.level is not None, self._defaults()
        polarities = self._values("polarity", frame.polarity, default.polarity)
        most_hz = self._rules.maxima.rate_hz / self._scan_rate.pulses
        wanted_ua = self._calibrated.currents_ua(frame, polarities, most_hz)
        widths_us = self._values("width_us", frame.width_us, default.width_us)
        rates_hz = self._values("rate_hz", frame.rate_hz, default.rate_hz)
        if frame.returns != self._returns_before:
            self._planned.clear()
            self._returns_before = frame.returns
        planned, has_probes = self._planned, self._headroom.has_probes
        schedule: list[ScheduledPulse] = []
        alike: list[object] = []
        kind: PulseKind | None = None
        asked_before: object = None
        for electrode, current_ua in enumerate(wanted_ua):
            if current_ua <= 0:
                continue
            asked = widths_us[electrode], polarities[electrode], rates_hz[electrode]
            if kind is None or asked != asked_before or has_probes:
                kind, asked_before = self._kind(electrode, current_ua, asked, is_level), asked
            before = planned.get(electrode)
            if before is None or before.is_other(current_ua, kind):
                schedule.append(self._pulse(frame, electrode, current_ua, kind, before))
            else:
                schedule.append(before.pulse)
            alike.append(electrode)
            alike.append(kind)
            # A selection takes long where many returns are named.
            if before is None or not len(schedule) % _A_STEP:
                yield
        yield
        schedule.sort(key=lambda scheduled: scheduled.selection.output)
        self._alike = alike
        return tuple(schedule)

    def _defaults(self) -> Calibration | SiteDefaults:
        """The values where the frame names none."""
        return self._calibrated.first or self._rules.site.defaults

    def _values(self, key: str, given: T | tuple[T, ...] | None, default: T) -> tuple[T, ...]:
        return per_electrode(default if given is None else given, self._count, key)

    def _kind(
        self,
        electrode: int,
        current_ua: int,
        asked: tuple[int, Polarity, float],
        is_level: bool,
    ) -> PulseKind:
        width_us, polarity, rate_hz = asked
        headroom = self._headroom
        probe = headroom.probe(electrode, current_ua, width_us, is_level=is_level)
        key = asked, is_level, None if probe is None else (probe.current_ua, probe.width_us)
        kind = self._kinds.get(key)
        if kind is None:
            if len(self._kinds) >= _MOST_KINDS:
                self._kinds.clear()
            pulses = self._scan_rate.pulses
            kind = self._kinds[key] = headroom.kind(
                width_us, PHASES[polarity], rate_hz, pulses, probe, is_level=is_level
            )
        return kind

    def _pulse(
        self,
        frame: Frame,
        electrode: int,
        current_ua: int,
        kind: PulseKind,
        before: _Planned | None,
    ) -> ScheduledPulse:
        """A pulse that is new, or another than in the frame before."""
        self._headroom.check(electrode, current_ua, kind)
        if before is None:
            returns = self._returns(frame, electrode)
            path = self._path(electrode, kind.phases, returns)
            selection = self._select(electrode, returns)
        else:
            same = before.pulse
            returns, path, selection = same.returns, same.path, same.selection
            if same.phases != kind.phases:
                path = path.with_cap(self._calibrated.cap_ua(electrode, kind.phases))
        pulse = ScheduledPulse(
            electrode,
            selection,
            PulseRequest(current_ua, kind.width_us),
            kind.phases,
            kind.rate_hz,
            returns,
            path,
            self._headroom.bounds(current_ua, kind),
            kind.probe,
        )
        mean_pc = self._headroom.mean_pc(current_ua, kind)
        if before is None:
            self._planned[electrode] = _Planned(pulse, kind, mean_pc)
        else:
            before.put(pulse, kind, mean_pc)
        return pulse

    def _cost_kinds(self, schedule: Sequence[ScheduledPulse]) -> Counted:
        """Counted anew only where electrodes or kinds are others than in the frame before."""
        counted = self._counted
        is_known = self._alike == self._counted_alike and not self._scan_rate.has_bursts
        if counted is None or not is_known:
            counted = self._counted = self._scan_rate.counted(schedule)
            self._counted_alike = self._alike
        return counted

    def _check_array_mean(
        self, schedule: Sequence[ScheduledPulse], rate_hz: float, wanted_hz: float
    ) -> None:
        """Checked at the rate that the scan will have; a lower rate slows all pulses alike."""
        planned, pulses = self._planned, self._scan_rate.pulses
        each_pc = sum([planned[scheduled.electrode].mean_pc for scheduled in schedule])
        mean_ua = rate_hz / wanted_hz * pulses * each_pc
        most_ua = self._rules.maxima.array_mean_current_ua
        if mean_ua / 1e6 > most_ua:
            raise Refused(
                "over_maximum",
                f"the array's mean current would be {mean_ua / 1e6:.0f} uA, at most {most_ua} uA"
                " is allowed: lower currents, widths or rates",
            )

    def _returns(self, frame: Frame, electrode: int) -> tuple[int, ...] | None:
        calibration = self._calibrated.first
        returns: Returns = "all"
        if frame.returns is not None:
            returns = frame.returns
        elif calibration is not None:
            returns = calibration.returns
        if isinstance(returns, tuple):
            chosen = returns[electrode]
        elif isinstance(returns, Ring):
            chosen = self._rules.array.ring(electrode, returns.ring_mm)
        else:
            return None
        if not chosen:
            raise Refused(
                "board_cannot",
                f"electrode {electrode} has no return: no electrode lies there",
                electrode,
            )
        return chosen

    def _select(self, electrode: int, returns: tuple[int, ...] | None) -> Selection:
        outputs = (
            None if returns is None else tuple(self._outputs[electrode] for electrode in returns)
        )
        try:
            return self._board.selection(self._outputs[electrode], outputs)
        except CannotSelect as error:
            raise Refused("board_cannot", f"electrode {electrode}: {error}", electrode) from error

    def _path(
        self, electrode: int, phases: tuple[bool, ...], returns: tuple[int, ...] | None
    ) -> Path:
        caps_ua = self._rules.person.caps_ua
        if returns is None:
            returns = tuple([other for other in self._by_cap if other != electrode])
        path = path_of(electrode, caps_ua, returns)
        return path.with_cap(self._calibrated.cap_ua(electrode, phases))

    def _unknown(self) -> Outlook:
        return Outlook(
            self._shared_equally, self._rules.maxima.current_ua, {}, [None] * self._count
        )

    def _shared_equally(self, path: Path) -> Path:
        return path.with_returns(path.return_ua * max(1, self._count - 1), path.return_electrode)

    # --- the preview of clamps ---------------------------------------------------------------

    def _preview(
        self, schedule: Sequence[ScheduledPulse], outlook: Outlook
    ) -> Steps[tuple[Clamp, ...]]:
        """The clamps of the pulses to be fired, before any stabilizer responds to the skin. What
        was let through with the same caps on its path is let through when it is weaker.
        """
        found = []
        ceiling_ua, recontacts_ua = outlook.ceiling_ua, outlook.recontacts_ua
        for number, scheduled in enumerate(schedule, 1):
            electrode, current_ua = scheduled.electrode, scheduled.request.current_ua
            planned, is_open = self._planned[electrode], outlook.is_touched[electrode] is False
            path = outlook.path(scheduled.path) if scheduled.returns is None else scheduled.path
            if (
                path is not planned.free_with
                or current_ua > planned.free_ua
                or current_ua > ceiling_ua
                or electrode in recontacts_ua
                or is_open
                or outlook.felt_ua is not None
            ):
                clamp = self._clamp(scheduled, path, outlook)
                if clamp is not None:
                    found.append(clamp)
                    if clamp.reason == "return_cap":
                        outlook.want_looks()
                elif self._is_plain and outlook.felt_ua is None:
                    planned.free_with, planned.free_ua = path, current_ua
            if not number % _A_STEP:
                yield
        return tuple(found)

    def _clamp(self, scheduled: ScheduledPulse, path: Path, outlook: Outlook) -> Clamp | None:
        maxima, shape = self._rules.maxima, self._rules.site.stabilize.shape
        request, felt_ua = scheduled.bounds.in_slot(shape.of(scheduled.request)), outlook.felt_ua
        may_be_raised = scheduled.bounds.may_be_raised
        return clamp_to_limits(
            path,
            request,
            maxima,
            outlook.ceiling_ua,
            outlook.recontacts_ua.get(scheduled.electrode),
            outlook.is_touched[scheduled.electrode] is False,
            scheduled.bounds,
            scheduled.probe_pc,
            None
            if felt_ua is None
            else felt_ua(scheduled.electrode, request.current_ua, may_be_raised=may_be_raised),
        )[1]


def _also_told(plan: Plan, told: tuple[Shortfall, ...]) -> Plan:
    return dataclasses.replace(plan, slowed=(*plan.slowed, *told)) if told else plan


def _refuse_strict(clamp: Clamp) -> None:
    what_to_do = WHAT_TO_DO.get(clamp.reason, "")
    raise Refused(
        "over_limit",
        f"strict: electrode {clamp.electrode} asks for {clamp.wanted_ua} uA and would get"
        f" {clamp.allowed_ua} uA ({clamp.reason} of electrode {clamp.limited_by}){what_to_do}",
        clamp.electrode,
    )
