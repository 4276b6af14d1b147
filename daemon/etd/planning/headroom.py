"""The headroom of an electrode's pulses: what a frame may ask, and what stabilizers may request
beyond it.

Owns: the maxima for one pulse with its prepulse, probe and phases, the probe before it, and the
bounds of what stabilizers may request. Must not know: frames, schedules, hardware calls; what was
felt.

Most pulses of a frame differ by their currents alone: what they share is decided once
(`PulseKind`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from etd.files.array import Array
from etd.files.body_site import BodySite
from etd.protocol.errors import Refused
from etd.pulse.request import NO_GAIN, MaxGain, PulseBounds, PulseRequest
from etd.safety.limits import PersonLimits
from etd.safety.maxima import PC_PER_NC, Maxima
from etd.stabilize.said_electrode import MOST


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


class PulseKind:
    """What pulses have in common that differ by electrode and current alone, and what follows."""

    __slots__ = (
        "allowed_pc",
        "cap_us",
        "is_level",
        "max_gain",
        "passed_ua",
        "phases",
        "probe",
        "probe_pc",
        "rate_hz",
        "visits_hz",
        "widest_us",
        "width_us",
    )

    def __init__(
        self,
        width_us: int,
        phases: tuple[bool, ...],
        rate_hz: float,
        visits_hz: float,
        is_level: bool,
        max_gain: MaxGain,
        probe: PulseRequest | None,
        cap_us: int,
        widest_us: int,
        allowed_pc: int,
    ) -> None:
        self.width_us: Final = width_us
        self.phases: Final = phases
        self.rate_hz: Final = rate_hz
        #: Pulses a second, those of a burst included.
        self.visits_hz: Final = visits_hz
        self.is_level: Final = is_level
        self.max_gain: Final = max_gain
        self.probe: Final = probe
        self.probe_pc: Final = pc_of(probe)
        self.cap_us: Final = cap_us
        #: What stabilizers may request at most.
        self.widest_us: Final = widest_us
        self.allowed_pc: Final = allowed_pc
        #: The highest current that was found within the maxima. More current may exceed one, less
        #: never does: a lower one need not be checked.
        self.passed_ua = 0


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
        self, electrode: int, current_ua: int, width_us: int, *, is_level: bool
    ) -> PulseRequest | None:
        """The probe before each pulse of the electrode, where the site has probes: no wider than
        the frame's pulse, or than the pulses that the cap was accepted with. None where the pulse
        can never be stronger than the probe.
        """
        rules, maxima = self._rules, self._rules.maxima
        probe_ua = min(maxima.probe_current_ua, rules.person.caps_ua[electrode])
        strongest_ua = current_ua * self.max_gain(is_level=is_level).current
        if not self._is_probe_first or strongest_ua <= probe_ua:
            return None
        return PulseRequest(probe_ua, min(maxima.probe_width_us, width_us, self._accepted_us))

    @property
    def has_probes(self) -> bool:
        """Whether a probe may go before a pulse."""
        return self._is_probe_first

    def kind(
        self,
        width_us: int,
        phases: tuple[bool, ...],
        rate_hz: float,
        pulses: int,
        probe: PulseRequest | None,
        *,
        is_level: bool,
    ) -> PulseKind:
        """What pulses of this width, phases and rate have in common; `pulses` in a burst."""
        rules, maxima, max_gain = self._rules, self._rules.maxima, self.max_gain(is_level=is_level)
        visits_hz, count = rate_hz * pulses, len(phases)
        probe_us = 0 if probe is None else probe.width_us
        on_us = (maxima.on_us_per_s / visits_hz - probe_us) / count
        allowed_us = min(maxima.width_us, rules.person.width_us, on_us) - self._prepulse_us
        allowed_pc = min(
            maxima.charge_pc - pc_of(probe),
            int((maxima.mean_current_ua * 1e6 / visits_hz - pc_of(probe)) / count),
        )
        return PulseKind(
            width_us,
            phases,
            rate_hz,
            visits_hz,
            is_level,
            max_gain,
            probe,
            min(width_us, self._accepted_us),
            max(width_us, min(int(width_us * max_gain.width), int(allowed_us))),
            allowed_pc,
        )

    def bounds(self, current_ua: int, kind: PulseKind) -> PulseBounds:
        """The bounds of a frame's pulse: what stabilizers may request, within the maxima. The
        charge bound does not depend on any resistance, so that a resistance measured too low cannot
        raise it.
        """
        most_ua, gain = current_ua, kind.max_gain
        most_pc = charge_pc = current_ua * kind.width_us
        # A gain of 1 leaves the frame's own, whatever the maxima.
        if gain.current != 1.0:
            maximum_ua = self._rules.maxima.current_ua
            most_ua = max(current_ua, min(int(current_ua * gain.current), maximum_ua))
        if gain.charge != 1.0:
            most_pc = max(charge_pc, min(int(charge_pc * gain.charge), kind.allowed_pc))
        raised_ua = raised_pc = 0
        if kind.is_level and self._rules.site.felt_may_raise:
            # A word of the person's raises a level, and never a current that the frame names.
            raised_ua = min(int(most_ua * MOST), self._rules.maxima.current_ua)
            raised_pc = min(int(most_pc * MOST), kind.allowed_pc)
        return PulseBounds(
            most_ua,
            kind.cap_us,
            kind.widest_us,
            most_pc,
            self._prepulse_us,
            self._cap_led_part,
            raised_ua,
            raised_pc,
        )

    def check(self, electrode: int, current_ua: int, kind: PulseKind) -> None:
        """Raises: Refused, where a frame may not ask for this current in such a pulse."""
        if current_ua < self._rules.resolution_ua:
            self._refuse_below_a_step(electrode, current_ua)
        if current_ua > kind.passed_ua:
            if not kind.is_level:
                self._check_narrow(electrode, current_ua, kind.width_us)
            self._check_maxima(electrode, current_ua, kind)
            kind.passed_ua = current_ua

    def mean_pc(self, current_ua: int, kind: PulseKind) -> float:
        """The charge of its phases and its probe, times its rate; without those of a burst."""
        charge_pc = self.phase_pc(current_ua, kind.width_us)
        return kind.rate_hz * (charge_pc * len(kind.phases) + kind.probe_pc)

    def _refuse_below_a_step(self, electrode: int, current_ua: int) -> None:
        raise Refused(
            "bad_frame",
            f"electrode {electrode}: {current_ua} uA is less than one step of this board's"
            f" source ({self._rules.resolution_ua:.1f} uA): send 0 for silence",
            electrode,
        )

    def _check_narrow(self, electrode: int, current_ua: int, width_us: int) -> None:
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

    def _check_maxima(self, electrode: int, current_ua: int, kind: PulseKind) -> None:
        """Raises: Refused (`over_maximum`, `board_cannot`). The charge of a probe counts to its
        pulse, its width does not: the current is off between them.
        """
        maxima, width_us, probe_pc = self._rules.maxima, kind.width_us, kind.probe_pc
        if width_us < maxima.min_width_us:
            raise Refused(
                "board_cannot",
                f"electrode {electrode}: width {width_us} us is less than the"
                f" {maxima.min_width_us} us of one word on this machine: send at least that",
                electrode,
            )
        width_most_us = min(maxima.width_us, self._rules.person.width_us)
        charge_pc = self.phase_pc(current_ua, width_us)
        mean_ua = (charge_pc * len(kind.phases) + probe_pc) * kind.visits_hz / 1e6
        first_nc = (charge_pc + probe_pc) / PC_PER_NC
        for what, asked, most, unit in (
            ("current", current_ua, maxima.current_ua, "uA"),
            ("width", width_us + self._prepulse_us, width_most_us, "us"),
            ("charge of a pulse", first_nc, maxima.charge_pc / PC_PER_NC, "nC"),
            ("rate", kind.visits_hz, maxima.rate_hz, "Hz"),
            ("mean current", mean_ua, maxima.mean_current_ua, "uA"),
        ):
            if asked > most:
                raise Refused(
                    "over_maximum",
                    f"electrode {electrode}: {what} {asked:g} {unit} is more than the"
                    f" maximum here, {most:g} {unit}",
                    electrode,
                )

    def phase_pc(self, current_ua: int, width_us: int) -> int:
        """The charge of one phase, its prepulse included."""
        prepulse_ua = 0 if self._prepulse is None else int(current_ua * self._prepulse.part)
        return current_ua * width_us + prepulse_ua * self._prepulse_us


def pc_of(probe: PulseRequest | None) -> int:
    """The charge of a probe, if there is one."""
    return 0 if probe is None else probe.current_ua * probe.width_us
