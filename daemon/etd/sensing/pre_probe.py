"""A weak probe directly before a pulse, in the same visit: what has changed since the last one.

Owns: the probe of the visit before of each electrode, the comparison with it, when a probe is not
to be believed, and what skin resistance it makes expected of the pulse to come.
Must not know: what follows from it, limits, ledgers, clocks: time comes in.

Skin resists a weak current far more than a stimulus (van Boxtel 1977), so what a probe measures is
never taken for the skin's resistance. What counts is its ratio to the probe of the visit before,
whose stimulus pulse has told `skin_ohm`: both probes see the same skin at the same current, and a
contact that shrinks by half doubles both resistances. So

    expected skin_ohm = that of the last pulse x (probe now / probe then)

Only a rise counts: a resistance that a probe says has fallen waits for the pulse to confirm it. A
ratio within `RISEN` of 1 is what pulses see of each other anyhow, and tells nothing. Above `PEELED`
the contact has shrunk and is soft; above the board's open-circuit signature it is open.

After a pause that outlasts what is believed, the probe is the only one who can tell. Up to `PEELED`
it sees the contact that was there before, whoever may have lifted and come back; and `expected` is
what is known then. Without a probe to compare with, the contact is a new one.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.planning.scheduled_pulse import ScheduledPulse
from etd.sensing.contact import PEELED, ContactMap
from etd.sensing.impedance import ImpedanceMap
from etd.stabilize.max_age import MAX_SKIN_OHM
from etd.stabilize.pipeline import PulseRequest
from etd_hal.board import Pulse, PulseResult

#: A rise by less is not answered before the pulse has confirmed it.
RISEN = 1.05


@dataclass(frozen=True, slots=True)
class _ProbeSample:
    """What one probe measured; comparable to another only at the same current and width."""

    commanded_ua: int
    width_us: float
    voltage_v: float
    ohm: float


class PreProbe:
    """See the module."""

    def __init__(self, electrodes: int, contact: ContactMap, impedance: ImpedanceMap) -> None:
        self._electrodes = electrodes
        self._contact = contact
        self._impedance = impedance
        self.reset()

    def reset(self) -> None:
        """The supply was off: whoever touched may have gone."""
        #: Of the last visit whose pulse was fired; and of the visit under way.
        self._then: list[_ProbeSample | None] = [None] * self._electrodes
        self._now: list[_ProbeSample | None] = [None] * self._electrodes
        self._is_doubted = [False] * self._electrodes

    @staticmethod
    def probe_of(scheduled: ScheduledPulse, given: PulseRequest) -> PulseRequest | None:
        """What goes before a pulse that the limits let through: nothing before one that is as weak
        as a probe itself. It is within every limit that the pulse was held to.
        """
        probe = scheduled.probe
        if probe is None or given.current_ua <= probe.current_ua:
            return None
        return probe

    def update(self, electrode: int, probe: Pulse, result: PulseResult) -> bool:
        """What a probe says. Returns True when it is not believed, as that begins: a node that was
        not at rest before it, or that it does not move (the ADC stands still, or is not the
        node's). What was seen before is then compared with nothing any more.
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
        """What the skin will resist the pulse to come; None where it is what is known of it."""
        risen, skin_ohm = self._risen(electrode), self._impedance.last_ohm(electrode)
        if skin_ohm is None or risen is None:
            return None
        if risen <= RISEN:
            return skin_ohm if self._impedance.is_expired(electrode, now_ns) else None
        return min(skin_ohm * risen, MAX_SKIN_OHM)

    def probed_v(self, electrode: int) -> float:
        """What the probe of the visit under way came to; 0.0 where it was not believed."""
        seen = self._now[electrode]
        return 0.0 if seen is None else seen.voltage_v

    def was_followed(self, electrode: int) -> None:
        """The pulse was fired: it and its probe are what the next probe is compared with."""
        if self._now[electrode] is not None:
            self._then[electrode] = self._now[electrode]

    def _risen(self, electrode: int) -> float | None:
        """Probe over probe; None where they cannot be compared."""
        now, then = self._now[electrode], self._then[electrode]
        if now is None or then is None or then.ohm <= 0.0:
            return None
        if (now.commanded_ua, now.width_us) != (then.commanded_ua, then.width_us):
            return None
        return now.ohm / then.ohm
