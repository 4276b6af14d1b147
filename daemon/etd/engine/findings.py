"""What a fired pulse measured at its electrode, stored and reported.

Owns: which map gets which measurement of a pulse. Must not know: limits, ledgers, what is due,
states.
"""

from __future__ import annotations

from etd.engine.clearance import Cleared
from etd.engine.feeling import Feeling
from etd.engine.pulse_log import PulseLog
from etd.engine.reporting import Reporter
from etd.engine.returns import Returns
from etd.engine.stimulus_adapter import StimulusAdapter
from etd.planning.schedule import DuePulse
from etd.safety.maxima import MaximaInForce
from etd.safety.soft_start import SoftStart
from etd.sensing.contact import ContactMap
from etd.sensing.impedance import Samples
from etd.sensing.pre_probe import PreProbe
from etd_hal.phase import Pulse, PulseResult


class Findings:
    def __init__(
        self,
        maxima: MaximaInForce,
        soft_start: SoftStart,
        contact: ContactMap,
        returns: Returns,
        adapter: StimulusAdapter,
        ahead: PreProbe,
        reporter: Reporter,
        pulse_log: PulseLog,
        feeling: Feeling,
    ) -> None:
        self._feeling = feeling
        self._maxima = maxima
        self._soft_start = soft_start
        self._contact = contact
        self._returns = returns
        self._adapter = adapter
        self._pre_probe = ahead
        self._reporter = reporter
        self._pulse_log = pulse_log

    def of_probe(self, due: DuePulse, cleared: Cleared, result: PulseResult, asked_ns: int) -> None:
        """Stores what a probe before a pulse measured."""
        if self._pre_probe.update(due.electrode, cleared.pulse, result):
            self._adapter.rejected("probe")
        touches = self._contact.is_touched[due.electrode] is True
        self._returns.update(
            due.scheduled, cleared.pulse, result, touches=touches, is_followed=True
        )
        if self._pulse_log.is_on:
            seq = self._reporter.seq
            self._pulse_log.add((due, cleared, result, result, seq, asked_ns, 0, None, "unknown"))

    def of_pulse(
        self,
        due: DuePulse,
        cleared: Cleared,
        first: PulseResult,
        last: PulseResult,
    ) -> None:
        """Stores what the first and the last phase of a pulse measured."""
        electrode, pulse, contact = due.scheduled.electrode, cleared.pulse, self._contact
        if due.purpose == "stimulus":
            given_ua = cleared.given.current_ua
            self._soft_start.fired(electrode, given_ua, pulse.commanded_ua, last.ended_ns)
            part = cleared.given.charge_pc / max(1, due.scheduled.request.charge_pc)
            asked_ua, wanted_ua = self._asked_wanted_ua(due, cleared, last.ended_ns)
            lowered_by = None if cleared.clamp is None else cleared.clamp.reason
            self._feeling.fired(
                electrode,
                part,
                last.ended_ns,
                given_ua,
                wanted_ua,
                asked_ua,
                by_array=lowered_by == "soft_start",
                by_own=lowered_by == "recontact",
            )
        begun_ns, is_at_end = first.begun_ns, pulse.shape.has_end_sample
        was_touched = contact.is_touched[electrode]
        if contact.update(
            electrode, pulse.commanded_ua, last.voltage_v, begun_ns, is_at_end=is_at_end
        ):
            self._soft_start.touched_again(electrode)
        elif was_touched and not contact.is_touched[electrode] and not any(contact.is_touched):
            # Nothing is touched any more: it may be another hand that comes back.
            self._soft_start.restart()
        if due.purpose == "measurement":
            self._soft_start.found(electrode, is_touched=contact.is_touched[electrode] is True)
        if pulse.commanded_ua > self._maxima.now.probe_current_ua:
            # Before a second phase the skin is not at rest, so the first one is taken.
            probed_v = 0.0 if due.after is None else self._pre_probe.probed_v(electrode)
            self._adapter.update(electrode, _samples(pulse, first, probed_v), begun_ns)
        touches = contact.is_touched[electrode] is True
        self._returns.update(due.scheduled, pulse, first, touches=touches, is_followed=False)
        if due.purpose != "contact_poll":
            self._pre_probe.was_followed(electrode)

    def _asked_wanted_ua(self, due: DuePulse, cleared: Cleared, now_ns: int) -> tuple[int, int]:
        """What was asked for of this pulse, and what the person's word made of that, before any
        other limit, also where a cap left less of a rise.
        """
        electrode, current_ua = due.scheduled.electrode, cleared.request.current_ua
        bounds = due.scheduled.bounds
        factor = self._feeling.factor(electrode, now_ns)
        if factor > 1.0 and bounds.may_be_raised:
            raised, wanted_ua = bounds.raised(factor), current_ua
            if current_ua >= min(raised.current_ua, cleared.request.current_of(raised.charge_pc)):
                # Its bounds may have left less of the rise; else stabilizers have asked for less.
                wanted_ua = max(current_ua, int(bounds.current_ua * factor))
            return int(wanted_ua / factor), wanted_ua
        left_ua = self._feeling.word_ua(electrode, current_ua, may_be_raised=bounds.may_be_raised)
        return current_ua, current_ua if left_ua is None else left_ua

    def report(
        self,
        due: DuePulse,
        cleared: Cleared,
        first: PulseResult,
        last: PulseResult,
        asked_ns: int,
    ) -> None:
        """Reports a pulse of a frame; a contact poll is counted, and recorded, only. `asked_ns`: of
        the poll that its limits followed.
        """
        contact, pulse, begun_ns = self._contact, cleared.pulse, first.begun_ns
        electrode = due.scheduled.electrode
        delivered_ua, state = contact.delivered_ua(electrode), contact.state(electrode, begun_ns)
        resistance_ohm = contact.resistance_ohm[electrode]
        if self._pulse_log.is_on:
            seq = self._reporter.seq
            self._pulse_log.add(
                (due, cleared, first, last, seq, asked_ns, delivered_ua, resistance_ohm, state)
            )
        if due.purpose == "contact_poll":
            self._reporter.counters["contact_polls"] += 1
            return
        skin_ohm, capacitance_nf = self._adapter.reported_ohm_nf(electrode, begun_ns)
        row = (
            due.scheduled.request.current_ua,
            pulse.commanded_ua,
            delivered_ua,
            pulse.commanded_us,
            contact.voltage_v[electrode] or 0.0,
            resistance_ohm,
            state,
            pulse.prepulse_ua,
            0 if due.after is None else due.after.probe_ua,
            skin_ohm,
            capacitance_nf,
            self._adapter.gain(due.scheduled, cleared.request),
        )
        self._reporter.fired(electrode, begun_ns, row)
        if cleared.clamp is not None:
            # The clamp is reported with its pulse: a report may have gone out while relays moved.
            self._reporter.clamped(cleared.clamp)


def _samples(pulse: Pulse, result: PulseResult, probed_v: float) -> Samples:
    has_end = pulse.shape.has_end_sample
    # After a prepulse the skin does not begin at rest. Then only the sample at the end counts,
    # where there is one; else the early sample makes the resistance look too high, which lowers the
    # request.
    is_end_alone = has_end and pulse.prepulse_ua > 0
    return Samples(
        pulse.commanded_ua,
        pulse.shape.width_us,
        result.baseline_v,
        result.voltage_v if is_end_alone else result.early_v,
        result.voltage_v if has_end else None,
        probed_v,
    )
