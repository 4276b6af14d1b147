"""The allowed part of a requested pulse: the limits, then the ledger, then the pulse as bytes.

Owns: their order, which safety depends on: they come after the stabilizers, and nothing after them
increases anything. What they take away is reported here.

A pulse that is as the electrode's pulse before, and that no limit has lowered but what the person
said, is not made again while nothing has changed that it was made of. The ledger looks at each.
Must not know: what is due when, what a stabilizer does, states, sockets.
"""

from __future__ import annotations

import math
from typing import Final, get_args

from etd.engine.feeling import Feeling
from etd.engine.reporting import Reporter
from etd.engine.returns import Returns
from etd.firing import ReadyPulse, prepulse_of
from etd.planning.outlook import Outlook
from etd.planning.schedule import DuePulse
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.outcome import Clamp, ShortfallReason, Withheld, WithheldReason
from etd.pulse.request import PulseBounds, PulseRequest
from etd.safety.bookings import Entry
from etd.safety.ledger import Ledger, LedgerReason
from etd.safety.limits import Path, clamp_to_limits
from etd.safety.maxima import Maxima, MaximaInForce
from etd.safety.soft_start import SoftStart
from etd.sensing.contact import ContactMap
from etd_hal.board import Board
from etd_hal.phase import Pulse
from etd_hal.selection import Selection
from etd_hal.timing import Timing

_LEDGER_REASONS = get_args(LedgerReason)


class Cleared(ReadyPulse):
    """A pulse that limits and ledger let through, with its request and the clamp to report, if any.
    `leads`: the pulse is the probe before another, and leaves the electrode connected.
    """

    __slots__ = ("clamp", "leads", "request", "row")

    def __init__(
        self,
        entry: Entry,
        selection: Selection,
        phases: tuple[bool, ...],
        pulse: Pulse,
        given: PulseRequest,
        request: PulseRequest,
        clamp: Clamp | None = None,
        leads: bool = False,
    ) -> None:
        super().__init__(entry, selection, phases, pulse, given)
        self.request: Final = request
        self.clamp: Final = clamp
        self.leads: Final = leads
        #: What a record's rows of it have in common (`pulse_log.py`); empty until it is recorded.
        self.row = b""


class _Lead:
    """The probe before a cleared pulse, and the ledger's entry for both."""

    __slots__ = ("both", "cleared", "led", "probe")

    def __init__(self, led: Cleared, probe: PulseRequest, cleared: Cleared, both: Entry) -> None:
        self.led: Final = led
        self.probe: Final = probe
        self.cleared: Final = cleared
        self.both: Final = both


class _Repeatable:
    """A cleared pulse that no limit has lowered but `felt_ua`, and all that it was made of."""

    __slots__ = ("cleared", "felt_ua", "maxima", "path", "scheduled", "share", "timing")

    def __init__(
        self,
        cleared: Cleared,
        scheduled: ScheduledPulse,
        path: Path,
        share: float,
        maxima: Maxima,
        timing: Timing,
        felt_ua: int | None,
    ) -> None:
        self.cleared = cleared
        self.scheduled = scheduled
        self.path = path
        self.share = share
        self.maxima = maxima
        self.timing = timing
        self.felt_ua = felt_ua


