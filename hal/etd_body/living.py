"""A living body: skin that changes with time and current, and nerves that feel the pulses.

Owns: the course of voltage and charge through a skin that changes, and what of it reaches the
nerves; see `interface.Body`. Must not know: chips, boards, clocks.

Electrically it is the minimal body with what that leaves out: resistance that depends on current
and time, films between electrodes, electrodes that float. What stays lumped is said in
docs/body.md. The skin is looked at anew when a pulse begins, at most every 10 ms
(160 ms with 256 electrodes).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, inf

import numpy as np

from etd_body.course import LYING, Course, Script
from etd_body.electrode import Contact
from etd_body.interface import Side, Sides
from etd_body.nerve import Nerves, NerveSpread
from etd_body.sensation import Felt, Polarity, Sensation, Singles, pain_of_heat
from etd_body.shifts import UNSHIFTED, FeelingFigures, Shifts
from etd_body.skin import Skin, SkinFigures
from etd_body.source import Loop, parallel
from etd_body.tissue import Floats
from etd_body.ways import Way, Ways

#: Looking costs with the square of the electrodes: with more than 64 it is done less often.
_LOOK_NS, _LOOKED_AT = 10_000_000, 64
_EMPTY_V = 1e-4
_PC = 1e12
#: No source tells more; thresholds above it are none.
_MOST_TOLD_UA = 60_000.0


@dataclass(slots=True)
class _Passed:
    """What one stretch of constant drive has let through so far."""

    way: Way
    from_ns: int
    parallel_ohm: float
    charge_c: float = 0.0
    duration_s: float = 0.0


class LivingBody:
    """See the module. `positions_mm`: where each electrode is, as in an array file."""

    def __init__(
        self,
        positions_mm: Sequence[tuple[float, float]],
        *,
        leak_ohm: float,
        compliance_v: float,
        seed: int,
        script: Script = LYING,
        figures: SkinFigures = SkinFigures(),  # noqa: B008 - frozen
        spread: NerveSpread = NerveSpread(),  # noqa: B008 - frozen
        feeling: FeelingFigures = UNSHIFTED,
    ) -> None:
        count = len(positions_mm)
        self._leak_s = 1.0 / leak_ohm
        self._compliance_v = compliance_v
        course = self._course(script, positions_mm, seed)
        self.skin = Skin(figures, course, positions_mm, seed=seed)
        shifts = None if feeling == UNSHIFTED else Shifts(feeling, positions_mm)
        self.sensation = Sensation(Nerves(positions_mm, seed=seed, spread=spread), shifts)
        self._born_ns: int | None = None
        self._t_ns = 0
        self._looked_ns = 0
        self._look_ns = int(_LOOK_NS * max(1.0, count / _LOOKED_AT) ** 2)
        self._source_a = 0.0
        self._held_v: dict[int, float] = {}
        self._net_pc: Floats = np.zeros(count)
        self._absolute_pc: Floats = np.zeros(count)
        self._ways = Ways(self.skin)
        self._use_skin()
        self._sides: Sides = (Side.OPEN,) * count
        self._way = self._ways.of(self._sides)
        self._loop: Loop | None = None
        self._passed: _Passed | None = None

    def _course(
        self, script: Script, positions_mm: Sequence[tuple[float, float]], seed: int
    ) -> Course:
        """How the skin changes; the only thing in which another kind of finger differs."""
        return Course(script, positions_mm, seed=seed)

    @property
    def electrode_count(self) -> int:
        return len(self._net_pc)

    def contact(self, electrode: int) -> Contact:
        return self.skin.contact(electrode)

    def touch(self, t_ns: int, electrode: int, contact: Contact) -> None:
        """From `t_ns` on this lies under the electrode, whatever the course of time does.

        Raises: ValueError for a resistor to ground, which belongs on a bench.
        """
        if contact.kind == "grounded":
            raise ValueError(f"a finger at electrode {electrode} has no resistor to ground")
        self._advance(t_ns)
        self._held_v.pop(electrode, None)
        self.skin.put(electrode, contact)
        self._look(t_ns)
        self._connect()

    def supply(self, t_ns: int, compliance_v: float) -> None:
        self._advance(t_ns)
        self._compliance_v = compliance_v
        self._connect()

    def drive(self, t_ns: int, source_ua: float, sides: Sides) -> None:
        if len(sides) != self.electrode_count:
            raise ValueError(f"{len(sides)} sides for {self.electrode_count} electrodes")
        self._advance(t_ns)
        was_a, self._source_a = self._source_a, source_ua * 1e-6
        if was_a > 0.0:
            self._let_nerves_have_it()
            if source_ua <= 0.0 or sides is not self._sides:
                self.sensation.end_pulse(self._way.lone)
        if source_ua > 0.0 and was_a <= 0.0 and t_ns - self._looked_ns >= self._look_ns:
            self._look(t_ns)
        self._sides = sides
        self._connect()

    def node_voltage_v(self, t_ns: int) -> float:
        self._advance(t_ns)
        way = self._way
        if way.lone is not None and self._loop is not None:
            return self._loop.node_v(self._held_v.get(way.lone, 0.0) * way.direction)
        leak_ohm = 1.0 / (self._leak_s + way.shunt_s)
        return min(self._compliance_v, self._source_a * parallel(leak_ohm, way.rest_ohm))

    def charge_pc(self, electrode: int) -> float:
        return float(self._net_pc[electrode])

    def absolute_charge_pc(self, electrode: int) -> float:
        return float(self._absolute_pc[electrode])

    # What is felt

    def take_felt(self) -> Felt:
        """The strongest of each electrode since the last call."""
        return self.sensation.take()

    def pressure_kpa(self, t_ns: int, position_mm: tuple[float, float]) -> float:
        """What a sensor under the array feels there, at a time that need not be the body's own."""
        t_s = (t_ns - (t_ns if self._born_ns is None else self._born_ns)) * 1e-9
        return self.skin.course.pressure_at_kpa(max(0.0, t_s), position_mm)

    def look_at(self, t_ns: int) -> None:
        """Let time pass to `t_ns` and look at the skin, so that thresholds are those of now."""
        self._advance(t_ns)
        self._look(t_ns)
        self._connect()

    def commanded_threshold_ua(
        self, electrode: int, width_us: float, polarity: Polarity = "anodic", times: float = 1.0
    ) -> float:
        """What the source must be told for one pulse against all others to be just felt, or for it
        to pass so many `times` the current that is.

        Leak, films, charging and compliance on the way; inf where no current does it.
        """
        skin_ua = times * self.sensation.true_threshold_ua(electrode, width_us, polarity)
        return self._least_commanded(electrode, width_us, lambda passed, _: passed >= skin_ua)

    def times_threshold(
        self, electrode: int, commanded_ua: float, width_us: float, polarity: Polarity = "anodic"
    ) -> float:
        """How many times what is just felt passes the skin when the source is told `commanded_ua`:
        two electrodes where that is the same feel alike. 0 without contact.
        """
        way = self._ways.against_all(electrode)
        if way.lone is None:
            return 0.0
        passed_ua, _ = self._pulse(way, electrode, commanded_ua, width_us)
        return passed_ua / self.sensation.true_threshold_ua(electrode, width_us, polarity)

    def commanded_pain_threshold_ua(
        self, electrode: int, width_us: float, polarity: Polarity = "anodic"
    ) -> float:
        """The same for what just hurts, by thin fibres or by heat."""
        skin_ua = self.sensation.pain_threshold_ua(electrode, width_us, polarity)
        return self._least_commanded(
            electrode,
            width_us,
            lambda passed, heat: passed >= skin_ua or pain_of_heat(heat) >= 1.0,
        )

    def resistance_ohm(self, electrode: int, commanded_ua: float) -> int:
        """Of one electrode alone, against a long pulse of `commanded_ua`."""
        loop = self._loop_of(self._ways.against_all(electrode), electrode, commanded_ua * 1e-6)
        return round(float(self.skin.series_ohm[electrode]) + loop.parallel_ohm)

    def _least_commanded(
        self, electrode: int, width_us: float, does: Callable[[float, float], bool]
    ) -> float:
        """The least current at which `does` (uA through the skin, heat) answers yes."""
        way = self._ways.against_all(electrode)
        low, high = 0.0, _MOST_TOLD_UA
        if way.lone is None or not does(*self._pulse(way, electrode, high, width_us)):
            return inf
        while high - low > 0.1:
            middle = (low + high) / 2.0
            if does(*self._pulse(way, electrode, middle, width_us)):
                high = middle
            else:
                low = middle
        return high

    def _pulse(
        self, way: Way, electrode: int, commanded_ua: float, width_us: float
    ) -> tuple[float, float]:
        loop = self._loop_of(way, electrode, commanded_ua * 1e-6)
        passed_ua = loop.advance(0.0, width_us * 1e-6)[1] / width_us * 1e12
        return passed_ua, self._heat(electrode, passed_ua, width_us, loop.parallel_ohm)

    def _heat(
        self, electrode: int, passed_ua: float, width_us: float, parallel_ohm: float
    ) -> float:
        """In uJ per mm2 of the way in."""
        energy_uj = passed_ua**2 * parallel_ohm * width_us * 1e-12
        return energy_uj / self.skin.area_mm2(electrode)

    # What is connected

    def _look(self, t_ns: int) -> None:
        self._looked_ns = t_ns
        self.skin.refresh((t_ns - (self._born_ns or 0)) * 1e-9)
        self.sensation.let_pass(t_ns)
        self._use_skin()

    def _use_skin(self) -> None:
        skin = self.skin
        self._ways.use_skin()
        self.sensation.set_contacts(skin.radius_mm(), self._ways.conductance_s * skin.is_skin)
        for electrode in [
            electrode for electrode in self._held_v if not skin.is_touching[electrode]
        ]:
            del self._held_v[electrode]

    def _connect(self) -> None:
        self._way = way = self._ways.of(self._sides)
        if way.lone is None or (self._source_a <= 0.0 and way.lone not in self._held_v):
            self._loop = None
        else:
            self._loop = self._loop_of(way, way.lone, self._source_a)

    def _loop_of(self, way: Way, electrode: int, source_a: float) -> Loop:
        return self._ways.loop(way, electrode, source_a, self._leak_s, self._compliance_v)

    # Time

    def _advance(self, t_ns: int) -> None:
        if self._born_ns is None:
            self._born_ns = self._t_ns = self._looked_ns = t_ns
        if t_ns < self._t_ns:
            raise ValueError(f"time went back from {self._t_ns} ns to {t_ns} ns")
        from_ns, self._t_ns = self._t_ns, t_ns
        duration_s = (t_ns - from_ns) * 1e-9
        if duration_s == 0.0:
            return
        way = self._way
        for electrode in tuple(self._held_v):
            if electrode != way.lone:
                self._drain(electrode, duration_s)
        if way.lone is not None and self._loop is not None:
            self._flow(way, way.lone, self._loop, from_ns, duration_s)
        elif way.direction and self._source_a > 0.0:
            voltage_v = self.node_voltage_v(t_ns)
            self._pass(way, voltage_v / way.rest_ohm * duration_s, from_ns, duration_s)

    def _flow(self, way: Way, electrode: int, loop: Loop, from_ns: int, duration_s: float) -> None:
        held_v = self._held_v.pop(electrode, 0.0) * way.direction
        if held_v == 0.0 and self._source_a <= 0.0:
            return
        held_v, charge_c = loop.advance(held_v, duration_s)
        if abs(held_v) >= _EMPTY_V:
            self._held_v[electrode] = held_v * way.direction
        self._pass(way, charge_c, from_ns, duration_s)

    def _pass(self, way: Way, charge_c: float, from_ns: int, duration_s: float) -> None:
        """Book a charge, and let the nerves have it while the source is on.

        What flows back out of a contact's capacitor afterwards is booked and not felt.
        """
        charge = way.weights * (charge_c * _PC * way.direction)
        self._net_pc += charge
        self._absolute_pc += np.abs(charge)
        if self._source_a <= 0.0:
            return
        if self._passed is None:
            parallel_ohm = 0.0 if self._loop is None else self._loop.parallel_ohm
            self._passed = _Passed(way, from_ns, parallel_ohm)
        self._passed.charge_c += charge_c
        self._passed.duration_s += duration_s

    def _let_nerves_have_it(self) -> None:
        """A stretch under one drive is one rectangle to them, of its mean current."""
        passed, self._passed = self._passed, None
        if passed is None or passed.charge_c <= 0.0:
            return
        way = passed.way
        if way.pattern is None:
            way.pattern = self._pattern(way)
        current_ua = passed.charge_c * 1e6 / passed.duration_s * way.direction
        self.sensation.pass_current(
            passed.from_ns, passed.duration_s * 1e9, current_ua, way.pattern
        )
        if way.lone is not None and self.skin.is_skin[way.lone]:
            width_us = passed.duration_s * 1e6
            heat = self._heat(way.lone, current_ua, width_us, passed.parallel_ohm)
            self.sensation.heat(way.lone, heat)

    def _pattern(self, way: Way) -> Singles:
        if way.lone is not None and way.is_against_all:
            return self.sensation.one_against_all(way.lone)
        return self.sensation.one_against(way.weights * self.skin.is_skin)

    def _drain(self, electrode: int, duration_s: float) -> None:
        """Let a charged electrode run down through itself and those connected with it."""
        skin, masks = self.skin, self._ways.masks(self._sides)
        conductance_s = self._ways.conductance_s
        connected = (masks.sources | masks.grounds) & skin.is_touching
        is_connected = bool(connected[electrode])
        rest_s = float(conductance_s[connected].sum())
        rest_s -= float(conductance_s[electrode]) if is_connected else 0.0
        way_out = is_connected and rest_s > 1e-12
        loop_ohm = float(skin.series_ohm[electrode]) + 1.0 / rest_s if way_out else inf
        capacitance_f = float(skin.capacitance_nf[electrode]) * 1e-9
        tau_s = capacitance_f * parallel(float(skin.parallel_ohm[electrode]), loop_ohm)
        before_v = self._held_v.pop(electrode)
        after_v = before_v * exp(-duration_s / tau_s)
        if abs(after_v) >= _EMPTY_V:
            self._held_v[electrode] = after_v
        else:
            after_v = 0.0
        if way_out:
            out_pc = tau_s * (before_v - after_v) / loop_ohm * _PC
            shares = conductance_s * connected
            shares[electrode] = 0.0
            shares *= out_pc / rest_s
            shares[electrode] = -out_pc
            self._net_pc += shares
            self._absolute_pc += np.abs(shares)
