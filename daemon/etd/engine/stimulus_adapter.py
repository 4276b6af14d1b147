"""The estimate of an electrode, and the request that the stabilizers make with it.

Owns: gathering `ElectrodeEstimate` for a pulse, running the stabilizers, cutting their request to
the pulse's slot, and reporting what was cut or rejected. Must not know: limits, ledgers, hardware.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from etd.engine.feeling import Feeling
from etd.engine.reporting import Reporter
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.calibration import Calibration
from etd.protocol.exponent import usable_k
from etd.protocol.frame import PHASES
from etd.pulse.request import PulseRequest
from etd.sensing.contact import ContactMap
from etd.sensing.impedance import ImpedanceMap, Samples
from etd.stabilize.contact import Contact
from etd.stabilize.pipeline import ElectrodeEstimate, Stabilizer, higher, max_gain_of
from etd.stabilize.resistance_law import ResistanceLaw


class PressureSource(Protocol):
    """Where the pressure at an electrode comes from."""

    def kpa(self, electrode: int, now_ns: int) -> float | None:
        """None where unknown: no sensor, an error, or stale."""
        ...

    def is_dead(self, electrode: int, now_ns: int) -> bool:
        """There is a sensor, and it has no valid reading."""
        ...


class StimulusAdapter:
    """See the module. One per daemon; it is reset when the supply was off."""

    def __init__(
        self,
        stabilizers: Sequence[Stabilizer],
        contact: ContactMap,
        impedance: ImpedanceMap,
        pressed: PressureSource,
        reporter: Reporter,
        feeling: Feeling,
        board: str,
        leak_ohm: int,
    ) -> None:
        """`board`, with its leak: a person's k holds for the one that it was measured with."""
        self._board, self._leak_ohm = board, leak_ohm
        self._stabilizers = tuple(stabilizers)
        #: Which of them answer what is measured of the skin, and so are judged by the person.
        self._is_judged = tuple(
            [isinstance(law, ResistanceLaw | Contact) for law in self._stabilizers]
        )
        self._feeling = feeling
        self._contact = contact
        self._impedance = impedance
        self._pressure_source = pressed
        self._reporter = reporter
        self._calibration: Calibration | None = None
        #: By the phases of a pulse, where there is a calibration for each of several polarities.
        self._by_phases: dict[tuple[bool, ...], Calibration] = {}
        #: By the polarity of the calibration: the person's k, where it may be used.
        self._exponents: dict[str, float | None] = {}
        self._is_reference_early = False
        self._dead: set[int] = set()
        self._stale: set[int] = set()
        self.max_gain = max_gain_of(self._stabilizers)
        #: Whether a stabilizer requests more for a contact that stayed than for a new one.
        self.needs_contact = any(
            isinstance(stabilizer, Contact) for stabilizer in self._stabilizers
        )

    def set_calibration(
        self,
        calibration: Calibration | None,
        is_early: bool = False,
        others: Sequence[Calibration] = (),
    ) -> None:
        """Called for each lease, with the person's calibration or None, and with those for other
        polarities. `is_early`: they were made with pulses too short for a sample at their end.
        """
        self._calibration, self._is_reference_early = calibration, is_early
        self._by_phases = {}
        if calibration is not None and others:
            self._by_phases = {PHASES[it.polarity]: it for it in (calibration, *others)}
        each = () if calibration is None else (calibration, *others)
        self._exponents = {
            it.polarity: usable_k(it.exponent, self._board, self._leak_ohm, it.date) for it in each
        }
        self._impedance.is_early_wanted = is_early
        self._feeling.lease_begun(each)
        self.reset()

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        self._impedance.reset()
        self._stale.clear()
        self._feeling.reset()
        for stabilizer in self._stabilizers:
            stabilizer.reset()

    def adapt(self, scheduled: ScheduledPulse, now_ns: int) -> PulseRequest:
        """What the stabilizers request of this pulse, raised where the person said that it is too
        weak: no wider than its slot.
        """
        if not self._stabilizers:
            return self._raised(scheduled, scheduled.request, now_ns)
        is_probed_first = scheduled.probe is not None
        estimate = self.estimate(
            scheduled.electrode,
            now_ns,
            is_probed_first=is_probed_first,
            phases=scheduled.phases,
        )
        return self._raised(scheduled, self._adapted(scheduled, estimate), now_ns)

    def readapt(
        self,
        scheduled: ScheduledPulse,
        before: PulseRequest,
        expected_ohm: float | None,
        now_ns: int,
    ) -> PulseRequest:
        """The same after a probe: with the skin resistance that the probe predicts, where that is
        above the estimate, or the estimate is too old. Never more than was requested before the
        probe: no current and no width rises.
        """
        if not self._stabilizers:
            return before
        estimate = self.estimate(scheduled.electrode, now_ns, expected_ohm, phases=scheduled.phases)
        adapted = self._adapted(scheduled, estimate)
        return before.not_above(self._raised(scheduled, adapted, now_ns))

    def _raised(
        self, scheduled: ScheduledPulse, request: PulseRequest, now_ns: int
    ) -> PulseRequest:
        """Limits lower it where the person said too strong (`clearance.py`): this only raises,
        within what its frame leaves for it.
        """
        factor = self._feeling.factor(scheduled.electrode, now_ns)
        if factor <= 1.0:
            return request
        bounds = scheduled.bounds.raised(factor)
        most_ua = min(bounds.current_ua, request.current_of(bounds.charge_pc))
        raised_ua = min(int(request.current_ua * factor), most_ua)
        return request.at(max(request.current_ua, raised_ua))

    def _adapted(self, scheduled: ScheduledPulse, estimate: ElectrodeEstimate) -> PulseRequest:
        asked = self._asked(scheduled, estimate)
        counters = self._reporter.counters
        if not asked.is_possible:
            counters["impossible_requests"] += 1
            return scheduled.request
        cut = scheduled.bounds.in_slot(asked)
        if cut is not asked and cut != asked:
            counters["width_requests_cut"] += 1
        return cut

    def _asked(self, scheduled: ScheduledPulse, estimate: ElectrodeEstimate) -> PulseRequest:
        """The request after all stabilizers, in the order of the body-site file."""
        request, gave = scheduled.request, 1.0
        for stabilizer, is_judged in zip(self._stabilizers, self._is_judged, strict=True):
            before = request
            request = stabilizer.adapt(before, estimate)
            if is_judged and request is not before and before.charge_pc > 0:
                gave *= request.charge_pc / before.charge_pc
        self._feeling.laws_gave(scheduled.electrode, gave)
        return request

    def _pressure(self, electrode: int, now_ns: int) -> float | None:
        """A dead sensor is counted once for each electrode over it, until it is back."""
        kpa = self._pressure_source.kpa(electrode, now_ns)
        if kpa is not None:
            self._dead.discard(electrode)
        elif electrode not in self._dead and self._pressure_source.is_dead(electrode, now_ns):
            self._dead.add(electrode)
            self.rejected("pressure")
        return kpa

    def _skin_ohm(self, electrode: int, now_ns: int) -> float | None:
        """An expired estimate is counted once, until a pulse measures again."""
        skin_ohm = self._impedance.skin_ohm(electrode, now_ns)
        if skin_ohm is not None or not self._impedance.is_expired(electrode, now_ns):
            self._stale.discard(electrode)
        elif electrode not in self._stale:
            self._stale.add(electrode)
            self.rejected("old")
        return skin_ohm

    def estimate(
        self,
        electrode: int,
        now_ns: int,
        expected_ohm: float | None = None,
        *,
        is_probed_first: bool = False,
        phases: tuple[bool, ...] = (),
    ) -> ElectrodeEstimate:
        """All that stabilizers see of an electrode. `expected_ohm`: what a probe makes expected of
        its skin; nothing is less than that then, and the early estimate rises in proportion.
        `phases` of the pulse: of several calibrations, that of its polarity holds.
        """
        contact, impedance = self._contact, self._impedance
        state = contact.state(electrode, now_ns)
        if is_probed_first and state == "unknown":
            # A probe goes first and measures the contact; what depends on the contact is taken away
            # then.
            state = "closed"
        skin_ohm = self._skin_ohm(electrode, now_ns)
        if self._feeling.laws_off:
            # As where a measurement is rejected: each law goes back to the frame's pulse, slowly.
            skin_ohm = expected_ohm = None
        latest_ohm = early_ohm = latest_early_ohm = None
        if skin_ohm is not None:
            latest_ohm = impedance.last_ohm(electrode)
            early_ohm, latest_early_ohm = impedance.early_ohms(electrode)
        if expected_ohm is not None:
            risen_ohm = max(skin_ohm or 0.0, expected_ohm)
            if skin_ohm is not None and early_ohm is not None:
                early_ohm *= risen_ohm / skin_ohm
            skin_ohm, latest_ohm = risen_ohm, max(latest_ohm or 0.0, expected_ohm)
            latest_early_ohm = higher(early_ohm, latest_early_ohm)
        calibration = self._calibration
        if self._by_phases:
            calibration = self._by_phases.get(phases)
        person = None if calibration is None else calibration.electrode[electrode]
        return ElectrodeEstimate(
            electrode,
            now_ns,
            state,
            contact.firmness(electrode, now_ns),
            contact.undelivered_ua[electrode],
            skin_ohm,
            latest_ohm,
            impedance.at_ua(electrode),
            early_ohm,
            latest_early_ohm,
            impedance.is_estimated(electrode),
            None if person is None else person.resistance_ohm,
            None if person is None else person.comfortable_ua,
            self._is_reference_early,
            None if person is None else person.threshold_ua,
            self._pressure(electrode, now_ns),
            None if calibration is None else self._exponents[calibration.polarity],
        )

    def gain(self, scheduled: ScheduledPulse, requested: PulseRequest) -> float | None:
        """For reports: the requested charge in times of the frame's; None without stabilizers."""
        wanted_pc = scheduled.request.charge_pc if self._stabilizers else 0
        return round(requested.charge_pc / wanted_pc, 3) if wanted_pc else None

    def rejected(self, what: str) -> None:
        """Counted once, when it begins."""
        self._reporter.rejected(what)

    def update(self, electrode: int, samples: Samples, now_ns: int) -> None:
        """Passes on what a stimulus pulse measured. A rejection is counted once, when it begins,
        and only where a stabilizer uses the value.
        """
        quality = self._impedance.update(electrode, samples, now_ns)
        if quality is not None and self._stabilizers:
            self.rejected(quality)

    def reported_ohm_nf(self, electrode: int, now_ns: int) -> tuple[int | None, float | None]:
        """For reports: the skin's resistance in ohm and its capacitance in nF."""
        return self._impedance.reported_ohm_nf(electrode, now_ns)
