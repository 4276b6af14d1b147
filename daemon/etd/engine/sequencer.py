"""Which pulse is due next, and what happens where none is: waits, pauses, the end of a scan.

Owns: the way through scans and measurements, from the schedule's next pulse to the call that waits
for it. `next_due` only looks; `holds` and `go_on` act. Must not know: how much of a pulse may be
fired, what a pulse measures, sockets.
"""

from __future__ import annotations

from etd.engine.components import Components
from etd.engine.idle_wait import TICK_NS, UNPOWERED_TICK_NS, IdleWait
from etd.engine.poller import Poller
from etd.engine.supervisor import Supervisor
from etd.engine.timing_calibration import Retiming
from etd.planning.lateness import LATE, Lateness
from etd.planning.schedule import DuePulse, Schedule
from etd_hal.selection import Selection

#: More than a contact poll with half-bridges takes. With relays, a poll may make the next scan
#: late.
_CONTACT_POLL_NS = 1_000_000
#: So long before a scan no message is heeded: what wakes for one is late by what the system likes.
_ON_TIME_NS = 200_000
#: Between two polls while a frame waits for the trigger: its edge is noticed by a poll.
_TRIGGER_TICK_NS = 250_000
#: Poll period in a pause, and between the pulses of a burst.
POLL_NS = 2_000_000


