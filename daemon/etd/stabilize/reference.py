"""The resistance that impedance laws compare with: the calibration's, or else the first one seen.

Owns: which of the two, the first one seen, and what another current alone would make of it.
Must not know: what is made of the comparison.

The calibration's holds between days and between electrodes. Without it, the first believed
resistance at (nearly) the wanted current takes its place: then a law only keeps an electrode what
it was at the beginning, and does not make electrodes alike.

Skin resists less at higher currents (van Boxtel 1977; Rp ~ 1 / (I + bend), a shape by design), so
a reference is carried over to the current of the pulse that is compared with it. The calibration's
is taken to have been measured at the comfortable level.
"""

from __future__ import annotations

from etd.stabilize.pipeline import Known

#: The opening's ramp is not the wanted current.
_NEARLY = 0.9
BEND_UA = 8_000.0


class References:
    """One an electrode."""

    def __init__(self) -> None:
        self._first: dict[int, tuple[float, int]] = {}

    def forget(self) -> None:
        self._first.clear()

    def compared(self, known: Known, wanted_ua: int) -> tuple[float, float] | None:
        """(resistance now, reference), or None where either is not known."""
        if known.skin_ohm is None or known.state not in ("closed", "soft"):
            return None
        reference = self._reference(known, known.skin_ohm, wanted_ua)
        if reference is None:
            return None
        reference_ohm, at_ua = reference
        eased = (at_ua + BEND_UA) / (known.skin_at_ua + BEND_UA)
        return known.skin_ohm, reference_ohm * eased

    def _reference(self, known: Known, skin_ohm: float, wanted_ua: int) -> tuple[float, int] | None:
        if known.reference_ohm:
            return float(known.reference_ohm), known.reference_at_ua or known.skin_at_ua
        first = self._first.get(known.electrode)
        if first is None and known.state == "closed" and known.skin_at_ua >= _NEARLY * wanted_ua:
            first = self._first[known.electrode] = (skin_ohm, known.skin_at_ua)
        return first
