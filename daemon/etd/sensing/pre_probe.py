"""A weak probe directly before a pulse: what has changed since the pulse before.

Owns: the last probe of each electrode, the comparison with it, when a probe is rejected, and the
skin resistance that it predicts for the pulse to come.
Must not know: what follows from it, limits, ledgers, clocks: time comes in.

Skin resists a weak current far more than a stimulus (van Boxtel 1977), so what a probe measures is
never taken for the skin's resistance. What counts is its ratio to the probe before, whose stimulus
pulse has measured `skin_ohm`: both probes see the same skin at the same current, and a contact that
shrinks by half doubles both resistances. So

    expected skin_ohm = that of the last pulse x (probe now / probe then)

Only a rise counts: a fall waits for the pulse to confirm it. A ratio within `RISEN` of 1 is within
what pulses vary, and says nothing. Above `PEELED` the contact has shrunk and is soft; above the
board's open-circuit signature it is open.

After a pause longer than MAX_AGE_NS only the probe can tell whether the contact is the one from
before. Up to `PEELED` it is, even if the finger has lifted and come back; `expected` is then the
estimate. Without a probe to compare with, the contact is a new one.
"""

from __future__ import annotations

from typing import Final

from etd.planning.scheduled_pulse import ScheduledPulse
from etd.pulse.measured import MAX_SKIN_OHM
from etd.pulse.request import PulseRequest
from etd.sensing.contact import PEELED, ContactMap
from etd.sensing.impedance import ImpedanceMap
from etd_hal.phase import Pulse, PulseResult

#: A smaller rise has no effect before the pulse has confirmed it.
RISEN = 1.05


class _ProbeSample:
    """The measurement of a probe; comparable to another only at the same current and width."""

    __slots__ = ("commanded_ua", "ohm", "voltage_v", "width_us")

    def __init__(self, commanded_ua: int, width_us: float, voltage_v: float, ohm: float) -> None:
        self.commanded_ua: Final = commanded_ua
        self.width_us: Final = width_us
        self.voltage_v: Final = voltage_v
        self.ohm: Final = ohm


class PreProbe:
    def __init__(self, electrodes: int, contact: ContactMap, impedance: ImpedanceMap) -> None:
        self._electrodes = electrodes
        self._contact = contact
        self._impedance = impedance
        self.reset()

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        #: The probe before the last fired pulse, and the probe of the pulse to come.
        self._then: list[_ProbeSample | None] = [None] * self._electrodes
        self._now: list[_ProbeSample | None] = [None] * self._electrodes
        self._is_doubted = [False] * self._electrodes

    @staticmethod
    def probe_of(scheduled: ScheduledPulse, given: PulseRequest) -> PulseRequest | None:
        """The probe before a pulse that the limits let through; None before a pulse as weak as a
        probe. A probe is within every limit that the pulse was held to.
        """
        probe = scheduled.probe
        if probe is None or given.current_ua <= probe.current_ua:
            return None
        return probe

    def update(self, electrode: int, probe: Pulse, result: PulseResult) -> bool:
        """Take the measurement of a probe. Returns True when a rejection begins: the node was not
        at rest before the probe, or does not move with it (the ADC is stuck, or reads another
        node). The last probe is then dropped.
        """
        was_doubted = self._is_doubted[electrode]
        self._is_doubted[electrode] = self._impedance.is_adc_suspect(
            result.baseline_v, result.early_v, result.voltage_v
        )
        self._now[electrode] = None
        if self._is_doubted[electrode]:
            self._then[electrode] = None
            return not was_doubted
        contact = self._contact
        ohm = contact.seen_ohm(probe.commanded_ua, result.voltage_v)
        seen = _ProbeSample(
            probe.commanded_ua,
            probe.shape.width_us,
            result.voltage_v,
            MAX_SKIN_OHM if ohm is None else ohm,
        )
        self._now[electrode] = seen
        risen = self._risen(electrode)
        if risen is not None and risen <= PEELED:
            contact.is_as_before(electrode, result.begun_ns)
        contact.update_touch(electrode, probe.commanded_ua, result.voltage_v, result.begun_ns)
        if contact.is_touched[electrode] and risen is not None and risen > PEELED:
            contact.shrank(electrode, result.begun_ns)
        return False

    def expected_ohm(self, electrode: int, now_ns: int) -> float | None:
        """The predicted skin resistance of the pulse to come; None where the estimate holds."""
        risen, skin_ohm = self._risen(electrode), self._impedance.last_ohm(electrode)
        if skin_ohm is None or risen is None:
            return None
        if risen <= RISEN:
            return skin_ohm if self._impedance.is_expired(electrode, now_ns) else None
        return min(skin_ohm * risen, MAX_SKIN_OHM)

    def probed_v(self, electrode: int) -> float:
        """The voltage of the probe before the pulse to come; 0.0 where it was rejected."""
        seen = self._now[electrode]
        return 0.0 if seen is None else seen.voltage_v

    def was_followed(self, electrode: int) -> None:
        """The pulse was fired: the next probe is compared with its probe."""
        if self._now[electrode] is not None:
            self._then[electrode] = self._now[electrode]

    def _risen(self, electrode: int) -> float | None:
        """The resistance of this probe over the last one's; None where they cannot be compared."""
        now, then = self._now[electrode], self._then[electrode]
        if now is None or then is None or then.ohm <= 0.0:
            return None
        if (now.commanded_ua, now.width_us) != (then.commanded_ua, then.width_us):
            return None
        return now.ohm / then.ohm
