"""The request for a pulse that is due, before any limit.

Owns: where the request comes from: the frame, the stabilizers, or the stabilizers after a probe;
which probe goes before the pulse; and which silent electrodes are to be polled.
Must not know: limits, ledgers, hardware, states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from etd.engine.reporting import Reporter
from etd.engine.returns import Returns
from etd.engine.stimulus_adapter import StimulusAdapter
from etd.planning.schedule import DuePulse, Schedule
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.outcome import Clamp
from etd.pulse.measured import MAX_AGE_NS
from etd.pulse.request import PulseRequest
from etd.sensing.contact import ContactMap
from etd.sensing.pre_probe import PreProbe

#: Where looks are wanted, each silent electrode has one in so long.
_ALL_WITHIN_NS = MAX_AGE_NS * 4 // 5


class Requests:
    def __init__(
        self,
        adapter: StimulusAdapter,
        ahead: PreProbe,
        contact: ContactMap,
        returns: Returns,
        reporter: Reporter,
        *,
        is_quick: bool,
    ) -> None:
        """`is_quick`: the switch has time to spare for contact polls, and does not wear."""
        self._adapter = adapter
        self._pre_probe = ahead
        self._contact = contact
        self._returns = returns
        self._reporter = reporter
        self._is_quick = is_quick

    def of(self, due: DuePulse, now_ns: int) -> PulseRequest | None:
        """None: its own probe found the electrode open, and that is reported."""
        if due.after is not None:
            return self._after_probe(due, due.after.request, now_ns)
        scheduled = due.scheduled
        if due.purpose != "stimulus":
            return scheduled.request
        request = self._adapter.adapt(scheduled, now_ns)
        if request.current_ua == 0:
            # Report it here: no limit was involved, so no clamp reports it.
            self._reporter.nothing_requested(scheduled.electrode, scheduled.current_ua)
        return request

    def probe_before(self, due: DuePulse, given: PulseRequest) -> PulseRequest | None:
        """The probe before a pulse that limits and ledger let through; None where there is none."""
        if due.after is not None or due.scheduled.probe is None:
            return None
        return self._pre_probe.probe_of(due.scheduled, given)

    def _after_probe(self, due: DuePulse, before: PulseRequest, now_ns: int) -> PulseRequest | None:
        """Requests everything again for the same instant, so that nothing can have risen. An
        electrode that the probe has found open gets no pulse.
        """
        electrode = due.electrode
        if self._contact.is_touched[electrode] is False:
            self._reporter.clamped(
                Clamp(
                    electrode=electrode,
                    wanted_ua=before.current_ua,
                    allowed_ua=0,
                    reason="contact_open",
                    limited_by=electrode,
                )
            )
            return None
        expected_ohm = self._pre_probe.expected_ohm(electrode, now_ns)
        return self._adapter.readapt(due.scheduled, before, expected_ohm, now_ns)

    def polls(
        self, probes: Sequence[ScheduledPulse], schedule: Schedule, now_ns: int
    ) -> tuple[list[ScheduledPulse], int]:
        """The contact polls of silent electrodes that are due at the end of a scan, and how many of
        them must be made even when time is short: where pulses depend on what is known of their
        returns, as many as keep every silent electrode known, and all that may have their bound of
        net charge by what came back since they were read; or one where the switch has no time to
        spare. An electrode that the frame stimulates gets that frame's pulses, and no poll.
        """
        share, contact = self._returns.share, self._contact
        stimulated = () if schedule.is_waiting else schedule.plan.schedule
        active = {scheduled.electrode for scheduled in stimulated}
        silent = [scheduled for scheduled in probes if scheduled.electrode not in active]
        self._returns.scan_over(now_ns)
        if share.is_wanted:
            awaited = [
                scheduled
                for scheduled in silent
                if self._returns.is_poll_due(scheduled.electrode, now_ns)
            ]
            if awaited:
                awaited.sort(key=lambda scheduled: share.looked_ns(scheduled.electrode))
                owed = math.ceil(len(silent) * schedule.plan.period_ns / _ALL_WITHIN_NS)
                full = sum(self._returns.must_be_polled(it.electrode, now_ns) for it in awaited)
                return awaited, max(1, owed, full) if self._is_quick else 1
        if not self._adapter.needs_contact or not self._is_quick:
            return [], 0
        return [
            scheduled for scheduled in silent if contact.is_poll_due(scheduled.electrode, now_ns)
        ], 0
