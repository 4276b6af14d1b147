"""The engine: states, lease, what is watched before every pulse, and the way to silence.

Owns: the order in which things are looked at each turn; every way into SAFE and HALTED.
Must not know: ZeroMQ, JSON, files, threads, which backend there is.

A turn: watch (gateway silent? lease lapsed? a stop line open? rail away? commands?), take frames,
then one scan if one is due, or a short sleep. The same watch is kept before every pulse. Lapses
are looked at before any queue is read: after a stall nothing stale is shown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from etd.config import LoadedConfig
from etd.engine import commands
from etd.engine.contact import ContactMap
from etd.engine.dialogue import Dialogue
from etd.engine.duty import BusyClock
from etd.engine.energize import Energizer, Goal, Readiness, check_ready
from etd.engine.lease import Lease
from etd.engine.ledger import Bounds, Ledger
from etd.engine.limits import maxima_of
from etd.engine.opening import Opening
from etd.engine.plan import Planner, Rules
from etd.engine.reporting import STATE_PERIOD_NS, Reporter
from etd.engine.scan import Scanner
from etd.engine.sensors import RailSensor
from etd.engine.state import StateMachine
from etd.engine.stopper import Stopper
from etd.engine.telling import greeting, state_report
from etd.engine.visits import Tools, Visitor
from etd.errors import BoardFault, BusError, GuardRefusal, Refused
from etd.link import Answer, Channel, LeaseEnded, NewFrame, ToEngine
from etd.protocol import Halt
from etd.stabilize.pipeline import Stabilizer
from etd_hal.board import Board
from etd_hal.compose import Backend
from etd_hal.cost import CostModel

#: Between two looks when nothing is due; the heartbeat's monostable wants edges as well.
TICK_NS = 1_000_000
#: Edges come this often within the monostable's window.
_BEATS_PER_WINDOW = 4


class Engine:
    """See the module. `turn` is called for ever by `process.py`, and by tests."""

    def __init__(
        self,
        loaded: LoadedConfig,
        backend: Backend,
        *,
        stabilizers: Sequence[Stabilizer] = (),
        not_granted: tuple[str, ...] = (),
        feed_watchdog: Callable[[int], None] = lambda _: None,
    ) -> None:
        self.loaded = loaded
        self.clock = BusyClock(backend.clock)
        self.marker = backend.marker
        self.board = Board(loaded.board, loaded.machine, backend.spi, backend.gpio, self.clock)
        self.maxima = maxima_of(loaded.board, loaded.body_site)
        self.rail = RailSensor(loaded.board, backend.i2c, backend.clock)
        self.backend = backend
        self.not_granted = not_granted
        self.last_silence: str | None = None
        self.stopper = Stopper(self.board, backend.clock)
        self.states = StateMachine()
        self._dialogue = Dialogue()
        self.lease: Lease | None = None
        self.contact = ContactMap(loaded.array.count, loaded.board.source, loaded.body_site.contact)
        self.reporter = Reporter(loaded.array.count, self._dialogue.send)
        self.opening = Opening(self.maxima.current_ua)
        self.scanner = Scanner(self.board, self.clock, self.marker, self.reporter)
        self.supply_changed: Callable[[bool], None] = lambda _: None
        self._feed_watchdog = feed_watchdog
        self._tools = Tools(
            self.board,
            self.maxima,
            Ledger(loaded.array.count, self._ledger_bounds()),
            self.opening,
            self.contact,
            self.reporter,
            stabilizers,
        )
        self._visitor = Visitor(self._tools)
        self._planner: Planner | None = None
        self._energizer: Energizer | None = None
        self._beaten_ns = 0
        self._told_ns = 0
        self._wearer_stop_was_open = False
        self._is_wearer_stop_tried = loaded.board.guards.wearer_stop == "absent"

    def _ledger_bounds(self) -> Bounds:
        maxima = self.maxima
        return Bounds(
            mean_current_ua=maxima.mean_current_ua,
            pulses=maxima.rate_hz,
            on_us=maxima.on_us_per_s,
            array_mean_current_ua=maxima.array_mean_current_ua,
            array_on_us=maxima.array_on_us_per_s,
        )

    # --- life ------------------------------------------------------------------------------

    def begin(self) -> None:
        """Make the board safe, calibrate its timing. Raises: BoardFault, BusError."""
        problems = self.board.safe_off()
        if problems:
            raise BoardFault("start", "; ".join(problems), "a board that can be made safe")
        self.board.calibrate()

    def end(self) -> tuple[str, ...]:
        """Leave the board safe, whatever state it is in; what did not work, as sentences."""
        self.scanner.silence()
        self.states.safe()
        return self.board.safe_off()

    def attach(self, commands_: Channel[ToEngine], frames: Channel[NewFrame]) -> None:
        """A gateway has connected."""
        now_ns = self.clock.now_ns()
        self._dialogue.attach(commands_, frames, now_ns)
        self._dialogue.send(greeting(self))
        self._tell_state(now_ns)

    @property
    def has_gateway(self) -> bool:
        return self._dialogue.is_attached

    def turn(self) -> None:
        """One look at everything, then a scan or a short sleep. Never raises EtdError."""
        now_ns = self.clock.now_ns()
        self._watch(now_ns)
        self._take_frames()
        try:
            self._work(self.clock.now_ns())
        except (BusError, GuardRefusal, BoardFault) as fault:
            self.halt("fault", type(fault).__name__, str(fault))

    def _work(self, now_ns: int) -> None:
        if self._energizer is not None:
            self._climb(self._energizer, now_ns)
        standing = self.scanner.standing
        if standing is None or self.states.state != "ARMED":
            self.opening.hold()
            self._sleep_until(now_ns + TICK_NS)
            return
        if now_ns < standing.next_ns:
            self._sleep_until(min(standing.next_ns, standing.expires_ns, now_ns + TICK_NS))
            return
        if self._visitor.has_drifted:
            self._calibrate_again()
        self.scanner.scan(self._visitor, self._may_fire)

    def _sleep_until(self, deadline_ns: int) -> None:
        self.reporter.scan_report(self.clock.now_ns(), self.opening.ceiling_ua)
        self.clock.sleep_until_ns(deadline_ns)

    def _calibrate_again(self) -> None:
        self.board.calibrate()
        self._visitor.forget_drift()
        self.reporter.counters["recalibrated"] += 1
        self.planner_of_lease()

    # --- before every pulse ------------------------------------------------------------------

    def _may_fire(self, now_ns: int) -> int | None:
        """The ceiling in uA now, or None when no pulse may be fired."""
        self._watch(now_ns)
        self.reporter.scan_report(now_ns, self.opening.ceiling_ua)
        if self.states.state == "ARMED":
            return self.opening.rise(now_ns) if self.scanner.standing is not None else None
        if self.states.state == "PROBE" and self._energizer is not None:
            return self.maxima.probe_current_ua
        return None

    def _watch(self, now_ns: int) -> None:
        self._watch_gateway(now_ns)
        if self.lease is not None and self.lease.has_lapsed(now_ns):
            self.end_lease("lapsed")
        self.scanner.expire(now_ns)
        self._watch_stops()
        self._watch_rail(now_ns)
        self._obey(now_ns)
        self._beat(now_ns)
        if now_ns - self._told_ns >= STATE_PERIOD_NS:
            self._tell_state(now_ns)
        self._feed_watchdog(now_ns)

    def _watch_gateway(self, now_ns: int) -> None:
        why = self._dialogue.why_lost()
        if why is not None:
            self._dialogue.hang_up()
            self.end_lease(why)
        elif self._dialogue.is_silent(now_ns) and self.lease is not None:
            # What it said just before a stall of ours still lies in the queue.
            self._obey(now_ns)
            if self._dialogue.is_silent(now_ns):
                self.end_lease("the gateway is silent")

    def _watch_stops(self) -> None:
        is_live = self.states.state in ("PROBE", "ARMED")
        for name, is_open in self.board.stop_edges():
            if name == "wearer_stop":
                self._is_wearer_stop_tried |= self._wearer_stop_was_open and not is_open
                self._wearer_stop_was_open = is_open
            if is_open and is_live:
                self.halt(name, name, "the stop line opened")
                return
        if self.stopper.has_acted and is_live:
            self.halt("fault", "stopper", "an SPI message was overdue; its outputs were cut off")

    def _watch_rail(self, now_ns: int) -> None:
        monitor = self.loaded.board.guards.rail_monitor
        if monitor == "absent" or self.states.state != "ARMED":
            return
        rail_v = self.rail.rail_v(now_ns)
        if rail_v is None:
            self.halt("fault", "rail", f"the rail is not known ({self.rail.problem or 'stale'})")
        elif not monitor.low_v <= rail_v <= monitor.high_v:
            self.halt("fault", "rail", f"{rail_v:.0f} V, not {monitor.low_v} to {monitor.high_v} V")

    def _obey(self, now_ns: int) -> None:
        for command in self._dialogue.commands(now_ns):
            commands.obey(self, command, now_ns)

    def _take_frames(self) -> None:
        for message in self._dialogue.frames():
            commands.take_frame(self, message, self.clock.now_ns())

    def _beat(self, now_ns: int) -> None:
        heartbeat = self.loaded.board.guards.heartbeat
        if heartbeat == "absent" or self.states.state not in ("PROBE", "ARMED"):
            return
        if now_ns - self._beaten_ns >= heartbeat.window_ms * 1_000_000 // _BEATS_PER_WINDOW:
            self._beaten_ns = now_ns
            self.board.beat()

    # --- the way up --------------------------------------------------------------------------

    def begin_lease(self, lease: Lease) -> None:
        """A new person, perhaps: everything starts from zero."""
        self.lease = lease
        self.opening.restart()
        self.planner_of_lease()

    def planner_of_lease(self) -> None:
        """Plans follow the person's limits and the calibrated timing."""
        if self.lease is None:
            self._planner = None
            return
        rules = Rules(self.loaded.array, self.loaded.body_site, self.maxima, self.lease.person)
        cost = CostModel(self.loaded.board, self.loaded.machine, self.board.timing)
        self._planner = Planner(self.board, rules, cost)

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
        if self._energizer is not None:
            raise Refused("wrong_state", f"{self._energizer.goal} is under way")
        check_ready(self._readiness())
        energizer = Energizer(goal, ref, self._tools, self.rail, self.loaded.array, self.clock)
        self.states.probe()
        self.board.guard.permit(self.maxima.probe_current_ua)
        self.supply_changed(True)
        self._energizer = energizer
        try:
            energizer.begin()
        except Refused:
            self._energizer = None
            self.make_safe("the rail is not known")
            raise

    def _readiness(self) -> Readiness:
        stops = self.board.stops()
        return Readiness(
            self.loaded.unaccepted_guards,
            tuple(name for name, is_open in stops.items() if is_open),
            self._is_wearer_stop_tried,
            not self.stopper.has_acted,
        )

    def _climb(self, energizer: Energizer, now_ns: int) -> None:
        try:
            if not energizer.is_rail_there(now_ns):
                return
        except Refused as refusal:
            self._energizer = None
            self.make_safe(refusal.reason)
            self.answer(commands.refused(energizer.ref, refusal))
            return
        if not energizer.measure_contact(self._visitor, self._may_fire):
            return
        self._energizer = None
        contact = self.reporter.contact(self.contact, self.clock.now_ns())
        if energizer.goal == "measure":
            self.make_safe("measured")
        else:
            self.states.arm()
            self.opening.restart()
            self.board.guard.permit(self.maxima.current_ua)
            self._tell_state(self.clock.now_ns())
        self.answer(Answer(ref=energizer.ref, contact=contact))

    # --- the way down ------------------------------------------------------------------------

    def make_safe(self, why: str) -> None:
        """Silence, supply off, SAFE; a board that cannot be made safe halts."""
        if self.states.state in ("PROBE", "ARMED"):
            self._silence(why)
            self.states.safe()
            self._tell_state(self.clock.now_ns())

    def _silence(self, why: str) -> None:
        problems = self.board.safe_off()
        self.last_silence = why
        self.supply_changed(False)
        self.scanner.silence()
        self.opening.restart()
        self.contact.forget()
        self._drop_energizer(why)
        self.reporter.scan_report(self.clock.now_ns(), 0, is_due=True)
        if problems:
            self._latch("fault", "safe_off", "; ".join(problems))

    def _drop_energizer(self, why: str) -> None:
        energizer, self._energizer = self._energizer, None
        if energizer is not None:
            self.answer(Answer(ref=energizer.ref, error="arm_failed", reason=f"cut short: {why}"))

    def end_lease(self, why: str) -> None:
        """Lapsed, closed, or lost with its gateway: silence, SAFE, no holder."""
        self.make_safe(why)
        lease, self.lease = self.lease, None
        self.planner_of_lease()
        if lease is not None:
            self.reporter.counters[f"leases_ended_{why.split()[-1]}"] += 1
            self._tell_gateway(LeaseEnded(lease=lease.token, why=why))

    def halt(self, cause: str, who: str, detail: str) -> None:
        """Silence at once, and HALTED until `clear`. The first cause stands."""
        if self.states.state == "HALTED":
            self.board.safe_off()
            return
        self._silence(f"halted by {cause}")
        self._latch(cause, who, detail)
        self.end_lease("halted")

    def _latch(self, cause: str, who: str, detail: str) -> None:
        halt = Halt(cause=cause, who=who, detail=detail, t_ns=self.clock.now_ns())
        if self.states.stop(halt):
            self.reporter.halt(halt)
            self._tell_state(halt.t_ns)

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
        self._tell_state(self.clock.now_ns())

    # --- telling -----------------------------------------------------------------------------

    def answer(self, answer: Answer) -> None:
        """To the gateway, if it is there."""
        self._tell_gateway(answer)

    def _tell_gateway(self, message: Answer | LeaseEnded) -> None:
        if not self._dialogue.send(message):
            self.reporter.counters["answers_dropped"] += 1

    def _tell_state(self, now_ns: int) -> None:
        self._told_ns = now_ns
        self.reporter.state(state_report(self, now_ns))
