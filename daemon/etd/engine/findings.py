"""What a fired pulse says of its electrode, put where it is kept, and reported.

Owns: which of the maps hears what of a pulse. Must not know: limits, ledgers, what is due, states.
"""

from __future__ import annotations

from etd.engine.asking import Asker
from etd.engine.clearance import Cleared
from etd.engine.contact import ContactMap
from etd.engine.impedance import Samples
from etd.engine.looking_ahead import LookingAhead
from etd.engine.opening import Opening
from etd.engine.reporting import FiredPulse, Reporter
from etd.engine.schedule import DuePulse
from etd.engine.sharing import Sharing
from etd.engine.visit import Visit
from etd.maxima import MaximaInForce
from etd_hal.board import Pulse, Shot


class Findings:
    """See the module."""

    def __init__(
        self,
        maxima: MaximaInForce,
        opening: Opening,
        contact: ContactMap,
        sharing: Sharing,
        asker: Asker,
        ahead: LookingAhead,
        reporter: Reporter,
    ) -> None:
        self._maxima = maxima
        self._opening = opening
        self._contact = contact
        self._sharing = sharing
        self._asker = asker
        self._ahead = ahead
        self._reporter = reporter

    def of_probe(self, due: DuePulse, cleared: Cleared, shot: Shot) -> None:
        """Of one that leads into a pulse."""
        if self._ahead.learn(due.electrode, cleared.pulse, shot):
            self._asker.not_believed("probe")
        self._of_share(due.scheduled, shot.begun_ns)

    def of_pulse(self, due: DuePulse, cleared: Cleared, first: Shot, last: Shot) -> None:
        """Of its first and its last phase."""
        electrode, pulse = due.electrode, cleared.pulse
        if due.purpose != "contact_poll":
            given_ua = cleared.given.current_ua
            self._opening.fired(electrode, given_ua, pulse.told_ua, last.ended_ns)
        begun_ns, is_at_end = first.begun_ns, pulse.shape.has_end_sample
        if self._contact.learn(
            electrode, pulse.told_ua, last.voltage_v, begun_ns, is_at_end=is_at_end
        ):
            self._opening.touched_again(electrode)
        if pulse.told_ua > self._maxima.now.probe_current_ua:
            # Before a second phase the skin is not at rest: the first one tells more.
            probed_v = 0.0 if due.after is None else self._ahead.probed_v(electrode)
            self._asker.learn(electrode, _samples(pulse, first, probed_v), begun_ns)
        self._of_share(due.scheduled, begun_ns)
        if due.purpose != "contact_poll":
            self._ahead.was_followed(electrode)

    def _of_share(self, scheduled: Visit, begun_ns: int) -> None:
        electrode = scheduled.electrode
        touches = self._contact.is_touched[electrode] is True
        if scheduled.returns is None:
            self._sharing.learn(electrode, touches, begun_ns)
        elif not touches:
            self._sharing.lose(electrode)

    def report(self, due: DuePulse, cleared: Cleared, begun_ns: int) -> None:
        """A contact poll is counted; it is no pulse of a frame."""
        if due.purpose == "contact_poll":
            self._reporter.counters["looks"] += 1
            return
        contact, electrode, pulse = self._contact, due.electrode, cleared.pulse
        skin_ohm, capacitance_nf = self._asker.told(electrode, begun_ns)
        self._reporter.fired(
            FiredPulse(
                electrode=electrode,
                begun_ns=begun_ns,
                wanted_ua=due.scheduled.wish.current_ua,
                current_ua=pulse.told_ua,
                delivered_ua=contact.delivered_ua(electrode),
                width_us=pulse.told_us,
                voltage_v=contact.voltage_v[electrode] or 0.0,
                resistance_ohm=contact.resistance_ohm[electrode],
                contact=contact.state(electrode, begun_ns),
                prepulse_ua=pulse.prepulse_ua,
                probe_ua=0 if due.after is None else due.after.probe_ua,
                skin_ohm=skin_ohm,
                capacitance_nf=capacitance_nf,
            )
        )
        if cleared.clamp is not None:
            # With its pulse: a report may have gone out while relays moved.
            self._reporter.clamped(cleared.clamp)


def _samples(pulse: Pulse, shot: Shot, probed_v: float) -> Samples:
    has_end = pulse.shape.has_end_sample
    # After a prepulse the skin does not begin at rest: then the end alone tells, where there is
    # one; else the early sample makes the resistance look too high, which asks for less.
    is_end_alone = has_end and pulse.prepulse_ua > 0
    return Samples(
        told_ua=pulse.told_ua,
        width_us=pulse.shape.width_us,
        resting_v=shot.baseline_v,
        early_v=shot.voltage_v if is_end_alone else shot.early_v,
        end_v=shot.voltage_v if has_end else None,
        probed_v=probed_v,
    )
