"""The frame that stands, scan by scan: due visits, their rates, expiry, and a pause when busy.

Owns: the schedule of the standing plan. Must not know: how a visit is made, sockets, states.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.engine.duty import BusyClock
from etd.engine.plan import Plan, Visit
from etd.engine.reporting import Reporter
from etd.engine.visits import Visitor
from etd_hal.board import Board
from etd_hal.ports import Marker

#: Rounding of rates may leave a visit this little short of due.
_ALMOST = 1e-9
#: In a pause the watch is kept this often.
_LOOK_NS = 2_000_000


class Standing:
    """A plan on show, until it expires or has had its pulses."""

    def __init__(self, plan: Plan, expires_ns: int, now_ns: int) -> None:
        self.plan = plan
        self.expires_ns = expires_ns
        self.next_ns = now_ns
        self.is_begun = False
        # The fastest is due in every scan, a slower one in its share of them; all in the first.
        fastest_hz = max((visit.rate_hz for visit in plan.visits), default=1.0)
        self._share = [visit.rate_hz / fastest_hz for visit in plan.visits]
        self._phase = [1.0 - share for share in self._share]
        pulses = plan.frame.pulses
        self._left = None if pulses is None else [pulses] * len(plan.visits)

    def has_expired(self, now_ns: int) -> bool:
        return now_ns >= self.expires_ns

    @property
    def has_had_its_pulses(self) -> bool:
        return self.is_begun and self._left is not None and not any(self._left)

    def due(self) -> list[tuple[int, Visit]]:
        """The visits of the scan that begins now, with their places in the plan."""
        found = []
        for place, visit in enumerate(self.plan.visits):
            self._phase[place] += self._share[place]
            if self._phase[place] < 1.0 - _ALMOST:
                continue
            self._phase[place] -= 1.0
            if self._left is None or self._left[place] > 0:
                found.append((place, visit))
        return found

    def was_fired(self, place: int) -> None:
        if self._left is not None:
            self._left[place] -= 1


class Scanner:
    """Shows the standing frame."""

    def __init__(self, board: Board, clock: BusyClock, marker: Marker, reporter: Reporter) -> None:
        self._board = board
        self._clock = clock
        self._marker = marker
        self._reporter = reporter
        self.standing: Standing | None = None
        self._is_rewritten = False

    def show(self, plan: Plan, expires_ns: int, now_ns: int) -> None:
        """From the next start of a scan, which is at once."""
        self.silence()
        self.standing = Standing(plan, expires_ns, now_ns)

    def silence(self) -> None:
        """No frame stands any more."""
        if self.standing is not None and self.standing.is_begun:
            self._reporter.frame_ended()
        self.standing = None

    def expire(self, now_ns: int) -> None:
        """Let go of a frame whose time is over."""
        standing = self.standing
        if standing is not None and (standing.has_expired(now_ns) or standing.has_had_its_pulses):
            self.silence()

    def scan(self, visitor: Visitor, may_fire: Callable[[int], int | None]) -> None:
        """One scan. `may_fire(now_ns)` is asked before every pulse; it gives the ceiling in uA, or
        None when firing must not go on (the frame may have gone by then).

        Raises: BusError, GuardRefusal, BoardFault.
        """
        standing = self.standing
        if standing is None:
            return
        self._begin(standing)
        due = standing.due()
        if due and not self._is_rewritten:
            self._board.prepare(due[0][1].selection, whole=True)
        self._is_rewritten = False
        for index, (place, visit) in enumerate(due):
            now_ns, ceiling_ua = self._rested(may_fire)
            if ceiling_ua is None or self.standing is not standing:
                self._board.release()
                return
            self._board.prepare(visit.selection)
            if visitor.visit(visit, ceiling_ua, now_ns):
                standing.was_fired(place)
            if index + 1 < len(due):
                self._board.prepare(due[index + 1][1].selection)
        self._end(standing)

    def _begin(self, standing: Standing) -> None:
        now_ns = self._clock.now_ns()
        frame = standing.plan.frame
        if not standing.is_begun:
            standing.is_begun = True
            self._reporter.frame_begun(frame, now_ns)
            if frame.sync:
                self._board.sync()
        self._reporter.scan_begun()
        self._marker.mark("frame", frame.seq, frame.tag)
        standing.next_ns += standing.plan.period_ns

    def _end(self, standing: Standing) -> None:
        """Once a scan the whole chain is rewritten: here, where the last rest covers some of it."""
        if standing.plan.visits:
            self._board.prepare(standing.plan.visits[0].selection, whole=True)
            self._is_rewritten = True
            self._board.release()
        now_ns = self._clock.now_ns()
        if standing.next_ns < now_ns:
            # Late: the next one begins now, and nothing is made up for.
            standing.next_ns = now_ns
            self._reporter.skipped(None, "overrun")

    def _rested(self, may_fire: Callable[[int], int | None]) -> tuple[int, int | None]:
        """The time now and the ceiling, after a pause if the loop has been too busy. The watch is
        kept all the while: heartbeat and stop lines cannot wait for a pause to end.
        """
        now_ns = self._clock.now_ns()
        ceiling_ua = may_fire(now_ns)
        pause_ns = self._clock.pause_until_ns(now_ns)
        if pause_ns is None:
            return now_ns, ceiling_ua
        self._reporter.skipped(None, "processor")
        while ceiling_ua is not None and now_ns < pause_ns:
            self._clock.sleep_until_ns(min(pause_ns, now_ns + _LOOK_NS))
            now_ns = self._clock.now_ns()
            ceiling_ua = may_fire(now_ns)
        return now_ns, ceiling_ua
