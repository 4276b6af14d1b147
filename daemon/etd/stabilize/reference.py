"""The resistance that impedance laws compare with: the calibration's, or else the first one seen.

Owns: which of the two, and the first one seen. Must not know: what is made of the comparison.

The calibration's holds between days and between electrodes. Without it, the first believed
resistance at (nearly) the wanted current takes its place: then a law only keeps an electrode what
it was at the beginning, and does not make electrodes alike.
"""

from __future__ import annotations

from etd.stabilize.pipeline import Known

#: Skin resists less at higher currents: a pulse of the opening's ramp is no reference.
_NEARLY = 0.9


class References:
    """One an electrode."""

    def __init__(self) -> None:
        self._first_ohm: dict[int, float] = {}

    def forget(self) -> None:
        self._first_ohm.clear()

    def ratio(self, known: Known, wanted_ua: int) -> tuple[float, float] | None:
        """(resistance now, reference), or None where either is not known."""
        if known.skin_ohm is None or known.state not in ("closed", "soft"):
            return None
        if known.reference_ohm:
            return known.skin_ohm, float(known.reference_ohm)
        first_ohm = self._first_ohm.get(known.electrode)
        if first_ohm is None:
            if known.state != "closed" or known.skin_at_ua < _NEARLY * wanted_ua:
                return None
            first_ohm = self._first_ohm[known.electrode] = known.skin_ohm
        return known.skin_ohm, first_ohm
