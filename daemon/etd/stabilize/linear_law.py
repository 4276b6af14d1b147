"""Linear law: charge and energy of a pulse on straight lines over the resistance.

Owns: the law below. Must not know: how resistance is measured, how the slopes are fitted, limits.

At constant felt intensity the phase charge Q and the peak energy E = I^2 R T each lie on a straight
line over the peak resistance, and the lines of different intensities meet in one point (Akhtar,
Sombeck, Boyce and Bretl 2018, Science Robotics 3). A controller reads both off for the resistance
of the pulse before, and solves for current and width. I and Q are what the skin gets here, beside
the board's leak L: I = I_told x L / (L + R). With R0 the reference, and Q0, E0 of the wanted pulse
there:

    Q = Q0 (1 + charge_slope (R/R0 - 1))        E = E0 (1 + energy_slope (R/R0 - 1))
    I = E / (Q R)                               T = Q^2 R / E

Slopes relative to the wanted pulse make all lines meet on the axis. They belong to a person, and
come from two straight fits over 3 to 5 resistances (dry, moistened, light and firm pressure). Those
of the publication could not be read; 0 and 1, the defaults, hold the *delivered* current and width
where resistance falls, which takes out what the leak makes of it. Where resistance rises nothing is
added for what the leak takes: a reading that is too high, and an edge of skin that carries all,
must not get more than the lines say.

Current never rises above what is wanted: the width makes up for it, from Q alone, by at most
`max_widening`; below `min_width_us` the current falls. No line is followed below a tenth of what is
wanted. Without a believed resistance the pulse is what was wanted. Not all widening is believed
(`plausibility.py`). The told charge rises by at most `rise_per_s` of what is wanted, and falls at
once; a soft contact gets no more than that.
"""

from __future__ import annotations

from etd.pulse.request import PulseRequest
from etd.stabilize.law_settings import LinearLawSettings
from etd.stabilize.pipeline import ElectrodeEstimate, OnRejected, ignore_rejection
from etd.stabilize.resistance_law import ResistanceLaw
from etd.stabilize.rounding import as_charge

#: Below this part of what is wanted no line is followed: it would come to nothing, and then turn.
_LEAST = 0.1


class LinearLaw(ResistanceLaw):
    def __init__(
        self, law: LinearLawSettings, leak_ohm: float, on_rejected: OnRejected = ignore_rejection
    ) -> None:
        super().__init__(law, on_rejected)
        self._law = law
        self._leak_ohm = leak_ohm

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        current, charge = self._believed(request, estimate)
        charge = self._slewed(estimate, charge)
        if charge == current == 1.0:
            return request
        weaker = request.stepped(int(request.current_ua * current), request.width_us)
        width_us = request.width_us * charge / current
        return as_charge(weaker, width_us, self._min_width_us, self._max_widening)

    def _believed(self, request: PulseRequest, estimate: ElectrodeEstimate) -> tuple[float, float]:
        """Told current and charge, as factors; 1 where no resistance is believed."""
        compared = self._references.compared(estimate, request.current_ua)
        if compared is None:
            return 1.0, 1.0
        now_ohm, latest_ohm, reference_ohm = compared
        told, charge = self._solved(now_ohm, reference_ohm)
        if latest_ohm != now_ohm:
            latest_told, latest_charge = self._solved(latest_ohm, reference_ohm)
            told, charge = min(told, latest_told), min(charge, latest_charge)
        return min(1.0, told), self._plausible(estimate, charge)

    def _solved(self, now_ohm: float, reference_ohm: float) -> tuple[float, float]:
        """The same for one resistance, neither bounded nor doubted."""
        risen = now_ohm / reference_ohm - 1.0
        charge = max(_LEAST, 1.0 + self._law.charge_slope * risen)
        energy = max(_LEAST, 1.0 + self._law.energy_slope * risen)
        leaks = min(1.0, (self._leak_ohm + now_ohm) / (self._leak_ohm + reference_ohm))
        return energy / (charge * (1.0 + risen)) * leaks, charge * leaks
