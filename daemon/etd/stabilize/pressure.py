"""Pressure: pressing harder raises the current.

Owns: the law below. Must not know: which sensor lies where, ADCs, limits.

A sensor under the array lets the wearer set the strength by pressing (Kajimoto, Electro-tactile
Display, section 4.1): the sensation is then expected, and never a surprise. With p in kPa:

    g(p) = clip((p - p0) / (p1 - p0), 0, 1)        I = I_threshold + g x (I_wanted - I_threshold)

Below p0 there is no contact: nothing is asked for. Without a calibration I_threshold is 0. Users
tell levels apart best at about 100 kPa, which is p1; p0 of 10 kPa is by design. g rises by at most
`rise_per_s`, and falls at once. A sensor that is not known counts as pressed, inside that slew.
"""

from __future__ import annotations

from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.law_settings import PressureSettings
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.slew import SlewLimiter


class Pressure:
    def __init__(self, law: PressureSettings) -> None:
        self._law = law
        self.max_gain = MaxGain()
        self._pressed = SlewLimiter(0.0, law.rise_per_s)

    def reset(self) -> None:
        self._pressed.reset()

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        pressed = self._pressed.toward(estimate.electrode, self._part(estimate), estimate.now_ns)
        if estimate.pressure_kpa is not None and estimate.pressure_kpa < self._law.none_kpa:
            return request.stepped(0, request.width_us)
        if pressed >= 1.0:
            return request
        least_ua = min(estimate.threshold_ua or 0, request.current_ua)
        current_ua = least_ua + int((request.current_ua - least_ua) * pressed)
        return request.stepped(current_ua, request.width_us)

    def _part(self, estimate: ElectrodeEstimate) -> float:
        law, kpa = self._law, estimate.pressure_kpa
        if kpa is None:
            return 1.0
        return min(1.0, max(0.0, (kpa - law.none_kpa) / (law.full_kpa - law.none_kpa)))
