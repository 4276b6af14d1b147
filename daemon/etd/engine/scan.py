"""Scan by scan: the way through the visits that are due, and a pause when busy.

Owns: which plan stands and which one comes, and what is looked at between two visits. Must not
know: what is due when (`standing.py`), how a visit is made, sockets, states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from etd.engine.duty import BusyClock
from etd.engine.plan import Plan
from etd.engine.reporting import Reporter
from etd.engine.standing import Standing, Turn
from etd.engine.visit import Visit
from etd.engine.visits import Visitor
from etd_hal.board import Board
from etd_hal.ports import Clock, Marker

#: A look with half-bridges takes less. Where relays move, one may make the next scan late.
_LOOK_TAKES_NS = 1_000_000
#: In a pause the watch is kept this often.
_LOOK_NS = 2_000_000


class Scanner:
    """Shows the standing frame."""

    def __init__(
        self,
        board: Board,
        clock: BusyClock,
        host_clock: Clock,
        marker: Marker,
        reporter: Reporter,
    ) -> None:
        """Frames expire on `host_clock`; all else is timed with the board's `clock`."""
        self._board = board
        self._clock = clock
        self._host_clock = host_clock
        self._marker = marker
        self._reporter = reporter
        self.standing: Standing | None = None
        self._is_under_way = False
        #: What came while a scan was under way: a plan, and when its frame expires.
        self._coming: tuple[Plan, int] | None = None
        #: Of the lease, in the order of the chain: for electrodes that a frame leaves silent.
        self.probes: Sequence[Visit] = ()
        self._is_rewritten = False

    def show(self, plan: Plan, expires_host_ns: int) -> None:
        """From the next start of a scan on, which is at once when no frame stands; what it lowers
        falls at once.
        """
        if self._is_under_way:
            if self._coming is not None:
                self._reporter.superseded()
            self._coming = plan, expires_host_ns
            if self.standing is not None:
                self.standing.lower(plan)
            return
        before = self.standing
        if before is not None and not before.is_begun:
            self._reporter.superseded()
        self._let_go()
        self.standing = Standing(plan, expires_host_ns, self._clock.now_ns(), before)

    def silence(self) -> None:
        """No frame stands any more, and none comes."""
        self._coming = None
        self._let_go()

    def _let_go(self) -> None:
        if self.standing is not None and self.standing.is_begun:
            self._reporter.frame_ended()
        self.standing = None

    def expire(self, host_ns: int) -> None:
        """Let go of a frame whose time is over."""
        if self._coming is not None and host_ns >= self._coming[1]:
            self._reporter.never_shown(self._coming[0].frame, self._clock.now_ns())
            self._coming = None
        standing = self.standing
        if standing is None:
            return
        has_expired = standing.has_expired(host_ns)
        if has_expired and not standing.is_begun:
            self._reporter.never_shown(standing.plan.frame, self._clock.now_ns())
        if has_expired or standing.has_had_its_pulses:
            self._let_go()

    def scan(
        self,
        visitor: Visitor,
        may_fire: Callable[[int], int | None],
        take_frames: Callable[[], None] = lambda: None,
    ) -> None:
        """One scan. `may_fire(now_ns)` is asked before every pulse; it gives the ceiling in uA, or
        None when firing must not go on (the frame may have gone by then). `take_frames` is called
        where newer ones are not to wait for the end: it may call `show`.

        Raises: BusError, GuardRefusal, BoardFault.
        """
        standing = self.standing
        if standing is None:
            return
        self._is_under_way = True
        try:
            self._scan(standing, visitor, may_fire, take_frames)
        finally:
            self._is_under_way = False
        coming, self._coming = self._coming, None
        if coming is not None:
            self.show(*coming)

    def _scan(
        self,
        standing: Standing,
        visitor: Visitor,
        may_fire: Callable[[int], int | None],
        take_frames: Callable[[], None],
    ) -> None:
        self._begin(standing)
        due = standing.due()
        if due and not self._is_rewritten:
            self._board.prepare(standing.plan.visits[due[0].place].selection, whole=True)
        self._is_rewritten = False
        for index, turn in enumerate(due):
            self._await(standing, turn, may_fire, take_frames)
            now_ns, ceiling_ua = self._rested(standing, may_fire)
            if ceiling_ua is None or self.standing is not standing:
                self._board.release()
                return
            visit = standing.visit_of(turn)
            if visit is None:
                continue
            self._board.prepare(visit.selection)
            begun_ns = visitor.visit(
                visit, ceiling_ua, now_ns, lambda: self._may_still(standing, may_fire)
            )
            if begun_ns is not None:
                standing.was_fired(turn.place, begun_ns)
            if index + 1 < len(due):
                self._board.prepare(standing.plan.visits[due[index + 1].place].selection)
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
        if self._board.switch.can_choose_returns and may_fire(self._clock.now_ns()) is None:
            return False
        return self.standing is standing and not standing.has_expired(self._host_clock.now_ns())

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
        self,
        standing: Standing,
        turn: Turn,
        may_fire: Callable[[int], int | None],
        take_frames: Callable[[], None],
    ) -> None:
        """Between the pulses of a burst, with the watch kept, and an eye on newer frames."""
        until_ns, now_ns = standing.earliest_ns(turn), self._clock.now_ns()
        if standing.is_long(now_ns):
            take_frames()
            now_ns = self._clock.now_ns()
        while (
            now_ns < until_ns
            and standing.visit_of(turn) is not None
            and may_fire(now_ns) is not None
            and self.standing is standing
        ):
            self._clock.sleep_until_ns(min(until_ns, now_ns + _LOOK_NS))
            take_frames()
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