class Sequencer:
    def __init__(self, components: Components, supervisor: Supervisor, poller: Poller) -> None:
        self._clock = components.clock
        self._board = components.board
        self._marker = components.backend.marker
        self._reporter = components.reporter
        self._active = components.active
        self._pulse_log = components.pulse_log
        self._soft_start = components.soft_start
        self._firing = components.firing
        self._requests = components.requests
        self._source_check = components.source_check
        self._machine_watch = components.machine_watch
        self._supervisor = supervisor
        self._poller = poller
        self._computing = components.computing
        self._lateness = Lateness()
        counters = components.reporter.counters
        self._retiming = Retiming(components.board, counters, poller.poll_meanwhile)
        self._idle_wait = IdleWait(components.clock, components.gateway_link.wait)
        self._is_pausing = False
        #: What the scan may be busy for, as the last report had it.
        self._told_fraction = self._clock.busy_fraction
        #: Stimuli fired in the scan under way.
        self._fired = 0
        #: The end of the scan before has rewritten the chain.
        self._is_rewritten = False
        #: With none of its outputs selected, for a check of the source.
        self._is_isolated = False

    @property
    def is_between_scans(self) -> bool:
        """Neither a scan nor a measurement of contact is under way."""
        if self._active.scanning is not None:
            return False
        power_up = self._supervisor.power_up
        return power_up is None or not power_up.is_measuring

    def leave(self) -> None:
        """Leaves the scan under way after a fault."""
        self._is_pausing = False
        self._active.leave_scan()

    def next_due(self) -> DuePulse | None:
        """The next pulse of the scan or the measurement under way; it changes nothing. None: there
        is none, and `go_on` is to be called.
        """
        schedule, power_up = self._active.scanning, self._supervisor.power_up
        if schedule is not None:
            return schedule.next_due() if schedule is self._active.schedule else None
        return None if power_up is None else power_up.next_due()

    def holds(self, now_ns: int) -> bool:
        """Called before each pulse, after the poll. In a long scan it reads frames; it waits
        between the pulses of a burst, and where the kernel would throttle the thread. True: it has
        waited, or the scan was interrupted, and a poll is due first.
        """
        schedule = self._active.scanning
        if schedule is None or schedule is not self._active.schedule:
            return False
        if not self._is_pausing:
            if schedule.is_long(now_ns):
                self._poller.take_frames_within()
                if schedule is not self._active.schedule:
                    # Frames are read with polls in between, and a poll may have ended the scan.
                    return True
            if schedule.plan.pulses > 1 and self._wait_for_burst(schedule.earliest_ns(), now_ns):
                return True
        pause_ns = self._clock.pause_until_ns(now_ns)
        if pause_ns is None:
            self._is_pausing = False
            return False
        self._pause(schedule, pause_ns, now_ns)
        return True

    def _pause(self, schedule: Schedule, pause_ns: int, now_ns: int) -> None:
        if not self._is_pausing:
            self._reporter.not_fired(None, "processor")
        self._is_pausing = True
        self._clock.sleep_until_ns(min(pause_ns, now_ns + POLL_NS))
        schedule.was_paused(self._clock.now_ns() - now_ns)

    def go_on(self) -> bool:
        """Nothing is due: ends the scan under way, begins the next one, or waits. True: the source
        is to be checked now, with nothing connected.
        """
        schedule = self._active.scanning
        if schedule is None:
            self._poller.take_frames()
            return self._between_scans(self._clock.now_ns())
        if schedule is self._active.schedule:
            self._wind_up(schedule)
        else:
            self._board.release()
            self._active.leave_scan()
        return False

    def _wait_for_burst(self, earliest_ns: int, now_ns: int) -> bool:
        """True if the next pulse of a burst is not due yet; then some of the time is slept."""
        if now_ns >= earliest_ns:
            return False
        self._clock.sleep_until_ns(min(earliest_ns, now_ns + POLL_NS))
        return True

    def _between_scans(self, now_ns: int) -> bool:
        power_up = self._supervisor.power_up
        if power_up is not None and self._supervisor.step_power_up(power_up, now_ns):
            return False
        self._clock.look(now_ns)
        if self._machine_watch.look(now_ns) or self._clock.busy_fraction != self._told_fraction:
            self._told_fraction = self._clock.busy_fraction
            self._supervisor.report_state(now_ns)
        schedule, is_armed = self._active.schedule, self._supervisor.states.state == "ARMED"
        room_ns = None
        if schedule is not None:
            # An edge of the trigger may come at any time.
            room_ns = 0 if schedule.is_waiting else schedule.next_ns - now_ns
        if schedule is None or not is_armed:
            self._lateness.reset()
            self._computing.scans_ended()
        is_ready = self._is_isolated or not self._is_rewritten
        if is_armed and self._source_check.is_due(now_ns, room_ns, is_ready=is_ready):
            return True
        if schedule is None or not is_armed:
            has_supply = self._supervisor.is_powered
            self._doze_until(now_ns + (TICK_NS if has_supply else UNPOWERED_TICK_NS))
        elif now_ns < schedule.next_ns and schedule.is_waiting:
            self._doze_until(now_ns + _TRIGGER_TICK_NS)
        elif now_ns < schedule.next_ns:
            self._wait_for(schedule.next_ns, now_ns + TICK_NS)
        else:
            self._begin_next()
        return False

    def _begin_next(self) -> None:
        if self._firing.has_drifted and not self._follow_clocks():
            return
        if self._active.schedule is not None:
            self._begin_scan(self._active.schedule)

    def _wait_for(self, next_ns: int, tick_ns: int) -> None:
        """A scan begins on time; a poll between two scans may be late by half a tick."""
        if next_ns > tick_ns + TICK_NS // 2:
            self._doze_until(tick_ns)
        elif not self._doze_until(next_ns - _ON_TIME_NS):
            self._clock.sleep_until_ns(next_ns)

    def _doze_until(self, deadline_ns: int) -> bool:
        """True if a message has ended it."""
        self._reporter.scan_report(self._clock.now_ns(), self._soft_start.ceiling_ua)
        self._pulse_log.send_off()
        return self._idle_wait.until_ns(deadline_ns)

    def _follow_clocks(self) -> bool:
        """Messages take longer or shorter than planned: find the timing that holds now. False:
        there is none yet, and nothing is fired.
        """
        # The time of a calibration is no computing between two scans.
        self._computing.scans_ended()
        now_ns = self._clock.now_ns()
        if now_ns < self._retiming.not_before_ns:
            self._doze_until(now_ns + TICK_NS)
            return False
        if not self._retiming.attempt(now_ns):
            self._reporter.not_fired(None, "timing")
            return False
        self._firing.reset_drift()
        self._supervisor.plan_anew()
        return True

    # --- the way through a scan --------------------------------------------------------------

    def _begin_scan(self, schedule: Schedule) -> None:
        frame, shows = schedule.plan.frame, not schedule.is_waiting
        is_first = shows and not schedule.is_begun
        now_ns = self._clock.now_ns()
        self._heed_lateness(schedule, now_ns)
        self._active.begin_scan(schedule, now_ns)
        self._is_pausing = False
        if is_first and frame.sync:
            self._board.sync()
        if shows:
            self._marker.mark("frame", frame.seq, frame.tag)
        upcoming = schedule.upcoming
        if upcoming is not None and not self._is_rewritten:
            self._board.prepare(upcoming.selection, whole=True)
        self._is_rewritten = self._is_isolated = False
        self._fired = 0
        self._computing.begin(self._clock.now_ns(), self._poller.planning_ns)
        if upcoming is None:
            self._wind_up(schedule)

    def _heed_lateness(self, schedule: Schedule, now_ns: int) -> None:
        """What this machine cannot do is slowed down, and told."""
        ratio = self._lateness.begun(now_ns, schedule.plan.period_ns)
        if ratio is None:
            return
        if ratio <= LATE:
            self._computing.came_in_time()
            return
        self._computing.came_late(ratio)
        schedule.slow_down(ratio)
        self._reporter.slowed(schedule.plan.rate_hz)

    def fired(self, due: DuePulse, begun_ns: int) -> None:
        """The pulse began at `begun_ns`: go on to the next."""
        schedule = self._active.scanning
        if due.purpose == "stimulus" and schedule is not None:
            schedule.was_fired(due, begun_ns)
            self._fired += 1
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
            plan = schedule.plan
            if self._fired == len(plan.schedule) and plan.pulses == 1:
                self._computing.end(now_ns, self._fired, plan.wire_us)
            probes = self._supervisor.probes
            schedule.add_polls(*self._requests.polls(probes, schedule, now_ns))
        if not schedule.is_over(now_ns, _CONTACT_POLL_NS):
            return
        if schedule.plan.schedule:
            self._rewrite(schedule.plan.schedule[0].selection, schedule.next_ns)
        over_ns = self._clock.now_ns()
        if schedule.end_scan(over_ns):
            self._reporter.not_fired(None, "overrun")
        self._computing.scan_ended(over_ns, self._poller.planning_ns)
        self._active.leave_scan()

    def checked(self) -> None:
        """The source was checked with no output selected: the next scan begins with its first."""
        schedule = self._active.schedule
        self._is_isolated = False
        if self._is_rewritten and schedule is not None and schedule.plan.schedule:
            self._board.prepare(schedule.plan.schedule[0].selection)
            self._board.release()

    def _rewrite(self, first: Selection, next_ns: int) -> None:
        """For the next scan; where the source is checked before it, for that."""
        now_ns = self._clock.now_ns()
        self._is_isolated = self._source_check.is_due(now_ns, next_ns - now_ns)
        if self._is_isolated:
            self._board.isolate(whole=True)
        else:
            self._board.prepare(first, whole=True)
            self._board.release()
        self._is_rewritten = True
