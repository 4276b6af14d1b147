"""The headroom of an electrode's pulses: what a frame may ask, and what stabilizers may request
beyond it.

Owns: the maxima for one pulse with its prepulse, probe and phases, the probe before it, and the
bounds of what stabilizers may request. Must not know: frames, schedules, hardware calls; what was
felt.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.files.array import Array
from etd.files.body_site import BodySite
from etd.protocol.errors import Refused
from etd.pulse.request import NO_GAIN, MaxGain, PulseBounds, PulseRequest
from etd.safety.limits import PersonLimits
from etd.safety.maxima import PC_PER_NC, Maxima


@dataclass(frozen=True, slots=True)
class PlanRules:
    """What planning knows besides the frame; made once per lease."""

    array: Array
    site: BodySite
    maxima: Maxima
    person: PersonLimits
    #: One step of the DAC.
    resolution_ua: float
    #: How far stabilizers may go beyond a frame; a plan keeps room for it.
    max_gain: MaxGain = NO_GAIN


class Headroom:
    def __init__(self, rules: PlanRules) -> None:
        self._rules = rules
        self._max_gain_of_sources = MaxGain(1.0, rules.max_gain.width, rules.max_gain.charge)
        stabilize = rules.site.stabilize
        self._is_probe_first = stabilize.probe_first
        self._prepulse = stabilize.prepulse
        self._prepulse_us = stabilize.prepulse_us
        # A calibration's caps were accepted with the site's prepulse: the shape is checked
        # (`etd.protocol.calibration`). A client's cap is a bare current, without a prepulse.
        is_led = self._prepulse is not None and rules.person.calibration is not None
        self._cap_led_part = self._prepulse.part if self._prepulse and is_led else 0.0
        self._accepted_us = rules.person.accepted_us

    def max_gain(self, *, is_level: bool) -> MaxGain:
        """How far stabilizers may go: beyond the current of a level, never beyond a current that
        the frame names, whatever their order.
        """
        return self._rules.max_gain if is_level else self._max_gain_of_sources

    def probe(
        self, electrode: int, request: PulseRequest, max_gain: MaxGain
    ) -> PulseRequest | None:
        """The probe before each pulse of the electrode, where the site has probes: no wider than
        the frame's pulse, or than the pulses that the cap was accepted with. None where the pulse
        can never be stronger than the probe.
        """
        rules, maxima = self._rules, self._rules.maxima
        probe_ua = min(maxima.probe_current_ua, rules.person.caps_ua[electrode])
        if not self._is_probe_first or request.current_ua * max_gain.current <= probe_ua:
            return None
        return PulseRequest(
            probe_ua, min(maxima.probe_width_us, request.width_us, self._accepted_us)
        )

    def bounds(
        self,
        request: PulseRequest,
        visits_hz: float,
        phases: int,
        probe: PulseRequest | None,
        max_gain: MaxGain,
    ) -> PulseBounds:
        """The bounds of a frame's pulse: what stabilizers may request, within the maxima. The
        charge bound does not depend on any resistance, so that a resistance measured too low cannot
        raise it.
        """
        rules, maxima = self._rules, self._rules.maxima
        width_us = int(request.width_us * max_gain.width)
        probe_us = 0 if probe is None else probe.width_us
        on_us = (maxima.on_us_per_s / visits_hz - probe_us) / phases
        allowed_us = min(maxima.width_us, rules.person.width_us, on_us)
        allowed_us -= self._prepulse_us
        charge_pc = request.current_ua * request.width_us
        allowed_pc = min(
            maxima.charge_pc - pc_of(probe),
            int((maxima.mean_current_ua * 1e6 / visits_hz - pc_of(probe)) / phases),
        )
        return PulseBounds(
            current_ua=max(
                request.current_ua,
                min(int(request.current_ua * max_gain.current), maxima.current_ua),
            ),
            cap_us=min(request.width_us, self._accepted_us),
            width_us=max(request.width_us, min(width_us, int(allowed_us))),
            charge_pc=max(charge_pc, min(int(charge_pc * max_gain.charge), allowed_pc)),
            prepulse_us=self._prepulse_us,
            cap_led_part=self._cap_led_part,
        )

    def check_minimum(self, electrode: int, current_ua: int) -> None:
        """Raises: Refused (`bad_frame`)."""
        if current_ua < self._rules.resolution_ua:
            raise Refused(
                "bad_frame",
                f"electrode {electrode}: {current_ua} uA is less than one step of this board's"
                f" source ({self._rules.resolution_ua:.1f} uA): send 0 for silence",
                electrode,
            )

    def check_narrow(self, electrode: int, current_ua: int, width_us: int) -> None:
        """Checks a current that the frame names. Raises: Refused (`bad_frame`)."""
        narrow = self._rules.site.stabilize.strength_duration
        if narrow is not None and width_us > narrow.width_us:
            raise Refused(
                "bad_frame",
                f"electrode {electrode}: this body site makes pulses of {width_us} us narrower and"
                f" stronger ([stabilize.strength_duration]), so that {current_ua} uA would be no"
                " upper bound:"
                f" send width_us of at most {narrow.width_us}, where the number is the current,"
                " or levels",
                electrode,
            )

    def check_maxima(
        self,
        electrode: int,
        current_ua: int,
        width_us: int,
        phases: int,
        visits_hz: float,
        probe_pc: int,
    ) -> None:
        """Raises: Refused (`over_maximum`, `board_cannot`). The charge of a probe counts to its
        pulse, its width does not: the current is off between them.
        """
        maxima = self._rules.maxima
        if width_us < maxima.min_width_us:
            raise Refused(
                "board_cannot",
                f"electrode {electrode}: width {width_us} us is less than the"
                f" {maxima.min_width_us} us of one word on this machine: send at least that",
                electrode,
            )
        width_most_us = min(maxima.width_us, self._rules.person.width_us)
        charge_pc = self.charge_pc(current_ua, width_us)
        mean_ua = (charge_pc * phases + probe_pc) * visits_hz / 1e6
        first_nc = (charge_pc + probe_pc) / PC_PER_NC
        for what, asked, most, unit in (
            ("current", current_ua, maxima.current_ua, "uA"),
            ("width", width_us + self._prepulse_us, width_most_us, "us"),
            ("charge of a pulse", first_nc, maxima.charge_pc / PC_PER_NC, "nC"),
            ("rate", visits_hz, maxima.rate_hz, "Hz"),
            ("mean current", mean_ua, maxima.mean_current_ua, "uA"),
        ):
            if asked > most:
                raise Refused(
                    "over_maximum",
                    f"electrode {electrode}: {what} {asked:g} {unit} is more than the"
                    f" maximum here, {most:g} {unit}",
                    electrode,
                )

    def charge_pc(self, current_ua: int, width_us: int) -> int:
        """The charge of one phase, its prepulse included."""
        prepulse_ua = 0 if self._prepulse is None else int(current_ua * self._prepulse.part)
        return current_ua * width_us + prepulse_ua * self._prepulse_us


def pc_of(probe: PulseRequest | None) -> int:
    """The charge of a probe, if there is one."""
    return 0 if probe is None else probe.current_ua * probe.width_us
