"""The state of the board: the lease, the power-up, and every way to silence.

Owns: the states and the lease; all that leads into SAFE and HALTED. Must not know: what the
components are made of (`components.py`), where a command comes from (`commands.py`), when it is
called (`loop.py`), ZeroMQ, files.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.engine.capabilities import engine_hello
from etd.engine.components import Components
from etd.engine.power_up import Goal, PowerUp, Readiness, check_ready, lasting_refusal
from etd.engine.supply import Supply
from etd.engine.timing_calibration import calibrate_at_start
from etd.engine.timing_calibration import limitations as timing_limitations
from etd.planning.duty import told_of
from etd.planning.headroom import PlanRules
from etd.planning.outlook import Outlook
from etd.planning.plan import Planner
from etd.planning.probes import probes_of
from etd.planning.schedule import DuePulse
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.errors import BoardFault, Refused
from etd.protocol.link import Answer, LeaseEnded
from etd.protocol.messages import Halt, StateReport
from etd.pulse.request import PulseRequest
from etd.safety.lease import Lease, calibrations_of
from etd.safety.limits import PersonLimits
from etd.safety.maxima import Maxima
from etd.safety.session import Sessions, Subject
from etd.safety.state import StateMachine
from etd_hal.cost import CostModel


class Supervisor:
    def __init__(
        self, components: Components, untested: Callable[[], str | None] = lambda: None
    ) -> None:
        """`untested`: see `Engine`."""
        self._components = components
        self._untested = untested
        self.loaded = loaded = components.loaded
        self.board = components.board
        self.clock = components.clock
        self.host_clock = components.host_clock
        self.timeouts, self._liveness = components.timeouts, components.stopper_liveness
        self.reporter = components.reporter
        self.pulse_log = components.pulse_log
        self.active = components.active
        self.soft_start = components.soft_start
        self.ledger, self.source_check = components.ledger, components.source_check
        self.contact = components.contact
        self.adapter, self.feeling = components.adapter, components.feeling
        self.gateway_link, self.opening = components.gateway_link, components.opening
        self.rail, self.marker = components.rail, components.backend.marker
        self.backend, self.returns = components.backend.name, components.returns
        self.not_granted: tuple[str, ...] = ()
        self._failed_calibrations: tuple[str, ...] = ()
        self.last_silence: str | None = None
        self.states = StateMachine()
        self.lease: Lease | None = None
        self.supply = Supply(self.board, self._liveness, self.clock)
        self._planner: Planner | None = None
        #: The probes of the lease's person, in the order of the chain.
        self.probes: tuple[ScheduledPulse, ...] = ()
        self.power_up: PowerUp | None = None
        self.reported_ns = 0
        self.sessions = Sessions(has_wearer_stop=loaded.board.guards.wearer_stop != "absent")
        #: Of all leases so far, which one stands or stood last.
        self._lease_number = 0

    # --- life ------------------------------------------------------------------------------

    def begin(self, tell: Callable[[str], object] = lambda _: None) -> None:
        """Make the board safe, calibrate its timing; `tell` is called with a sentence for each
        attempt that failed.

        Raises: BoardFault, BusError.
        """
        problems = self.board.safe_off()
        if problems:
            raise BoardFault("start", "; ".join(problems), "a board that can be made safe")
        failed = calibrate_at_start(self.board, self.clock, tell)
        if failed:
            self.reporter.counters["calibration_attempts_failed"] += len(failed)
        self._failed_calibrations = failed
        self._follow_timing()
        self._liveness.try_note()
        left = self._liveness.left
        if left is not None:
            detail = f"{left}: look at the board and at the log before you clear this"
            tell(f"HALTED: {detail}")
            self._latch("fault", "crash", detail)

    def _follow_timing(self) -> bool:
        """After each timing calibration the maxima follow it, so that a pulse the guard would
        refuse is refused when it is requested. Returns True if they have changed.
        """
        board, prepulse_us = self.board, self.loaded.body_site.stabilize.prepulse_us
        return self._components.maxima.follow(board.min_width_us, board.widest_us(prepulse_us))

    @property
    def maxima(self) -> Maxima:
        """As the last timing calibration leaves them."""
        return self._components.maxima.now

    @property
    def limitations(self) -> tuple[str, ...]:
        """Failed calibration attempts, and what this machine cannot do."""
        parts = self._components
        return (
            *self._failed_calibrations,
            *parts.maxima.limitations,
            *parts.source_check.limitations,
            *timing_limitations(parts.reporter.counters),
            *parts.machine_watch.troubles,
        )

    def end(self) -> tuple[str, ...]:
        """Leave the board safe, whatever its state. Returns what did not work, as sentences."""
        problems = self.supply.off()
        self.active.silence()
        self.states.safe()
        return problems

    # --- power-up ----------------------------------------------------------------------------

    def begin_lease(self, lease: Lease) -> None:
        """A lease may bring a new person, so all estimates start from zero: they were reset when
        the last lease was silenced. The soft start is when a new session goes live.
        """
        self.lease = lease
        self.reporter.accounts.begin(lease.token)
        self._lease_number += 1
        self.sessions.opened(self._subject(lease), self.host_clock.now_ns())
        self.returns.set_caps(lease.person.caps_ua)
        self._set_calibration(lease.person)
        self._components.pre_probe.reset()
        self.planner_of_lease()
        self.report_state(self.clock.now_ns())

    def _subject(self, lease: Lease) -> Subject:
        return Subject.of(lease.person.calibrations, self._lease_number)

    def _untried_stop(self) -> str | None:
        """Why the wearer's stop is to be tried before the standing lease is armed."""
        lease, now_ns = self.lease, self.host_clock.now_ns()
        return None if lease is None else self.sessions.why_untried(self._subject(lease), now_ns)

    def _set_calibration(self, person: PersonLimits) -> None:
        calibration = person.calibration
        if calibration is None:
            self.adapter.set_calibration(None)
            return
        fired = calibration.shape.of(
            PulseRequest(self.maxima.probe_current_ua, calibration.width_us)
        )
        pulse = self.board.pulse(fired.current_ua, fired.width_us)
        is_early = not pulse.shape.has_end_sample
        self.adapter.set_calibration(calibration, is_early, person.others)

    def planner_of_lease(self) -> None:
        """Make the planner anew: plans follow the person's limits and the calibrated timing."""
        if self.lease is None:
            self._planner = None
            self.probes = ()
            return
        self._plan_for(self.lease.person, has_new_probes=True)

    def plan_anew(self) -> None:
        """The timing was calibrated again: frames to come are planned by it, and of the standing
        frame no pulse is fired that the guard would refuse.
        """
        has_changed = self._follow_timing()
        if self.lease is not None:
            self._plan_for(self.lease.person, has_changed)
        if has_changed:
            self.greet()
            self.active.fit(self.maxima)

    def _plan_for(self, person: PersonLimits, has_new_probes: bool) -> None:
        source = self.loaded.board.source
        rules = PlanRules(
            self.loaded.array,
            self.loaded.body_site,
            self.maxima,
            person,
            source.full_scale_ua / (source.codes - 1),
            self.adapter.max_gain,
        )
        computing, machine = self._components.computing, self.loaded.machine
        cost = CostModel(self.loaded.board, machine, self.board.timing, computing)
        self._planner = Planner(self.board, rules, cost)
        if has_new_probes:
            self.probes = probes_of(self.board, self.loaded.array, self.maxima, person)

    def outlook(self) -> Outlook:
        """What bounds a pulse that would be fired now."""
        return self._components.clearance.outlook(self.clock.now_ns())

    @property
    def planner(self) -> Planner:
        """Raises: Refused (`no_lease`)."""
        if self._planner is None:
            raise Refused("no_lease", "no lease stands")
        return self._planner

    def begin_power_up(self, goal: Goal, ref: int) -> None:
        """Begin the power-up. Raises: Refused; the answer to `ref` comes when it ends."""
        self.states.need("SAFE")
        if self.lease is None:
            raise Refused("no_lease", "no lease stands: an application opens one, then arm")
        if self.power_up is not None:
            raise Refused("wrong_state", f"{self.power_up.goal} is under way")
        check_ready(self._readiness())
        probes = self.probes
        power_up = PowerUp(goal, ref, self.board, self.rail, self._liveness, probes, self.clock)
        self.states.probe()
        self.board.guard.permit(self.maxima.probe_current_ua)
        self.supply.rises()
        self.power_up = power_up
        self.report_state(self.clock.now_ns())
        try:
            power_up.begin()
        except Refused as refusal:
            self.power_up = None
            self.make_safe(refusal.reason)
            raise

    def _readiness(self) -> Readiness:
        stops = self.board.stops()
        return Readiness(
            self.loaded.unaccepted_guards,
            tuple(name for name, is_open in stops.items() if is_open),
            self._untried_stop(),
            self._untested(),
        )

    def _lasting_refusal(self) -> str | None:
        """Determined only while no current can flow, since it may read a file."""
        if self.states.state in ("PROBE", "ARMED"):
            return None
        lasting = lasting_refusal(self.loaded.unaccepted_guards, self._untested())
        return lasting or self._liveness.note_problem or self._untried_stop()

    def step_power_up(self, power_up: PowerUp, now_ns: int) -> bool:
        """True once the rail is there: from then on current can flow."""
        try:
            if power_up.is_rail_there(now_ns) and self.lease is not None:
                self._check_source()
                if self.sessions.went_live(self._subject(self.lease), self.host_clock.now_ns()):
                    self.soft_start.restart()
                self.returns.begin_measuring(now_ns)
                self._components.computing.begin(self.clock.now_ns())
                return True
            return False
        except Refused as refusal:
            self.power_up = None
            self.make_safe(refusal.reason)
            self.send(Answer.refusing(power_up.ref, refusal))
            return False

    def _check_source(self) -> None:
        """Before the first pulse at a person. Raises: Refused; BusError, BoardFault."""
        now_ns = self.clock.now_ns()
        fault = self._components.source_check.check(now_ns, is_before_arming=True)
        if fault is not None:
            raise Refused("arm_failed", str(fault))

    def pass_on_measuring(self, due: DuePulse) -> None:
        """Go on to the next electrode; after the last probe the board is armed, or safe again."""
        power_up = self.power_up
        if power_up is None or not power_up.has(due):
            return
        power_up.advance()
        if power_up.is_measuring:
            return
        self._measure_computing()
        self.returns.all_measured()
        self.board.release()
        self.power_up = None
        now_ns = self.clock.now_ns()
        withheld = self._components.clearance.take_withheld(now_ns)
        contact = self.reporter.contact(self.contact, now_ns, withheld)
        if power_up.goal == "measure":
            self.make_safe("measured")
        else:
            self.states.arm()
            if not any(self.contact.is_touched):
                self.soft_start.restart()
            self.board.guard.permit(self.maxima.current_ua)
            self.report_state(self.clock.now_ns())
        taken = calibrations_of(self.lease)
        self.send(Answer(ref=power_up.ref, contact=contact, calibrations=taken))

    def _measure_computing(self) -> None:
        """All probes were fired: plans now use the computing time measured meanwhile."""
        wire_us = self.planner.wire_us(self.probes) + self.planner.chain_us
        self._components.computing.end(self.clock.now_ns(), len(self.probes), wire_us)

    @property
    def is_powered(self) -> bool:
        """ARMED, or in a power-up with the supply on."""
        return self.states.state == "ARMED" or (self.power_up is not None and self.power_up.is_on)

    # --- silence -----------------------------------------------------------------------------

    def make_safe(self, why: str) -> None:
        """Silence, supply off, SAFE. A board that cannot be made safe halts. What the soft start
        has reached stands for the session's next lease.
        """
        if self.states.state in ("PROBE", "ARMED"):
            problems = self._silence(why)
            self.states.safe()
            if problems:
                self.soft_start.restart()
                self._latch("fault", "safe_off", "; ".join(problems))
                self.end_lease("halted")
                return
            self.report_state(self.clock.now_ns())

    def _silence(self, why: str) -> tuple[str, ...]:
        """Returns what did not work, as sentences."""
        problems = self.supply.off()
        self.last_silence = why
        self.sessions.went_safe(self.host_clock.now_ns())
        self.active.silence()
        self.soft_start.supply_off(self.contact.is_touched, self.feeling.is_lowered)
        self.contact.reset()
        self.returns.reset()
        self.adapter.reset()
        self._components.pre_probe.reset()
        self._drop_power_up(why)
        self.reporter.scan_report(self.clock.now_ns(), 0, is_due=True)
        self.pulse_log.send_off()
        return problems

    def _drop_power_up(self, why: str) -> None:
        power_up, self.power_up = self.power_up, None
        if power_up is not None:
            self.send(Answer(ref=power_up.ref, error="arm_failed", reason=f"cut short: {why}"))

    def end_lease(self, why: str, counted: str = "") -> None:
        """The lease lapsed, was closed, or lost its gateway: silence, SAFE, no holder. `counted`
        names the counter, where that is not the last word of `why`.
        """
        self.make_safe(why)
        lease, self.lease = self.lease, None
        self.sessions.closed()
        self.planner_of_lease()
        if lease is not None:
            self.reporter.counters[f"leases_ended_{counted or why.split()[-1]}"] += 1
            self.send(LeaseEnded(lease=lease.token, reason=why))
            self.report_state(self.clock.now_ns())

    def halt(self, cause: str, who: str, detail: str) -> tuple[str, ...]:
        """Silence at once, HALTED until `clear`; the first cause is kept. Returns what failed."""
        if self.states.state == "HALTED":
            return self.supply.off()
        problems = self._silence(f"halted by {cause}: {detail}")
        self.soft_start.restart()
        self._latch(cause, who, "; ".join((detail, *problems)))
        self.end_lease("halted")
        return problems

    def make_safe_again(self, now_ns: int) -> None:
        """At each poll, where the last attempt to make the board safe has failed."""
        if self.supply.again(now_ns):
            self.report_state(self.clock.now_ns())

    def _latch(self, cause: str, who: str, detail: str) -> None:
        halt = Halt(cause=cause, source=who, detail=detail, t_ns=self.clock.now_ns())
        if self.states.stop(halt):
            self.reporter.halt(halt)
            self.report_state(halt.t_ns)

    def clear(self) -> None:
        """Leave HALTED. Raises: Refused, while a stop line is open or the board is not safe."""
        if self.states.state == "HALTED":
            open_stops = [name for name, is_open in self.board.stops().items() if is_open]
            if open_stops:
                raise Refused("halted", f"{' and '.join(open_stops)} still open: release it first")
            problems = self.supply.off()
            if problems:
                raise Refused("halted", f"the board is not safe: {'; '.join(problems)}")
        self.states.clear()
        self.supply.cleared()
        self.report_state(self.clock.now_ns())

    # --- reports -----------------------------------------------------------------------------

    def greet(self) -> None:
        """Send the gateway the board, the array and their maxima."""
        states = self.board.switch.states
        self.gateway_link.send(engine_hello(self.loaded, self.maxima, states, self.backend))

    def send(self, message: Answer | LeaseEnded) -> None:
        """To the gateway, if one is attached."""
        if not self.gateway_link.send(message):
            self.reporter.counters["answers_dropped"] += 1

    def report_state(self, now_ns: int) -> None:
        self.reported_ns = now_ns
        self.reporter.state(self.state_report(now_ns))

    def lag_ns(self) -> int:
        """How far the board's clock lags behind the machine's, which is read first."""
        host_ns = self.host_clock.now_ns()
        return max(0, host_ns - self.clock.now_ns())

    def _counters(self) -> dict[str, int]:
        counters, late = dict(self.reporter.counters), self.clock.wakeups.late
        return {**counters, "wakeups_late": late} if late else counters

    def state_report(self, now_ns: int) -> StateReport:
        """What `status` shows."""
        timing = self.board.timing
        return StateReport(
            state=self.states.state,
            now_ns=now_ns,
            engine="there",
            halt=self.states.halt,
            holder=None if self.lease is None else self.lease.client,
            calibrations=calibrations_of(self.lease),
            ceiling_ua=self.soft_start.ceiling_ua,
            rail_v=self.rail.rail_v(now_ns),
            supply_on=self.board.is_supply_on,
            absent_guards=self.loaded.board.absent_guards,
            not_granted=(*self.not_granted, *self.limitations),
            counters=self._counters(),
            busy_percent=round(self.clock.busy_percent, 1),
            busy_at_most=told_of(self.clock.busy_fraction, self._components.scan_core.told(now_ns)),
            clock_lag_us=self.lag_ns() // 1_000,
            timeout_factor=self.timeouts.factor,
            timing={
                "word_us": round(timing.word_us, 3),
                "delay_extra_us": round(timing.delay_extra_us, 3),
                "message_us": round(timing.message_us, 3),
                "spread_us": round(timing.spread_us, 3),
                "spun_us": self.clock.wakeups.spin_ns / 1_000,
            },
            machine=self._components.backend.facts,
            last_disarm=self.last_silence,
            arming_refused=self._lasting_refusal(),
            session=self.sessions.facts(self.host_clock.now_ns()),
            sensor_problems=self._components.pressure.problems(now_ns),
            felt=self.feeling.facts(),
        )
