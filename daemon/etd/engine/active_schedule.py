"""The schedule that is shown, and the next one, which waits for the end of the scan under way.

Owns: both schedules, and what happens to each when a frame comes, expires or is silenced. Must not
know: how a pulse is fired, the board, sockets.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.engine.accounts import OpenAccount
from etd.engine.reporting import Reporter
from etd.planning.plan import Plan
from etd.planning.schedule import Schedule
from etd.protocol.frame import Frame
from etd.protocol.outcome import FrameEnd
from etd.safety.maxima import Maxima
from etd_hal.ports import Clock


class ActiveSchedule:
    def __init__(self, clock: Clock, reporter: Reporter) -> None:
        """Frames expire on the machine's clock; all else is timed with the board's `clock`."""
        self._clock = clock
        self._reporter = reporter
        #: Of each electrode, by whatever frame: see `Schedule`.
        self._fired_ns: dict[int, int] = {}
        #: None: no frame stands.
        self.schedule: Schedule | None = None
        #: The schedule of the scan under way; differs from `schedule` once that was dropped: then
        #: nothing more of the scan may be fired.
        self.scanning: Schedule | None = None
        #: The plan that came while a scan was under way, and when its frame expires.
        self._coming: tuple[Plan, int] | None = None
        #: The last frame that an edge has begun, by its seq, and when the edge came.
        self._triggered: tuple[int, int] | None = None

    @property
    def is_waiting(self) -> bool:
        """Whether the frame that stands waits for an edge of the trigger."""
        schedule = self.schedule
        return schedule is not None and schedule.is_waiting

    def trigger(self, edges_ns: Sequence[int], host_ns: int) -> None:
        """The trigger has had edges at these times: a frame that waits for one begins now. Contact
        polls under way are left.
        """
        schedule = self.schedule
        if schedule is None or not schedule.is_waiting:
            return
        for edge_ns in edges_ns:
            if edge_ns >= schedule.waits_since_ns:
                plan, expires_host_ns = schedule.plan, schedule.expires_host_ns
                now_ns, lasts_ms = self._clock.now_ns(), plan.frame.lasts_ms
                if lasts_ms is not None:
                    over_host_ns = host_ns - (now_ns - edge_ns) + lasts_ms * 1_000_000
                    expires_host_ns = min(expires_host_ns, over_host_ns)
                self.schedule = Schedule(
                    plan, expires_host_ns, now_ns, schedule, edge_ns, self._fired_ns
                )
                self._triggered = plan.frame.seq, edge_ns
                return

    def triggered_ns(self, renewing: Frame) -> int | None:
        """The edge that has begun the frame which this one renews; None: none has."""
        found = self._triggered
        return None if found is None or found[0] != renewing.renews else found[1]

    def show(self, plan: Plan, expires_host_ns: int) -> None:
        """Shows the plan from the next scan on (at once when no frame stands). Currents that it
        lowers fall at once. A frame that waits for the trigger replaces the one before it at once,
        and is replaced at once.
        """
        if self.scanning is not None and not plan.frame.on_trigger and not self.is_waiting:
            if self._coming is not None:
                self._reporter.superseded()
            self._coming = plan, expires_host_ns
            if self.schedule is not None:
                self.schedule.lower(plan)
            return
        before = self.schedule
        if self._coming is not None or (before is not None and not before.is_begun):
            self._coming = None
            self._reporter.superseded()
        self._let_go("replaced")
        now_ns = self._clock.now_ns()
        self.schedule = Schedule(plan, expires_host_ns, now_ns, before, None, self._fired_ns)

    def fit(self, maxima: Maxima) -> None:
        """Called between two scans, when a timing calibration has changed the possible widths: the
        schedule keeps within them, or it is dropped and reported as refused.
        """
        schedule = self.schedule
        misfit = None if schedule is None else schedule.fit(maxima)
        if schedule is not None and misfit is not None:
            self._reporter.refused(schedule.plan.frame, misfit, self._clock.now_ns())
            self._let_go("silenced")

    def silence(self) -> None:
        """Drops the schedule that is shown and the one that waits."""
        self._coming = self._triggered = None
        self._let_go("silenced")

    def stands(self, seq: int) -> bool:
        """Whether that frame is shown, or waits for the end of the scan under way."""
        coming, schedule = self._coming, self.schedule
        if coming is not None and coming[0].frame.seq == seq:
            return True
        return schedule is not None and schedule.plan.frame.seq == seq

    def _let_go(self, why: FrameEnd, ago_ns: int = 0) -> None:
        """`ago_ns`: it was over so long ago."""
        if self.schedule is not None and self.schedule.is_begun:
            self._reporter.frame_ended(why, self._clock.now_ns() - ago_ns)
        self.schedule = None

    def expire(self, host_ns: int) -> None:
        """Drop a frame whose time is over."""
        if self._coming is not None and host_ns >= self._coming[1]:
            self._reporter.never_shown(self._coming[0].frame, self._clock.now_ns())
            self._coming = None
        schedule = self.schedule
        if schedule is None:
            return
        has_expired = host_ns >= schedule.expires_host_ns
        if has_expired and not schedule.is_begun:
            self._reporter.never_shown(schedule.plan.frame, self._clock.now_ns())
        if has_expired or schedule.has_had_its_pulses:
            if schedule.has_had_its_pulses:
                self._let_go("pulses")
            else:
                self._let_go("expired", host_ns - schedule.expires_host_ns)

    # --- the scan under way ------------------------------------------------------------------

    def begin_scan(self, schedule: Schedule, now_ns: int) -> None:
        if not schedule.is_begun and not schedule.is_waiting:
            frame, trigger_ns = schedule.plan.frame, schedule.trigger_ns
            account = OpenAccount(schedule.plan, now_ns, trigger_ns) if frame.account else None
            self._reporter.frame_begun(frame, now_ns, account, trigger_ns)
            if any(told.reason == "balanced" for told in schedule.plan.slowed):
                self._reporter.counters["balanced"] += 1
        self._reporter.scan_begun()
        schedule.begin_scan(now_ns)
        self.scanning = schedule

    def leave_scan(self) -> None:
        """The scan is over or was interrupted: the plan that came meanwhile is shown."""
        self.scanning = None
        coming, self._coming = self._coming, None
        if coming is not None:
            self.show(*coming)
