"""What is requested of a pulse that is due, before any limit has seen it.

Owns: whose word it is: the frame's own, what stabilizers make of it, what they make of it after a
probe; which probe goes before it; and which silent electrodes are to be polled.
Must not know: limits, ledgers, hardware, states.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.engine.asking import Asker
from etd.engine.contact import ContactMap
from etd.engine.looking_ahead import LookingAhead
from etd.engine.reporting import Reporter
from etd.engine.schedule import DuePulse
from etd.engine.sharing import Sharing
from etd.engine.visit import Visit
from etd.protocol import Clamp
from etd.stabilize.pipeline import Wish


class Requests:
    """See the module."""

    def __init__(
        self,
        asker: Asker,
        ahead: LookingAhead,
        contact: ContactMap,
        sharing: Sharing,
        reporter: Reporter,
        *,
        is_quick: bool,
    ) -> None:
        """`is_quick`: the switch has time to spare for contact polls, and does not wear."""
        self._asker = asker
        self._ahead = ahead
        self._contact = contact
        self._sharing = sharing
        self._reporter = reporter
        self._is_quick = is_quick

    def of(self, due: DuePulse, now_ns: int) -> Wish | None:
        """None: its own probe found nothing to fire it at, and that is reported."""
        if due.after is not None:
            return self._after_probe(due, due.after.request, now_ns)
        scheduled = due.scheduled
        if due.purpose != "stimulus":
            return scheduled.wish
        request = self._asker.wish(scheduled, now_ns)
        if request.current_ua == 0:
            # Report it here: no limit was involved, so no clamp reports it.
            self._reporter.nothing_asked(scheduled.electrode, scheduled.current_ua)
        return request

    def probe_before(self, due: DuePulse, given: Wish) -> Wish | None:
        """The probe that goes before a pulse which limits and ledger let through, if one does."""
        return None if due.after is not None else self._ahead.probe_of(due.scheduled, given)

    def _after_probe(self, due: DuePulse, before: Wish, now_ns: int) -> Wish | None:
        """Everything is requested again, at the same instant, so that nothing can have risen. An
        electrode that the probe has found open gets nothing more.
        """
        electrode = due.electrode
        if self._contact.is_touched[electrode] is False:
            self._reporter.clamped(
                Clamp(
                    electrode=electrode,
                    wanted_ua=before.current_ua,
                    got_ua=0,
                    reason="contact_open",
                    limited_by=electrode,
                )
            )
            return None
        expected_ohm = self._ahead.expected_ohm(electrode, now_ns)
        return self._asker.wish_again(due.scheduled, before, expected_ohm, now_ns)

    def polls(self, silent: Sequence[Visit], now_ns: int) -> tuple[list[Visit], int]:
        """Which of these probes of silent electrodes are due, and how many of them are owed
        whatever the time: one at least where a clamped pulse waits for them.
        """
        sharing, contact = self._sharing, self._contact
        if sharing.is_wanted:
            awaited = [one for one in silent if sharing.is_due(one.electrode, now_ns)]
            if awaited:
                return awaited, 1
        if not self._asker.goes_by_contact or not self._is_quick:
            return [], 0
        return [one for one in silent if contact.is_look_due(one.electrode, now_ns)], 0
