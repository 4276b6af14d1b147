"""What is known of an electrode, put together, and what the stabilizers make of a wish with it.

Owns: gathering `Known` for one visit, asking, cutting what they ask for to the slot of the
visit, and telling what was cut or not believed. Must not know: limits, ledgers, hardware.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from msgspec import structs

from etd.calibration import Calibration
from etd.engine.contact import ContactMap
from etd.engine.impedance import ImpedanceMap, Samples
from etd.engine.reporting import Reporter
from etd.engine.visit import Visit
from etd.stabilize.contact import Contact
from etd.stabilize.pipeline import Known, Stabilizer, Wish, ask_all, higher, reach_of


class Pressed(Protocol):
    """Where the pressure at an electrode comes from."""

    def kpa(self, electrode: int, now_ns: int) -> float | None:
        """None where unknown: no sensor, an error, or stale."""
        ...

    def is_dead(self, electrode: int, now_ns: int) -> bool:
        """There is a sensor, and it says nothing."""
        ...


class Asker:
    """See the module. One a daemon; it forgets when the supply was off."""

    def __init__(
        self,
        stabilizers: Sequence[Stabilizer],
        contact: ContactMap,
        impedance: ImpedanceMap,
        pressed: Pressed,
        reporter: Reporter,
    ) -> None:
        self._stabilizers = tuple(stabilizers)
        self._contact = contact
        self._impedance = impedance
        self._pressed = pressed
        self._reporter = reporter
        self._calibration: Calibration | None = None
        self._is_reference_early = False
        self._dead: set[int] = set()
        self._old: set[int] = set()
        self.reach = reach_of(self._stabilizers)
        #: A law that makes more of a contact that stayed than of a new one.
        self.goes_by_contact = any(isinstance(one, Contact) for one in self._stabilizers)

    def serve(self, calibration: Calibration | None, is_early: bool = False) -> None:
        """Another person, perhaps: with this calibration, or without one. `is_early`: it was made
        with pulses that are too short for a sample at their end.
        """
        self._calibration, self._is_reference_early = calibration, is_early
        self._impedance.is_early_wanted = is_early
        self.forget()

    def forget(self) -> None:
        """The supply was off: whoever touched may have gone."""
        self._impedance.forget()
        self._old.clear()
        for stabilizer in self._stabilizers:
            stabilizer.forget()

    def wish(self, visit: Visit, now_ns: int) -> Wish:
        """What is wanted of this visit, all told: no wider than its slot."""
        if not self._stabilizers:
            return visit.wish
        known = self.known(visit.electrode, now_ns)
        if visit.probe is not None and known.state == "unknown":
            # A probe goes first and tells of the contact: what it does not find is taken away then.
            known = structs.replace(known, state="closed")
        return self._asked(visit, known)

    def wish_again(
        self, visit: Visit, before: Wish, expected_ohm: float | None, now_ns: int
    ) -> Wish:
        """The same, when a probe has told more of this very moment: with the skin resistance that
        it makes expected, where that is more than what is known, or what is known is too old.
        Never more than was wished for before the probe, whatever it says: no current and no width
        rises by it.
        """
        if not self._stabilizers:
            return before
        known = self.known(visit.electrode, now_ns)
        if expected_ohm is not None:
            known = _expecting(known, expected_ohm)
        return before.not_above(self._asked(visit, known))

    def _asked(self, visit: Visit, known: Known) -> Wish:
        asked = ask_all(self._stabilizers, visit.wish, known)
        counters = self._reporter.counters
        if not asked.is_possible:
            counters["impossible_wishes"] += 1
            return visit.wish
        cut = visit.most.in_slot(asked)
        if cut != asked:
            counters["width_wishes_cut"] += 1
        return cut

    def _pressure(self, electrode: int, now_ns: int) -> float | None:
        """A sensor that died is counted once for each electrode over it, until it is back."""
        kpa = self._pressed.kpa(electrode, now_ns)
        if kpa is not None:
            self._dead.discard(electrode)
        elif electrode not in self._dead and self._pressed.is_dead(electrode, now_ns):
            self._dead.add(electrode)
            self.not_believed("pressure")
        return kpa

    def _skin_ohm(self, electrode: int, now_ns: int) -> float | None:
        """What was believed and is too old is counted once, until a pulse tells anew."""
        skin_ohm = self._impedance.skin_ohm(electrode, now_ns)
        if skin_ohm is not None or not self._impedance.is_too_old(electrode, now_ns):
            self._old.discard(electrode)
        elif electrode not in self._old:
            self._old.add(electrode)
            self.not_believed("old")
        return skin_ohm

    def known(self, electrode: int, now_ns: int) -> Known:
        """All that stabilizers get to see."""
        contact, impedance = self._contact, self._impedance
        state = contact.state(electrode, now_ns)
        skin_ohm = self._skin_ohm(electrode, now_ns)
        person = None if self._calibration is None else self._calibration.electrode[electrode]
        return Known(
            electrode=electrode,
            is_touched=contact.is_touched[electrode],
            resistance_ohm=contact.resistance_ohm[electrode],
            voltage_v=contact.voltage_v[electrode],
            now_ns=now_ns,
            state=state,
            firmness=contact.firmness(electrode, now_ns),
            undelivered_ua=contact.undelivered_ua[electrode],
            skin_ohm=skin_ohm,
            latest_ohm=None if skin_ohm is None else impedance.last_ohm(electrode),
            skin_at_ua=impedance.at_ua(electrode),
            early_ohm=impedance.early_ohm(electrode, now_ns),
            latest_early_ohm=impedance.last_early_ohm(electrode, now_ns),
            is_estimated=impedance.is_estimated(electrode),
            reference_ohm=None if person is None else person.resistance_ohm,
            reference_at_ua=None if person is None else person.comfortable_ua,
            is_reference_early=self._is_reference_early,
            threshold_ua=None if person is None else person.threshold_ua,
            pressure_kpa=self._pressure(electrode, now_ns),
        )

    def not_believed(self, what: str) -> None:
        """Counted once, when it begins."""
        self._reporter.not_believed(what)

    def learn(self, electrode: int, samples: Samples, now_ns: int) -> None:
        """What a stimulus pulse said; that it is not believed is counted once, when it begins, and
        where somebody goes by it.
        """
        doubt = self._impedance.learn(electrode, samples, now_ns)
        if doubt is not None and self._stabilizers:
            self.not_believed(doubt)

    def told(self, electrode: int, now_ns: int) -> tuple[int | None, float | None]:
        """For reports: what the skin resists, in ohm, and its capacitance, in nF."""
        return self._impedance.told(electrode, now_ns)


def _expecting(known: Known, expected_ohm: float) -> Known:
    """With a higher resistance, by as much in what was estimated."""
    skin_ohm, early_ohm = known.skin_ohm, known.early_ohm
    risen_ohm = max(skin_ohm or 0.0, expected_ohm)
    if skin_ohm is not None and early_ohm is not None:
        early_ohm *= risen_ohm / skin_ohm
    return structs.replace(
        known,
        skin_ohm=risen_ohm,
        latest_ohm=max(known.latest_ohm or 0.0, expected_ohm),
        early_ohm=early_ohm,
        latest_early_ohm=higher(early_ohm, known.latest_early_ohm),
    )