class Clearance:
    def __init__(
        self,
        board: Board,
        maxima: MaximaInForce,
        ledger: Ledger,
        soft_start: SoftStart,
        contact: ContactMap,
        returns: Returns,
        reporter: Reporter,
        feeling: Feeling,
    ) -> None:
        self._board = board
        self._feeling = feeling
        self._maxima = maxima
        self._ledger = ledger
        self._soft_start = soft_start
        self._contact = contact
        self._returns = returns
        self._reporter = reporter
        #: By electrode, of its last pulse, and of its last one after a probe; see the module.
        self._alone: dict[int, _Repeatable] = {}
        self._led: dict[int, _Repeatable] = {}
        #: By electrode, the last probe before a pulse.
        self._leads: dict[int, _Lead] = {}
        #: By electrode, why it had no probe in the measurement under way.
        self._withheld: dict[int, WithheldReason] = {}

    def outlook(self, now_ns: int) -> Outlook:
        """What bounds a pulse that would be fired now."""
        soft_start, returns = self._soft_start, self._returns
        ceiling_ua, recontacts_ua = soft_start.ceilings(now_ns)

        def path(path: Path) -> Path:
            return returns.path_now(path, now_ns)

        def risen_after_ns(electrode: int, current_ua: int, period_ns: int) -> int | None:
            return soft_start.risen_after_ns(electrode, current_ua, period_ns, now_ns)

        touched, want = self._contact.is_touched, returns.share.want
        felt_ua = self._feeling.felt_ua if self._feeling.is_lowered else None
        net = self._ledger.net.states(now_ns)
        return Outlook(
            path,
            ceiling_ua,
            recontacts_ua,
            touched,
            risen_after_ns,
            want,
            felt_ua,
            net,
            are_returns_known=returns.share.are_all_known,
        )

    def limit(
        self, due: DuePulse, request: PulseRequest, ceiling_ua: int, now_ns: int
    ) -> Cleared | None:
        """What the limits leave of the request; None where that is nothing, and the reason is
        reported. `fit` follows.
        """
        scheduled = due.scheduled
        path, share = self._returns.of(scheduled, now_ns)
        cleared = self._again(due, request, path, share, ceiling_ua, now_ns)
        if cleared is None:
            cleared = self._limited(due, request, path, share, ceiling_ua, now_ns)
        if cleared is not None and due.purpose != "contact_poll":
            self._returns.watch(scheduled, request.current_ua, cleared.entry, now_ns)
        return cleared

    def fit(
        self, due: DuePulse, cleared: Cleared, probe: PulseRequest | None, now_ns: int
    ) -> Cleared | None:
        """The pulse that may be fired: what the limits have left or, where it has one, its probe,
        if the ledger has room for both. None where it has not, and that is reported.
        """
        found, entry = cleared, cleared.entry
        if probe is not None:
            lead = self._lead(due, cleared, probe)
            found, entry = lead.cleared, lead.both
        violation = self._ledger.first_violation(entry, now_ns)
        if violation is None:
            if self._withheld and due.purpose == "measurement":
                self._withheld.pop(due.scheduled.electrode, None)
            return found
        if due.purpose != "contact_poll":
            what: ShortfallReason = "net_charge" if violation == "net charge" else "ledger"
            self._reporter.not_fired(due.scheduled.electrode, what)
        if due.purpose == "measurement":
            self._withheld[due.scheduled.electrode] = violation
        return None

    def take_withheld(self, now_ns: int) -> tuple[Withheld, ...]:
        """The probes that the measurement which is over now went without."""
        room_ms = math.ceil(max(0, self._ledger.forgotten_ns() - now_ns) / 1e6)
        withheld, self._withheld = self._withheld, {}
        return tuple(
            Withheld(
                electrode=electrode,
                reason=reason,
                after_ms=room_ms if reason in _LEDGER_REASONS else None,
            )
            for electrode, reason in sorted(withheld.items())
        )

    def _again(
        self,
        due: DuePulse,
        request: PulseRequest,
        path: Path,
        share: float,
        ceiling_ua: int,
        now_ns: int,
    ) -> Cleared | None:
        """The electrode's last pulse, if this one is the same and no limit lowers it now."""
        scheduled = due.scheduled
        electrode = scheduled.electrode
        last = (self._alone if due.after is None else self._led).get(electrode)
        if (
            last is None
            or last.scheduled is not scheduled
            or last.path is not path
            or last.share != share
            or last.maxima is not self._maxima.now
            or last.timing is not self._board.timing
            or last.felt_ua != self._felt_ua(due, request)
        ):
            return None
        cleared = last.cleared
        if cleared.request is not request and cleared.request != request:
            return None
        current_ua = cleared.given.current_ua
        if current_ua > ceiling_ua or self._contact.is_touched[electrode] is False:
            return None
        recontact_ua = self._recontact_ua(due, now_ns)
        return cleared if recontact_ua is None or current_ua <= recontact_ua else None

    def _felt_ua(self, due: DuePulse, request: PulseRequest) -> int | None:
        """What is left since the person said too strong; what measures contact is not felt."""
        if due.purpose != "stimulus":
            return None
        scheduled = due.scheduled
        return self._feeling.felt_ua(
            scheduled.electrode,
            request.current_ua,
            may_be_raised=scheduled.bounds.may_be_raised,
        )

    def _bounds(self, due: DuePulse, now_ns: int) -> PulseBounds:
        """The frame's, higher where the person's word raised it."""
        scheduled = due.scheduled
        factor = self._feeling.factor(scheduled.electrode, now_ns)
        if factor <= 1.0 or due.purpose != "stimulus":
            return scheduled.bounds
        return scheduled.bounds.raised(factor)

    def _recontact_ua(self, due: DuePulse, now_ns: int) -> int | None:
        """A measurement of contact is as strong at each electrode, or it would measure nothing."""
        if due.purpose == "measurement":
            return None
        return self._soft_start.recontact_ua(due.scheduled.electrode, now_ns)

    def _limited(
        self,
        due: DuePulse,
        request: PulseRequest,
        path: Path,
        share: float,
        ceiling_ua: int,
        now_ns: int,
    ) -> Cleared | None:
        """The same, made anew."""
        scheduled, maxima = due.scheduled, self._maxima.now
        electrode, felt_ua = scheduled.electrode, self._felt_ua(due, request)
        current_ua, clamp = clamp_to_limits(
            path,
            request,
            maxima,
            ceiling_ua,
            self._recontact_ua(due, now_ns),
            self._contact.is_touched[electrode] is False,
            self._bounds(due, now_ns),
            scheduled.probe_pc,
            felt_ua,
        )
        given = request.at(current_ua)
        pulse = self._board.pulse(current_ua, given.width_us, prepulse_of(given))
        if pulse.code == 0:
            if due.purpose != "contact_poll":
                self._report_nothing(scheduled, request, clamp)
            if due.purpose == "measurement":
                reason = "felt" if clamp is None else clamp.reason
                self._withheld[electrode] = "resolution" if reason == "felt" else reason
            return None
        entry = _entry_of(scheduled, given, share, pulses=0 if due.after is not None else 1)
        selection, phases = scheduled.selection, scheduled.phases
        cleared = Cleared(entry, selection, phases, pulse, given, request, clamp)
        if clamp is None or clamp.reason == "felt":
            kept = self._alone if due.after is None else self._led
            kept[electrode] = _Repeatable(
                cleared, scheduled, path, share, maxima, self._board.timing, felt_ua
            )
        return cleared

    def _lead(self, due: DuePulse, cleared: Cleared, probe: PulseRequest) -> _Lead:
        """The probe before a cleared pulse: the same as last time, before the same pulse."""
        scheduled, entry = due.scheduled, cleared.entry
        last = self._leads.get(scheduled.electrode)
        if last is not None and last.led is cleared and last.probe is probe:
            return last
        both = Entry(
            entry.electrode,
            entry.charge_pc + probe.charge_pc,
            entry.on_us + probe.width_us,
            entry.returns,
            entry.share,
            entry.pulses,
            entry.net_pc + _way(scheduled) * probe.charge_pc,
        )
        pulse = self._board.pulse(probe.current_ua, probe.width_us)
        alone = Entry(
            scheduled.electrode,
            probe.charge_pc,
            probe.width_us,
            scheduled.returns,
            entry.share,
            net_pc=_way(scheduled) * probe.charge_pc,
        )
        selection, phases = scheduled.selection, scheduled.phases[:1]
        leading = Cleared(alone, selection, phases, pulse, probe, cleared.request, leads=True)
        lead = self._leads[scheduled.electrode] = _Lead(cleared, probe, leading, both)
        return lead

    def _report_nothing(
        self, scheduled: ScheduledPulse, request: PulseRequest, clamp: Clamp | None
    ) -> None:
        if clamp is not None:
            self._reporter.clamped(clamp)
        elif request.current_ua > 0:
            self._reporter.not_fired(scheduled.electrode, "resolution")


def _entry_of(
    scheduled: ScheduledPulse, given: PulseRequest, share: float, pulses: int = 1
) -> Entry:
    """The entry for all phases. `pulses` 0: its probe has booked the pulse already."""
    phases = len(scheduled.phases)
    on_us = given.whole_us * phases
    net_pc = _way(scheduled) * given.charge_pc if phases == 1 else 0
    charge_pc = given.charge_pc * phases
    return Entry(scheduled.electrode, charge_pc, on_us, scheduled.returns, share, pulses, net_pc)


def _way(scheduled: ScheduledPulse) -> int:
    """Of its first phase, and of its probe: 1 into the skin, -1 out of it."""
    return 1 if scheduled.phases[0] else -1
