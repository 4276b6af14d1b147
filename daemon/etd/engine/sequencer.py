"""Which pulse is due next, and what happens where none is: waits, pauses, the end of a scan.

Owns: the way through scans and measurements, from the schedule's next pulse to the call that waits
for it. Must not know: how much of a pulse may be fired, what a pulse measures, sockets.
"""

from __future__ import annotations

from etd.engine.components import Components
from etd.engine.poller import Poller
from etd.engine.supervisor import Supervisor
from etd.planning.schedule import DuePulse, Schedule
from etd_hal.selection import Selection

#: Between two polls when nothing is due; the heartbeat's monostable needs edges then too.
TICK_NS = 1_000_000
#: More than a contact poll with half-bridges takes. With relays, a poll may make the next scan
#: late.
_CONTACT_POLL_NS = 1_000_000
#: Poll period in a pause, and between the pulses of a burst.
_POLL_NS = 2_000_000


class Sequencer:
    """See the module."""

    def __init__(self, components: Components, supervisor: Supervisor, poller: Poller) -> None:
        self._clock = components.clock
        self._board = components.board
        self._marker = components.backend.marker
        self._reporter = components.reporter
        self._active = components.active
        self._soft_start = components.soft_start
        self._firing = components.firing
        self._requests = components.requests
        self._source_check = components.source_check
        self._supervisor = supervisor
        self._poller = poller
        self._is_pausing = False
        #: The end of the scan before has rewritten the chain.
        self._is_rewritten = False

    @property
    def is_between_scans(self) -> bool:
        """Neither a scan nor a measurement of contact is under way."""
        power_up = self._supervisor.power_up
        return self._active.scanning is None and (power_up is None or not power_up.is_measuring)

    def leave(self) -> None:
        """Leaves the scan under way after a fault."""
        self._is_pausing = False
        self._active.leave_scan()

    def next_due(self, now_ns: int) -> DuePulse | None:
        """None: no pulse is due yet; the call has waited, or begun or left a scan."""
        schedule = self._active.scanning
        if schedule is not None:
            if schedule is self._active.schedule:
                return self._next_of_scan(schedule, now_ns)
            self._board.release()
            self._active.leave_scan()
            return None
        power_up = self._supervisor.power_up
        if power_up is not None and power_up.is_measuring:
            return power_up.next_due()
        self._poller.take_frames()
        self._between_scans(self._clock.now_ns())
        return None

    def _next_of_scan(self, schedule: Schedule, now_ns: int) -> DuePulse | None:
        if not self._is_pausing:
            if schedule.is_long(now_ns):
                self._poller.take_frames_within()
                if self._active.is_interrupted:
                    # Frames are read with polls in between, and a poll may have ended the scan.
                    return None
            if schedule.plan.pulses > 1 and self._wait_for_burst(schedule.earliest_ns(), now_ns):
                return None
        pause_ns = self._clock.pause_until_ns(now_ns)
        if pause_ns is not None:
            if not self._is_pausing:
                self._reporter.not_fired(None, "processor")
            self._is_pausing = True
            self._clock.sleep_until_ns(min(pause_ns, now_ns + _POLL_NS))
            schedule.was_paused(self._clock.now_ns() - now_ns)
            return None
        self._is_pausing = False
        due = schedule.next_due()
        if due is None:
            self._wind_up(schedule)
        return due

    def _wait_for_burst(self, earliest_ns: int, now_ns: int) -> bool:
        """True if the next pulse of a burst is not due yet; then some of the time is slept."""
        if now_ns >= earliest_ns:
            return False
        self._clock.sleep_until_ns(min(earliest_ns, now_ns + _POLL_NS))
        return True

    def _between_scans(self, now_ns: int) -> None:
        power_up = self._supervisor.power_up
        if power_up is not None and self._supervisor.step_power_up(power_up, now_ns):
            return
        schedule, is_armed = self._active.schedule, self._supervisor.states.state == "ARMED"
        if is_armed and self._source_check.is_due(now_ns):
            self._check_source(now_ns)
            return
        if schedule is None or not is_armed:
            self._doze_until(now_ns + TICK_NS)
            return
        if now_ns < schedule.next_ns:
            self._wait_for(schedule.next_ns, now_ns + TICK_NS)
            return
        if self._firing.has_drifted:
            self._calibrate_again()
        self._poller.poll_stop_levels()
        if self._active.schedule is not None:
            self._begin_scan(self._active.schedule)

    def _check_source(self, now_ns: int) -> None:
        """Raises: BusError, GuardRefusal, BoardFault."""
        fault = self._source_check.check(now_ns)
        if fault is not None:
            raise fault

    def _wait_for(self, next_ns: int, tick_ns: int) -> None:
        """A scan begins on time; a poll between two scans may be late by half a tick."""
        if next_ns > tick_ns + TICK_NS // 2:
            self._doze_until(tick_ns)
            return
        self._reporter.scan_report(self._clock.now_ns(), self._soft_start.ceiling_ua)
        self._clock.sleep_until_ns(next_ns)

    def _doze_until(self, deadline_ns: int) -> None:
        self._reporter.scan_report(self._clock.now_ns(), self._soft_start.ceiling_ua)
        self._clock.doze_until_ns(deadline_ns)

    def _calibrate_again(self) -> None:
        self._board.calibrate(lambda: self._poller.beat(self._clock.now_ns()))
        self._firing.reset_drift()
        self._reporter.counters["recalibrated"] += 1
        self._supervisor.plan_anew()

    # --- the way through a scan --------------------------------------------------------------

    def _begin_scan(self, schedule: Schedule) -> None:
        frame, is_first = schedule.plan.frame, not schedule.is_begun
        self._active.begin_scan(schedule, self._clock.now_ns())
        self._is_pausing = False
        if is_first and frame.sync:
            self._board.sync()
        self._marker.mark("frame", frame.seq, frame.tag)
        upcoming = schedule.upcoming
        if upcoming is not None and not self._is_rewritten:
            self._board.prepare(upcoming.selection, whole=True)
        self._is_rewritten = False
        if upcoming is None:
            self._wind_up(schedule)

    def fired(self, due: DuePulse, begun_ns: int) -> None:
        """The pulse began at `begun_ns`: go on to the next."""
        schedule = self._active.scanning
        if due.purpose == "stimulus" and schedule is not None:
            schedule.was_fired(due, begun_ns)
        self._pass_on(due)

    def not_fired(self, due: DuePulse) -> None:
        """Limits, the ledger or a poll have kept it from being fired, and that is reported."""
        if due.after is not None:
            self._reporter.counters["probes_alone"] += 1
        self._pass_on(due)

    def _pass_on(self, due: DuePulse) -> None:
        """Go on to the next pulse, which is shifted in while this electrode rests."""
        if due.purpose == "measurement":
            self._supervisor.pass_on_measuring(due)
            return
        schedule = self._active.scanning
        if schedule is None:
            return
        schedule.advance()
        upcoming = schedule.upcoming
        if upcoming is not None:
            self._board.prepare(upcoming.selection)
        else:
            self._wind_up(schedule)

    def _wind_up(self, schedule: Schedule) -> None:
        """After the frame's own pulses: poll the silent electrodes that are due, then end. Once a
        scan the whole chain is rewritten: here, where the last rest covers some of that time.
        """
        now_ns = self._clock.now_ns()
        if schedule.wants_polls:
            probes = self._supervisor.probes
            schedule.add_polls(*self._requests.polls(probes, schedule, now_ns))
        if not schedule.is_over(now_ns, _CONTACT_POLL_NS):
            return
        if schedule.plan.schedule:
            self._rewrite(schedule.plan.schedule[0].selection)
        if schedule.end_scan(self._clock.now_ns()):
            self._reporter.not_fired(None, "overrun")
        self._active.leave_scan()

    def _rewrite(self, first: Selection) -> None:
        """For the next scan; where the source is checked before it, for that."""
        if self._source_check.is_due(self._clock.now_ns()):
            self._board.isolate(whole=True)
        else:
            self._board.prepare(first, whole=True)
            self._board.release()
        self._is_rewritten = True
