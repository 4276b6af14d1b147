"""From a frame to the pulses of a scan: levels to currents, maxima, foreseen clamps, and order.

Owns: everything that is decided once per frame, except its rate (`scan_rate.py`) and the headroom
of a pulse (`headroom.py`). Must not know: time of day, sockets, hardware calls; what was felt. A
plan is refused as a whole, with the reason; nothing is left out of it silently.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from etd.files.body_site import SiteDefaults
from etd.planning.headroom import Headroom, PlanRules, pc_of
from etd.planning.scan_rate import Groups, ScanRate
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.calibration import (
    Calibration,
    check_shape_of_caps,
    check_shape_of_levels,
    currents_of_levels,
)
from etd.protocol.errors import CannotSelect, Refused
from etd.protocol.frame import Frame, Polarity, Returns, Ring, per_electrode
from etd.protocol.messages import Clamp, Shortfall
from etd.pulse.request import PulseRequest
from etd.safety.limits import Path, clamp_to_limits, path_of
from etd_hal.cost import CostModel
from etd_hal.selection import Selection

T = TypeVar("T")
#: Work done in steps: everything else is polled where it yields.
Steps = Generator[None, None, T]

#: Current, width, phases and rate of a pulse, and whether a level asked for it.
_MadeOf = tuple[int, int, tuple[bool, ...], float, bool]

#: Anodic phases are True.
PHASES: dict[Polarity, tuple[bool, ...]] = {
    "anodic": (True,),
    "cathodic": (False,),
    "biphasic": (True, False),
    "biphasic_cathodic_first": (False, True),
}


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


class Planner:
    def __init__(self, board: Selector, rules: PlanRules, cost: CostModel) -> None:
        self._board = board
        self._rules = rules
        self._headroom = Headroom(rules)
        self._scan_rate = ScanRate(rules, cost)
        self._outputs = rules.array.outputs()
        self._count = rules.array.count
        caps_ua = rules.person.caps_ua
        self._by_cap = sorted(range(self._count), key=lambda electrode: caps_ua[electrode])[:2]
        #: By electrode, the pulse of the frame before and what it was made of: a pulse that is the
        #: same is the same object, and what depends on it alone need not be decided again.
        self._before: dict[int, tuple[_MadeOf, ScheduledPulse]] = {}
        self._returns_before: Returns | None = None

    def plan(self, frame: Frame, returns: Callable[[Path], Path] | None = None) -> Plan:
        """All of `steps` at once. Raises: Refused."""
        steps = self.steps(frame, returns)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                plan: Plan = end.value
                return plan

    def steps(self, frame: Frame, returns: Callable[[Path], Path] | None = None) -> Steps[Plan]:
        """Plan a frame electrode by electrode: a plan for hundreds takes longer than two polls may
        be apart. The generator's value is the plan.

        Raises: Refused. `returns`: sets what all others allow as returns of a path, for the preview
        of clamps in the reply (None: not known yet, all carry the same share).
        """
        schedule = yield from self._visits(frame)
        clamped = yield from self._preview(schedule, returns or self._shared_equally)
        if frame.strict and clamped:
            self._refuse_strict(clamped[0])
        grouped = self._scan_rate.grouped(schedule)
        rate_hz, shortfalls = self._scan_rate.rate(frame, schedule, grouped)
        self._check_array_mean(schedule, rate_hz)
        return Plan(
            frame,
            schedule,
            rate_hz,
            int(1e9 / rate_hz),
            clamped,
            shortfalls,
            grouped,
            self._scan_rate.pulses,
            math.ceil(self._scan_rate.interval_us * 1_000),
            self._scan_rate.wire_us(schedule),
        )

    @property
    def chain_us(self) -> float:
        """The calls that rewrite the chain."""
        return self._scan_rate.chain_us

    def wire_us(self, schedule: Sequence[ScheduledPulse]) -> float:
        """What messages and calls of these pulses take, one after another."""
        return self._scan_rate.wire_us(schedule)

    # --- pulses ----------------------------------------------------------------------------

    def _visits(self, frame: Frame) -> Steps[tuple[ScheduledPulse, ...]]:
        shape = self._rules.site.stabilize.shape
        if frame.level is not None:
            _check_conditions(frame, self._calibration_for_levels())
            check_shape_of_levels(self._calibration_for_levels(), shape)
        wanted_ua = self._currents(frame)
        if self._rules.person.calibration is not None and any(wanted_ua):
            check_shape_of_caps(self._rules.person.calibration, shape)
        default = self._defaults()
        widths_us = self._values("width_us", frame.width_us, default.width_us)
        rates_hz = self._values("rate_hz", frame.rate_hz, default.rate_hz)
        polarities = self._values("polarity", frame.polarity, default.polarity)
        if frame.returns != self._returns_before:
            self._before.clear()
            self._returns_before = frame.returns
        is_level, schedule, before = frame.level is not None, [], self._before
        for electrode, current_ua in enumerate(wanted_ua):
            if current_ua > 0:
                width_us, rate_hz = widths_us[electrode], rates_hz[electrode]
                phases = PHASES[polarities[electrode]]
                made_of = current_ua, width_us, phases, rate_hz, is_level
                known = before.get(electrode)
                if known is None or known[0] != made_of:
                    visit = self._visit(frame, electrode, current_ua, width_us, phases, rate_hz)
                    known = before[electrode] = made_of, visit
                schedule.append(known[1])
            yield
        schedule.sort(key=lambda scheduled: scheduled.selection.output)
        return tuple(schedule)

    def _calibration_for_levels(self) -> Calibration:
        calibration = self._rules.person.calibration
        if calibration is None:
            raise Refused(
                "level_needs_calibration",
                "level needs a calibration: open the lease with one, or send current_ua",
            )
        return calibration

    def _currents(self, frame: Frame) -> Sequence[int]:
        if frame.level is None:
            return frame.current_ua or ()
        return currents_of_levels(self._calibration_for_levels(), frame.level)

    def _defaults(self) -> Calibration | SiteDefaults:
        """The values where the frame names none."""
        return self._rules.person.calibration or self._rules.site.defaults

    def _values(self, key: str, given: T | tuple[T, ...] | None, default: T) -> tuple[T, ...]:
        return per_electrode(default if given is None else given, self._count, key)

    def _visit(
        self,
        frame: Frame,
        electrode: int,
        current_ua: int,
        width_us: int,
        phases: tuple[bool, ...],
        rate_hz: float,
    ) -> ScheduledPulse:
        self._headroom.check_minimum(electrode, current_ua)
        if frame.level is None:
            self._headroom.check_narrow(electrode, current_ua, width_us)
        request = PulseRequest(current_ua, width_us)
        max_gain = self._headroom.max_gain(is_level=frame.level is not None)
        probe = self._headroom.probe(electrode, request, max_gain)
        visits_hz, count = rate_hz * self._scan_rate.pulses, len(phases)
        self._headroom.check_maxima(electrode, current_ua, width_us, count, visits_hz, pc_of(probe))
        returns = self._returns(frame, electrode)
        path = self._path(electrode, returns)
        bounds = self._headroom.bounds(request, visits_hz, count, probe, max_gain)
        return ScheduledPulse(
            electrode,
            self._select(electrode, returns),
            request,
            phases,
            rate_hz,
            returns,
            path,
            bounds,
            probe,
        )

    def _check_array_mean(self, schedule: Sequence[ScheduledPulse], rate_hz: float) -> None:
        """Checked at the rate that the scan will have; a lower rate slows all pulses alike."""
        charge_pc = self._headroom.charge_pc
        slower = rate_hz / max((scheduled.rate_hz for scheduled in schedule), default=rate_hz)
        mean_ua = (
            slower
            * self._scan_rate.pulses
            * sum(
                scheduled.rate_hz
                * (
                    charge_pc(scheduled.current_ua, scheduled.width_us) * len(scheduled.phases)
                    + scheduled.probe_pc
                )
                for scheduled in schedule
            )
        )
        most_ua = self._rules.maxima.array_mean_current_ua
        if mean_ua / 1e6 > most_ua:
            raise Refused(
                "over_maximum",
                f"the array's mean current would be {mean_ua / 1e6:.0f} uA, at most {most_ua} uA"
                " is allowed: lower currents, widths or rates",
            )

    def _returns(self, frame: Frame, electrode: int) -> tuple[int, ...] | None:
        calibration = self._rules.person.calibration
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

    def _path(self, electrode: int, returns: tuple[int, ...] | None) -> Path:
        caps_ua = self._rules.person.caps_ua
        if returns is not None:
            return path_of(electrode, caps_ua, returns)
        others = [other for other in self._by_cap if other != electrode]
        return path_of(electrode, caps_ua, others)

    def _shared_equally(self, path: Path) -> Path:
        return path.with_returns(path.return_ua * max(1, self._count - 1), path.return_electrode)

    # --- the preview of clamps ---------------------------------------------------------------

    def _preview(
        self, schedule: Sequence[ScheduledPulse], returns: Callable[[Path], Path]
    ) -> Steps[tuple[Clamp, ...]]:
        """The clamps of the pulses to be fired, before any stabilizer responds to the skin."""
        maxima, shape = self._rules.maxima, self._rules.site.stabilize.shape
        found = []
        for scheduled in schedule:
            _, clamp = clamp_to_limits(
                returns(scheduled.path) if scheduled.returns is None else scheduled.path,
                scheduled.bounds.in_slot(shape.of(scheduled.request)),
                maxima,
                maxima.current_ua,
                None,
                False,
                scheduled.bounds,
                scheduled.probe_pc,
            )
            if clamp is not None:
                found.append(clamp)
            yield
        return tuple(found)

    @staticmethod
    def _refuse_strict(clamp: Clamp) -> None:
        raise Refused(
            "over_limit",
            f"strict: electrode {clamp.electrode} asks for {clamp.wanted_ua} uA and would get"
            f" {clamp.allowed_ua} uA ({clamp.reason} of electrode {clamp.limited_by})",
            clamp.electrode,
        )


def _check_conditions(frame: Frame, calibration: Calibration) -> None:
    """A level frame must have the conditions of its calibration. Raises: Refused."""
    for key in ("polarity", "width_us", "rate_hz", "returns"):
        asked, made_with = getattr(frame, key), getattr(calibration, key)
        if asked is None or asked == made_with:
            continue
        is_each = key != "returns" and isinstance(asked, tuple)
        if is_each and all(entry == made_with for entry in asked):
            continue
        raise Refused(
            "bad_frame",
            f"level means what it was calibrated to with {key} {made_with}; the frame asks for"
            f" another {key}: leave it out, calibrate for it, or send current_ua",
        )
