"""The resistance that impedance laws compare with: the calibration's, or else the first one seen.

Owns: which of the two, the first one seen, and what another current alone would make of it.
Must not know: what is made of the comparison.

The calibration's holds between days and between electrodes. Without it, the first believed
resistance at (nearly) the wanted current takes its place: then a law only keeps an electrode what
it was at the beginning, and does not make electrodes alike.

Like is compared with like. Of short pulses only the beginning is known, and what it makes expected
of their end is off by some 30 % where the skin's time constant is not the assumed one. So a
reference that such pulses told is compared with the beginning of whatever pulse there is; and with
a reference that wider pulses told, short ones are compared only where a wider one has told the
time constant. Otherwise there is no reference.

Skin resists less at higher currents (van Boxtel 1977; Rp ~ 1 / (I + bend), a shape by design), so
a reference is carried over to the current of the pulse that is compared with it. The calibration's
is taken to have been measured at the comfortable level.
"""

from __future__ import annotations

from typing import Final

from etd.pulse.measured import BEND_UA
from etd.stabilize.pipeline import ElectrodeEstimate

#: During the soft start the current is not the wanted one.
_NEARLY = 0.9


class _Reference:
    """`is_early`: estimated from the beginning of pulses."""

    __slots__ = ("at_ua", "is_early", "ohm")

    def __init__(self, ohm: float, at_ua: int, is_early: bool) -> None:
        self.ohm: Final = ohm
        self.at_ua: Final = at_ua
        self.is_early: Final = is_early


class References:
    """One an electrode."""

    def __init__(self) -> None:
        self._first: dict[int, _Reference] = {}

    def reset(self) -> None:
        self._first.clear()

    def compared(
        self, estimate: ElectrodeEstimate, wanted_ua: int
    ) -> tuple[float, float, float] | None:
        """(resistance now, that of the last pulse alone, reference), or None where any is not
        known. A comparison takes the one by which there is less: a mean delays a fall.
        """
        if estimate.skin_ohm is None or estimate.state not in ("closed", "soft"):
            return None
        reference = self._reference(estimate, wanted_ua)
        if reference is None:
            return None
        now_ohm, latest_ohm = (
            (estimate.early_ohm, estimate.latest_early_ohm)
            if reference.is_early
            else (_measured(estimate), estimate.latest_ohm)
        )
        if now_ohm is None:
            return None
        eased = (reference.at_ua + BEND_UA) / (estimate.skin_at_ua + BEND_UA)
        return now_ohm, latest_ohm or now_ohm, reference.ohm * eased

    def _reference(self, estimate: ElectrodeEstimate, wanted_ua: int) -> _Reference | None:
        at_ua = estimate.skin_at_ua
        if estimate.reference_ohm:
            at_ua = estimate.reference_at_ua or at_ua
            return _Reference(float(estimate.reference_ohm), at_ua, estimate.is_reference_early)
        first = self._first.get(estimate.electrode)
        if first is None and estimate.state == "closed" and at_ua >= _NEARLY * wanted_ua:
            ohm = estimate.early_ohm if estimate.is_estimated else estimate.skin_ohm
            if ohm is not None:
                first = self._first[estimate.electrode] = _Reference(
                    ohm, at_ua, estimate.is_estimated
                )
        return first


def _measured(estimate: ElectrodeEstimate) -> float | None:
    return None if estimate.is_estimated else estimate.skin_ohm
