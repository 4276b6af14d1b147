"""What may be asked of a live board: the lease, the way up, and every way to silence.

Owns: the states and the lease; all that leads into SAFE and HALTED. Must not know: what the parts
are made of (`components.py`), who asks (`commands.py`), when (`loop.py`), ZeroMQ, files.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.calibration import Calibration
from etd.engine.calibrating import calibrate_at_start
from etd.engine.components import Components
from etd.engine.energize import Energizer, Goal, Readiness, check_ready, lasting_refusal
from etd.engine.lease import Lease
from etd.engine.limits import PersonLimits
from etd.engine.plan import Planner
from etd.engine.probes import probes_of
from etd.engine.room import Rules
from etd.engine.schedule import DuePulse
from etd.engine.state import StateMachine
from etd.engine.telling import greeting
from etd.engine.visit import Visit
from etd.errors import BoardFault, Refused
from etd.link import Answer, LeaseEnded
from etd.maxima import Maxima
from etd.protocol import Halt, StateReport
from etd.stabilize.pipeline import Wish
from etd_hal.cost import CostModel


class Supervisor:
    """See the module."""

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
        self.timeouts = components.timeouts
        self.reporter = components.reporter
        self.active = components.active
        self.opening = components.opening
        self.contact = components.contact
        self.asker = components.asker
        self.rail = components.rail
        self.stopper = components.stopper
        self.dialogue = components.dialogue
        self.marker = components.backend.marker
        self.sharing = components.sharing
        self.not_granted: tuple[str, ...] = ()
        self._failed_calibrations: tuple[str, ...] = ()
        self.last_silence: str | None = None
        self.states = StateMachine()
        self.lease: Lease | None = None
        self.supply_changed: Callable[[bool], None] = lambda _: None
        self._planner: Planner | None = None
        #: Of the lease, in the order of the chain.
        self.probes: tuple[Visit, ...] = ()
        self.energizer: Energizer | None = None
        self.told_ns = 0
        self.is_wearer_stop_tried = loaded.board.guards.wearer_stop == "absent"

    # --- life ------------------------------------------------------------------------------

    def begin(self, tell: Callable[[str], object] = lambda _: None) -> None:
        """Make the board safe, calibrate its timing; `tell` hears of each attempt that failed.

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

    def _follow_timing(self) -> bool:
        """After each calibration: what the guard would refuse now is refused when it is asked for.
        True if that is other than before.
        """
        board, prepulse_us = self.board, self.loaded.body_site.stabilize.prepulse_us
        return self._components.maxima.follow(board.narrowest_us, board.widest_us(prepulse_us))

    @property
    def maxima(self) -> Maxima:
        """As the last timing calibration leaves them."""
        return self._components.maxima.now

    @property
    def limitations(self) -> tuple[str, ...]:
        """What this machine did not do at once, or cannot do."""
        return (*self._failed_calibrations, *self._components.maxima.limitations)

    def end(self) -> tuple[str, ...]:
        """Leave the board safe, whatever state it is in; what did not work, as sentences."""
        problems = self.board.safe_off()
        self.active.silence()
        self.states.safe()
        return problems

    # --- the way up --------------------------------------------------------------------------

    def begin_lease(self, lease: Lease) -> None:
        """A new person, perhaps. Everything starts from zero: what was learned and how far the
        opening came went when the last lease was silenced.
        """
        self.lease = lease
        self._serve(lease.person.calibration)
        self._components.ahead.forget()
        self.planner_of_lease()
        self.tell_state(self.clock.now_ns())

    def _serve(self, calibration: Calibration | None) -> None:
        if calibration is None:
            self.asker.serve(None)
            return
        fired = calibration.shape.of(Wish(self.maxima.probe_current_ua, calibration.width_us))
        pulse = self.board.pulse(fired.current_ua, fired.width_us)
        self.asker.serve(calibration, is_early=not pulse.shape.has_end_sample)

    def planner_of_lease(self) -> None:
        """Plans follow the person's limits and the calibrated timing."""
        if self.lease is None:
            self._planner = None
            self.probes = ()
            return
        self._plan_for(self.lease.person, has_new_probes=True)

    def plan_anew(self) -> None:
        """The timing is another one: frames to come are planned by it, and of the one that stands
        nothing is fired that the guard would refuse.
        """
        has_changed = self._follow_timing()
        if self.lease is not None:
            self._plan_for(self.lease.person, has_changed)
        if has_changed:
            self.greet()
            self.active.fit(self.maxima)

    def _plan_for(self, person: PersonLimits, has_new_probes: bool) -> None:
        source = self.loaded.board.source
        rules = Rules(
            self.loaded.array,
            self.loaded.body_site,
            self.maxima,
            person,
            source.full_scale_ua / (source.codes - 1),
            self.asker.reach,
        )
        cost = CostModel(self.loaded.board, self.loaded.machine, self.board.timing)
        self._planner = Planner(self.board, rules, cost)
        if has_new_probes:
            self.probes = probes_of(self.board, self.loaded.array, self.maxima, person)

    @property
    def planner(self) -> Planner:
        """Raises: Refused (`no_lease`)."""
        if self._planner is None:
            raise Refused("no_lease", "no lease stands")
        return self._planner

    def energize(self, goal: Goal, ref: int) -> None:
        """Begin the way up. Raises: Refused; the answer to `ref` comes when it ends."""
        self.states.need("SAFE")
        if self.lease is None:
            raise Refused("no_lease", "no lease stands: an application opens one, then arm")
        if self.energizer is not None:
            raise Refused("wrong_state", f"{self.energizer.goal} is under way")
        check_ready(self._readiness())
        probes = self.probes
        liveness = self._components.stopper_liveness
        energizer = Energizer(goal, ref, self.board, self.rail, liveness, probes, self.clock)
        self.states.probe()
        self.board.guard.permit(self.maxima.probe_current_ua)
        self.supply_changed(True)
        self.energizer = energizer
        self.tell_state(self.clock.now_ns())
        try:
            energizer.begin()
        except Refused:
            self.energizer = None
            self.make_safe("the rail is not known")
            raise

    def _readiness(self) -> Readiness:
        stops = self.board.stops()
        return Readiness(
            self.loaded.unaccepted_guards,
            tuple(name for name, is_open in stops.items() if is_open),
            self.is_wearer_stop_tried,
            self._untested(),
        )

    def _lasting_refusal(self) -> str | None:
        """Asked while nothing can flow: it may have to read a file."""
        if self.states.state in ("PROBE", "ARMED"):
            return None
        return lasting_refusal(self.loaded.unaccepted_guards, self._untested())

    def climb(self, energizer: Energizer, now_ns: int) -> bool:
        """True once the rail is there and contact is measured."""
        try:
            return energizer.is_rail_there(now_ns)
        except Refused as refusal:
            self.energizer = None
            self.make_safe(refusal.reason)
            self.answer(Answer.refusing(energizer.ref, refusal))
            return False

    def pass_on_measuring(self, due: DuePulse) -> None:
        """To the next electrode; after the last one the board is armed, or safe again."""
        energizer = self.energizer
        if energizer is None or not energizer.has(due):
            return
        energizer.advance()
        if energizer.is_measuring:
            return
        self.board.release()
        self.energizer = None
        contact = self.reporter.contact(self.contact, self.clock.now_ns())
        if energizer.goal == "measure":
            self.make_safe("measured")
        else:
            self.states.arm()
            self.opening.restart()
            self.board.guard.permit(self.maxima.current_ua)
            self.tell_state(self.clock.now_ns())
        self.answer(Answer(ref=energizer.ref, contact=contact))

    @property
    def is_powered(self) -> bool:
        """ARMED, or on the way there behind the supply's switch."""
        return self.states.state == "ARMED" or (self.energizer is not None and self.energizer.is_on)

    # --- the way down ------------------------------------------------------------------------

    def make_safe(self, why: str) -> None:
        """Silence, supply off, SAFE; a board that cannot be made safe halts."""
        if self.states.state in ("PROBE", "ARMED"):
            problems = self._silence(why)
            self.states.safe()
            if problems:
                self._latch("fault", "safe_off", "; ".join(problems))
                self.end_lease("halted")
                return
            self.tell_state(self.clock.now_ns())

    def _silence(self, why: str) -> tuple[str, ...]:
        """Returns what did not work, as sentences."""
        problems = self.board.safe_off()
        self.last_silence = why
        self.supply_changed(False)
        self.active.silence()
        self.opening.restart()
        self.contact.forget()
        self._components.sharing.forget()
        self.asker.forget()
        self._components.ahead.forget()
        self._drop_energizer(why)
        self.reporter.scan_report(self.clock.now_ns(), 0, is_due=True)
        return problems

    def _drop_energizer(self, why: str) -> None:
        energizer, self.energizer = self.energizer, None
        if energizer is not None:
            self.answer(Answer(ref=energizer.ref, error="arm_failed", reason=f"cut short: {why}"))

    def end_lease(self, why: str, counted: str = "") -> None:
        """Lapsed, closed, or lost with its gateway: silence, SAFE, no holder. `counted` is its word
        among the counters, where that is not the last one of `why`.
        """
        self.make_safe(why)
        lease, self.lease = self.lease, None
        self.planner_of_lease()
        if lease is not None:
            self.reporter.counters[f"leases_ended_{counted or why.split()[-1]}"] += 1
            self._tell_gateway(LeaseEnded(lease=lease.token, why=why))
            self.tell_state(self.clock.now_ns())

    def halt(self, cause: str, who: str, detail: str) -> None:
        """Silence at once, and HALTED until `clear`. The first cause stands."""
        if self.states.state == "HALTED":
            self.board.safe_off()
            return
        problems = self._silence(f"halted by {cause}: {detail}")
        self._latch(cause, who, "; ".join((detail, *problems)))
        self.end_lease("halted")

    def _latch(self, cause: str, who: str, detail: str) -> None:
        halt = Halt(cause=cause, who=who, detail=detail, t_ns=self.clock.now_ns())
        if self.states.stop(halt):
            self.reporter.halt(halt)
            self.tell_state(halt.t_ns)

    def clear(self) -> None:
        """Leave HALTED. Raises: Refused, while a stop line is open or the board is not safe."""
        if self.states.state == "HALTED":
            open_stops = [name for name, is_open in self.board.stops().items() if is_open]
            if open_stops:
                raise Refused("halted", f"{' and '.join(open_stops)} still open: release it first")
            problems = self.board.safe_off()
            if problems:
                raise Refused("halted", f"the board is not safe: {'; '.join(problems)}")
        self.states.clear()
        self.stopper.has_acted = False
        self.tell_state(self.clock.now_ns())

    # --- telling -----------------------------------------------------------------------------

    def greet(self) -> None:
        """Tell the gateway what there is to drive, and what nobody gets more of."""
        states, backend = self.board.switch.states, self._components.backend
        self.dialogue.send(greeting(self.loaded, self.maxima, states, backend.name))

    def answer(self, answer: Answer) -> None:
        """To the gateway, if it is there."""
        self._tell_gateway(answer)

    def _tell_gateway(self, message: Answer | LeaseEnded) -> None:
        if not self.dialogue.send(message):
            self.reporter.counters["answers_dropped"] += 1

    def tell_state(self, now_ns: int) -> None:
        self.told_ns = now_ns
        self.reporter.state(self.state_report(now_ns))

    def _lag_ns(self) -> int:
        """How far the board's clock is behind the machine's, which is read first."""
        host_ns = self.host_clock.now_ns()
        return max(0, host_ns - self.clock.now_ns())

    def state_report(self, now_ns: int) -> StateReport:
        """What `status` shows."""
        timing = self.board.timing
        return StateReport(
            state=self.states.state,
            now_ns=now_ns,
            engine="there",
            halt=self.states.halt,
            holder=None if self.lease is None else self.lease.client,
            ceiling_ua=self.opening.ceiling_ua,
            rail_v=self.rail.rail_v(now_ns),
            supply_on=self.board.is_supply_on,
            absent_guards=self.loaded.board.absent_guards,
            not_granted=(*self.not_granted, *self.limitations),
            counters=dict(self.reporter.counters),
            busy_percent=round(self.clock.busy_percent, 1),
            clock_lag_us=self._lag_ns() // 1_000,
            timeout_factor=self.timeouts.factor,
            timing={
                "word_us": round(timing.word_us, 3),
                "delay_extra_us": round(timing.delay_extra_us, 3),
                "message_us": round(timing.message_us, 3),
                "spread_us": round(timing.spread_us, 3),
            },
            machine=self._components.backend.facts,
            last_disarm=self.last_silence,
            arming_refused=self._lasting_refusal(),
            sensor_problems=self._components.pressure.problems(now_ns),
        )
