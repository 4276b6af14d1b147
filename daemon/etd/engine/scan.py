"""The frame that stands, scan by scan: due visits, their rates, expiry, and a pause when busy.

Owns: the schedule of the standing plan. Must not know: how a visit is made, sockets, states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from etd.engine.duty import BusyClock
from etd.engine.plan import Plan
from etd.engine.reporting import Reporter
from etd.engine.visit import Visit
from etd.engine.visits import Visitor
from etd_hal.board import Board
from etd_hal.ports import Marker

#: Rounding of rates may leave a visit this little short of due.
_ALMOST = 1e-9
#: A scan that begins this late has been held up: more than waking late explains.
_LATE_NS = 2_000_000
#: A look with half-bridges takes less. Where relays move, one may make the next scan late.
_LOOK_TAKES_NS = 1_000_000
#: In a pause the watch is kept this often.
_LOOK_NS = 2_000_000


@dataclass(frozen=True, slots=True)
class Turn:
    """One visit of a scan, with its place in the plan; `is_again` after the first of a burst."""

    place: int
    visit: Visit
    is_again: bool = False


class Standing:
    """A plan on show, until it expires or has had its pulses."""

    def __init__(
        self, plan: Plan, expires_ns: int, now_ns: int, before: Standing | None = None
    ) -> None:
        """`before`: the one whose place it takes, if one stands. Rates go on across the two."""
        self.plan = plan
        self.expires_ns = expires_ns
        self.is_begun = False
        #: When the scan began in which an electrode was last visited, and the last one of all.
        self._fired_ns: dict[int, int] = {} if before is None else before._fired_ns
        self._scanned_ns: int | None = None if before is None else before._scanned_ns
        self.next_ns = now_ns
        if before is not None and self._scanned_ns is not None:
            due_ns = min(before.next_ns, self._scanned_ns + plan.period_ns)
            self.next_ns = max(now_ns, due_ns)
        # The fastest is due in every scan, a slower one in its share of them; all in the first.
        fastest_hz = max((visit.rate_hz for visit in plan.visits), default=1.0)
        self._share = [visit.rate_hz / fastest_hz for visit in plan.visits]
        self._phase = [
            self._rested(visit, share) - share
            for visit, share in zip(plan.visits, self._share, strict=True)
        ]
        pulses = plan.frame.pulses
        self._left = None if pulses is None else [pulses] * len(plan.visits)
        #: When the last pulse of each place began.
        self._begun_ns = [now_ns] * len(plan.visits)

    def _rested(self, visit: Visit, share: float) -> float:
        """How much of its period an electrode has rested when this frame begins; 1 is all of it.
        Less than half a scan short counts as all; the fastest are due in every scan.
        """
        fired_ns = self._fired_ns.get(visit.electrode)
        if fired_ns is None or share > 1.0 - _ALMOST:
            return 1.0
        return min(1.0, (self.next_ns - fired_ns) * visit.rate_hz / 1e9 + share / 2)

    def begin_scan(self, now_ns: int) -> None:
        """The next one follows a period later; after a stall nothing is made up for."""
        late_ns = now_ns - self.next_ns
        self._scanned_ns = now_ns
        self.next_ns = (now_ns if late_ns > _LATE_NS else self.next_ns) + self.plan.period_ns

    def was_paused(self, pause_ns: int) -> None:
        """What is still to come of this scan is later by so much, and so are the next ones."""
        self.next_ns += pause_ns

    def end_scan(self, now_ns: int) -> bool:
        """True if it came to its end too late for the next one, which then begins now; but a
        period from now after a stall, because electrodes may just have been visited.
        """
        late_ns = now_ns - self.next_ns
        if late_ns <= 0:
            return False
        self.next_ns = now_ns + (self.plan.period_ns if late_ns > self.plan.period_ns else 0)
        return True

    def has_expired(self, now_ns: int) -> bool:
        return now_ns >= self.expires_ns

    @property
    def has_had_its_pulses(self) -> bool:
        return self.is_begun and self._left is not None and not any(self._left)

    def due(self) -> list[Turn]:
        """The visits of the scan that begins now, burst after burst."""
        plan, wanted = self.plan, self._wanted()
        return [
            Turn(place, plan.visits[place], number > 0)
            for group in plan.groups
            for number in range(plan.pulses)
            for place in group
            if number < wanted[place]
        ]

    def _wanted(self) -> list[int]:
        """How many pulses each place gets in the scan that begins now."""
        found = []
        for place, share in enumerate(self._share):
            self._phase[place] += share
            is_due = self._phase[place] >= 1.0 - _ALMOST
            self._phase[place] -= is_due
            left = self.plan.pulses if self._left is None else self._left[place]
            found.append(min(left, self.plan.pulses) if is_due else 0)
        return found

    def earliest_ns(self, turn: Turn) -> int:
        """Within a burst an interval after the pulse before; otherwise at once."""
        return self._begun_ns[turn.place] + self.plan.interval_ns if turn.is_again else 0

    def was_fired(self, place: int, begun_ns: int) -> None:
        self._begun_ns[place] = begun_ns
        if self._scanned_ns is not None:
            self._fired_ns[self.plan.visits[place].electrode] = self._scanned_ns
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
        #: Of the lease, in the order of the chain: for electrodes that a frame leaves silent.
        self.probes: Sequence[Visit] = ()
        self._is_rewritten = False

    def show(self, plan: Plan, expires_ns: int, now_ns: int) -> None:
        """From the next start of a scan on, which is at once when no frame stands."""
        before = self.standing
        if before is not None and not before.is_begun:
            self._reporter.superseded()
        self.silence()
        self.standing = Standing(plan, expires_ns, now_ns, before)

    def silence(self) -> None:
        """No frame stands any more."""
        if self.standing is not None and self.standing.is_begun:
            self._reporter.frame_ended()
        self.standing = None

    def expire(self, now_ns: int) -> None:
        """Let go of a frame whose time is over."""
        standing = self.standing
        if standing is None:
            return
        if standing.has_expired(now_ns) and not standing.is_begun:
            self._reporter.never_shown(standing.plan.frame, now_ns)
        if standing.has_expired(now_ns) or standing.has_had_its_pulses:
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
            self._board.prepare(due[0].visit.selection, whole=True)
        self._is_rewritten = False
        for index, turn in enumerate(due):
            self._await(standing, standing.earliest_ns(turn), may_fire)
            now_ns, ceiling_ua = self._rested(standing, may_fire)
            if ceiling_ua is None or self.standing is not standing:
                self._board.release()
                return
            self._board.prepare(turn.visit.selection)
            begun_ns = visitor.visit(
                turn.visit, ceiling_ua, now_ns, lambda: self._may_still(standing, may_fire)
            )
            if begun_ns is not None:
                standing.was_fired(turn.place, begun_ns)
            if index + 1 < len(due):
                self._board.prepare(due[index + 1].visit.selection)
        if self._look_around(standing, visitor, may_fire):
            self._end(standing)

    def _look_around(
        self, standing: Standing, visitor: Visitor, may_fire: Callable[[int], int | None]
    ) -> bool:
        """Look at the silent electrodes whose turn it is: at one at least that a clamped pulse
        waits for, at others while there is time.

        False if firing must not go on.
        """
        active = {visit.electrode for visit in standing.plan.visits}
        silent = [probe for probe in self.probes if probe.electrode not in active]
        now_ns = self._clock.now_ns()
        waiting = visitor.awaited(silent, now_ns)
        must = min(len(waiting), 1)
        for index, probe in enumerate(waiting or visitor.due(silent, now_ns)):
            if index >= must and self._clock.now_ns() > standing.next_ns - _LOOK_TAKES_NS:
                break
            now_ns, ceiling_ua = self._rested(standing, may_fire)
            if ceiling_ua is None or self.standing is not standing:
                self._board.release()
                return False
            self._board.prepare(probe.selection, whole=index == 0)
            visitor.look(probe, ceiling_ua, now_ns, lambda: self._may_still(standing, may_fire))
        return True

    def _may_still(self, standing: Standing, may_fire: Callable[[int], int | None]) -> bool:
        """Asked when all is connected. Where that takes milliseconds, everything is looked at
        again; where it is done in one call, the frame's time is enough.
        """
        now_ns = self._clock.now_ns()
        if self._board.switch.can_choose_returns and may_fire(now_ns) is None:
            return False
        return self.standing is standing and not standing.has_expired(now_ns)

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
        standing.begin_scan(now_ns)

    def _end(self, standing: Standing) -> None:
        """Once a scan the whole chain is rewritten: here, where the last rest covers some of it."""
        if standing.plan.visits:
            self._board.prepare(standing.plan.visits[0].selection, whole=True)
            self._is_rewritten = True
            self._board.release()
        if standing.end_scan(self._clock.now_ns()):
            self._reporter.skipped(None, "overrun")

    def _await(
        self, standing: Standing, until_ns: int, may_fire: Callable[[int], int | None]
    ) -> None:
        """Between the pulses of a burst, with the watch kept."""
        now_ns = self._clock.now_ns()
        while now_ns < until_ns and may_fire(now_ns) is not None and self.standing is standing:
            self._clock.sleep_until_ns(min(until_ns, now_ns + _LOOK_NS))
            now_ns = self._clock.now_ns()

    def _rested(
        self, standing: Standing, may_fire: Callable[[int], int | None]
    ) -> tuple[int, int | None]:
        """The time now and the ceiling, after a pause if the loop has been too busy. The watch is
        kept all the while: heartbeat and stop lines cannot wait for a pause to end.
        """
        now_ns = self._clock.now_ns()
        ceiling_ua = may_fire(now_ns)
        pause_ns, begun_ns = self._clock.pause_until_ns(now_ns), now_ns
        if pause_ns is not None:
            self._reporter.skipped(None, "processor")
        while ceiling_ua is not None and pause_ns is not None:
            self._clock.sleep_until_ns(min(pause_ns, now_ns + _LOOK_NS))
            now_ns = self._clock.now_ns()
            ceiling_ua = may_fire(now_ns)
            pause_ns = self._clock.pause_until_ns(now_ns)
        standing.was_paused(now_ns - begun_ns)
        return now_ns, ceiling_ua
