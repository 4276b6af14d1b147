"""What of a requested pulse may be fired: the limits, then the ledger, then the pulse as bytes.

Owns: the order of these, which is the order of safety: whatever a stabilizer asks, they come after
it, and nothing after them increases anything. What they take away is told here.
Must not know: what is due when, what a stabilizer does, states, sockets.
"""

from __future__ import annotations

import msgspec

from etd.engine.contact import ContactMap
from etd.engine.limits import last_word
from etd.engine.opening import Opening
from etd.engine.reporting import Reporter
from etd.engine.schedule import DuePulse
from etd.engine.sharing import Sharing
from etd.engine.visit import Visit
from etd.firing import ReadyPulse, prepulse_of
from etd.ledger import Entry, Ledger
from etd.maxima import MaximaInForce
from etd.protocol import Clamp
from etd.stabilize.pipeline import Wish
from etd_hal.board import Board


class Cleared(ReadyPulse, frozen=True, kw_only=True):
    """A pulse that limits and ledger let through, of what was requested; and the clamp to report
    with it, if any. `leads`: it is the probe before a pulse, and leaves the electrode connected.
    """

    request: Wish
    clamp: Clamp | None = None
    leads: bool = False


class Clearance:
    """See the module."""

    def __init__(
        self,
        board: Board,
        maxima: MaximaInForce,
        ledger: Ledger,
        opening: Opening,
        contact: ContactMap,
        sharing: Sharing,
        reporter: Reporter,
    ) -> None:
        self._board = board
        self._maxima = maxima
        self._ledger = ledger
        self._opening = opening
        self._contact = contact
        self._sharing = sharing
        self._reporter = reporter

    def clear(self, due: DuePulse, request: Wish, ceiling_ua: int, now_ns: int) -> Cleared | None:
        """What may be fired of it; None, and reported why, where that is nothing."""
        scheduled, is_reported = due.scheduled, due.purpose != "contact_poll"
        share = self._share(scheduled, now_ns)
        current_ua, clamp = self._clamped(scheduled, request, share, ceiling_ua, now_ns)
        given = request.at(current_ua)
        pulse = self._board.pulse(current_ua, given.width_us, prepulse_of(given))
        if pulse.code == 0:
            if is_reported:
                self._report_nothing(scheduled, request, clamp)
            return None
        entry = _entry_of(scheduled, given, share, pulses=0 if due.after is not None else 1)
        if not self._fits(scheduled, entry, now_ns, is_reported=is_reported):
            return None
        if is_reported and clamp is not None and clamp.reason == "return_cap":
            self._sharing.want(now_ns)
        return Cleared(entry, scheduled.selection, pulse, given, request=request, clamp=clamp)

    def led_by(self, due: DuePulse, cleared: Cleared, probe: Wish, now_ns: int) -> Cleared | None:
        """The probe before a cleared pulse, where the ledger has room for both."""
        scheduled, entry = due.scheduled, cleared.entry
        both = msgspec.structs.replace(
            entry,
            charge_pc=entry.charge_pc + probe.charge_pc,
            on_us=entry.on_us + probe.width_us,
        )
        if not self._fits(scheduled, both, now_ns, is_reported=True):
            return None
        pulse = self._board.pulse(probe.current_ua, probe.width_us)
        alone = Entry(
            scheduled.electrode, probe.charge_pc, probe.width_us, scheduled.returns, entry.share
        )
        selection = scheduled.selection
        return Cleared(alone, selection, pulse, probe, request=cleared.request, leads=True)

    def _share(self, scheduled: Visit, now_ns: int) -> float:
        """What one return may carry: explicit ones each count as if alone."""
        if scheduled.returns is not None:
            return 1.0
        return self._sharing.largest(scheduled.electrode, now_ns)

    def _clamped(
        self, scheduled: Visit, request: Wish, share: float, ceiling_ua: int, now_ns: int
    ) -> tuple[int, Clamp | None]:
        electrode = scheduled.electrode
        return last_word(
            scheduled.path.with_share(share),
            request,
            self._maxima.now,
            ceiling_ua,
            self._opening.recontact_ua(electrode, now_ns),
            self._contact.is_touched[electrode] is False,
            scheduled.most,
            scheduled.probe_pc,
        )

    def _report_nothing(self, scheduled: Visit, request: Wish, clamp: Clamp | None) -> None:
        if clamp is not None:
            self._reporter.clamped(clamp)
        elif request.current_ua > 0:
            self._reporter.skipped(scheduled.electrode, "resolution")

    def _fits(self, scheduled: Visit, entry: Entry, now_ns: int, *, is_reported: bool) -> bool:
        if self._ledger.why_not(entry, now_ns) is None:
            return True
        if is_reported:
            self._sharing.want(now_ns)
            self._reporter.skipped(scheduled.electrode, "ledger")
        return False


def _entry_of(visit: Visit, given: Wish, share: float, pulses: int = 1) -> Entry:
    """All phases of it. `pulses` 0: the visit is booked already."""
    phases = len(visit.phases)
    on_us = given.whole_us * phases
    return Entry(visit.electrode, given.charge_pc * phases, on_us, visit.returns, share, pulses)
