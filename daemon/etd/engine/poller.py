"""The poll before every pulse, and whenever nothing is fired; it may change the state.

Owns: the order of the checks: the stopper, since a cut is a halt whatever follows; a board that is
not safe yet; what has lapsed, before any queue is read, so that after a stall nothing stale is
shown; then gateway, stop lines, rail and commands. The heartbeat comes last and shows that all of
them were done. Must not know: what is due, how a pulse is fired, ZeroMQ, files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, get_args

from etd.engine import commands
from etd.engine.components import Components
from etd.engine.reporting import STATE_PERIOD_NS
from etd.engine.supervisor import Supervisor
from etd.protocol.errors import Undecodable
from etd.protocol.link import StopNow
from etd_hal.bench import StopName
from etd_hal.boardfile import RailMonitor

#: Without a poll for longer than this the engine was stalled: no pulse takes that long.
_STALL_NS = 50_000_000
#: Causes of a halt that are lines.
_STOPS: Final = get_args(StopName)
#: At most so many commands hold up a pulse; the rest is read before the next pulse.
_COMMANDS_A_POLL = 64
#: More than a link holds: if messages remain, the gateway sends faster than the engine reads.
_READS_A_POLL = 16
#: Frames are planned for so long before the pulses go on, with a poll every `_MEANWHILE_NS`.
_PLANNING_NS = 10_000_000
_MEANWHILE_NS = 1_000_000
#: After a plan made during a scan, the next one waits so many times as long as that took: frames
#: that come faster than they can be planned must not take the pulses' time.
_PLANS_REST = 9
#: Edges of the wearer's button that follow within this time are the same press.
_BOUNCE_NS = 200_000_000
#: While the supply may be on, the stop lines are read this often, for an edge that was lost.
_LEVELS_NS = 2_000_000
#: Edges come this often within the monostable's window.
_BEATS_PER_WINDOW = 4


class Poller:
    def __init__(
        self,
        components: Components,
        supervisor: Supervisor,
        feed_watchdog: Callable[[int], None] = lambda _: None,
    ) -> None:
        self._backend = components.backend
        self._clock = components.clock
        self._host_clock = components.host_clock
        self._board = components.board
        self._liveness = components.stopper_liveness
        self._rail = components.rail
        self._reporter = components.reporter
        self._active = components.active
        self._gateway_link = components.gateway_link
        self._rail_monitor = components.loaded.board.guards.rail_monitor
        self._heartbeat = components.loaded.board.guards.heartbeat
        self._has_button = components.loaded.board.too_strong != "absent"
        self._pressed_ns = -_BOUNCE_NS
        self._levels_ns = 0
        self._supervisor = supervisor
        self._feed_watchdog = feed_watchdog
        self._beaten_ns = 0
        self._polled_host_ns = self._host_clock.now_ns()
        #: After a stall: since when the queue of frames has not been read.
        self._unseen_since_host_ns: int | None = None
        self._may_plan_ns = 0
        #: Spent on planning frames so far, polls meanwhile included.
        self.planning_ns = 0

    def poll(self, now_ns: int) -> None:
        """Check everything once. `now_ns`: on the board's clock."""
        # What another process sent is timed on the clock that both read.
        host_ns = self._host_clock.now_ns()
        if host_ns - self._polled_host_ns > _STALL_NS:
            self._unseen_since_host_ns = self._polled_host_ns
        self._polled_host_ns = host_ns
        # First of all: whatever else makes the board safe now, a cut is a halt.
        if self._liveness.judge(now_ns):
            self._heed_stopper()
        self._supervisor.make_safe_again(now_ns)
        # Before any queue is read: a waiting message must not renew what has lapsed.
        if self._supervisor.lease is not None and self._supervisor.lease.has_lapsed(host_ns):
            self._supervisor.end_lease("lapsed")
        self._active.expire(host_ns)
        if not self._gateway_link.is_well(host_ns):
            self._watch_gateway(host_ns)
        is_waiting = self._active.is_waiting
        stops = self._board.stop_edges(is_waiting)
        if stops:
            self._watch_stops(stops, host_ns)
        if self._supervisor.is_powered and now_ns - self._levels_ns >= _LEVELS_NS:
            self._levels_ns = now_ns
            self._watch_stop_levels()
        if self._has_button:
            self._heed_presses(self._board.take_presses())
        if is_waiting:
            self._active.trigger(self._board.take_triggers(), host_ns)
        if self._rail_monitor != "absent":
            self._watch_rail(self._rail_monitor, now_ns)
        self._execute_commands(host_ns)
        if self._supervisor.opening.pending is not None:
            commands.go_on_opening(self._supervisor, host_ns)
        if self._heartbeat != "absent":
            self.beat(now_ns)
        # A gateway that attaches is told the state at once; without one nothing is lost.
        is_due = now_ns - self._supervisor.reported_ns >= STATE_PERIOD_NS
        if is_due and self._gateway_link.is_attached:
            self._supervisor.report_state(now_ns)
        if self._backend.modelled is not None:
            self._reporter.modelled(self._backend.modelled, now_ns)
        self._feed_watchdog(host_ns)

    def _heed_stopper(self) -> None:
        """A cut halts in any state, since it is latched in any state. A stopper that has stopped
        checking halts a powered board.
        """
        supervisor, problem = self._supervisor, self._liveness.problem
        if self._liveness.has_acted and supervisor.states.state != "HALTED":
            supervisor.halt("fault", "stopper", self._liveness.why_acted)
        elif problem is not None and supervisor.is_powered:
            supervisor.halt("fault", "stopper", problem)

    def _watch_gateway(self, host_ns: int) -> None:
        if self._gateway_link.undecodable is not None:
            self._hang_up(self._gateway_link.undecodable, host_ns)
        elif self._gateway_link.is_gone:
            self._heed_last_stops(host_ns)
            self._gateway_link.hang_up()
            self._supervisor.opening.cancel()
            self._supervisor.end_lease("the gateway is gone")
        elif self._gateway_link.is_silent(host_ns) and self._supervisor.lease is not None:
            # Messages sent before a stall of the engine still wait in the queue.
            self._execute_commands(host_ns)
            if self._gateway_link.is_silent(host_ns):
                self._supervisor.end_lease("the gateway is silent")

    def _hang_up(self, undecodable: Undecodable, host_ns: int) -> None:
        """Ends the connection to a gateway whose message could not be decoded."""
        self._heed_last_stops(host_ns)
        why = f"the gateway sent {undecodable}"
        self._reporter.undecodable(why, self._clock.now_ns())
        self._supervisor.opening.cancel()
        self._supervisor.end_lease(why, counted="undecodable")
        self._gateway_link.hang_up()

    def _heed_last_stops(self, host_ns: int) -> None:
        """A stop that waits in the queue is still executed; no other command is."""
        for _ in range(_COMMANDS_A_POLL):
            command = self._gateway_link.command(host_ns)
            if isinstance(command, StopNow):
                commands.execute(self._supervisor, command, host_ns)

    def _watch_stops(self, stops: Sequence[tuple[StopName, bool]], host_ns: int) -> None:
        for name, is_open in stops:
            states = self._supervisor.states
            is_live = states.state in ("PROBE", "ARMED")
            if name == "wearer_stop":
                is_to_stop = is_live or (states.halt is not None and states.halt.cause in _STOPS)
                self._supervisor.sessions.stop_moved(
                    is_open=is_open, is_to_stop=is_to_stop, now_ns=host_ns
                )
            if is_open and is_live:
                self._stopped(name, "the stop line opened")
                return

    def _heed_presses(self, edges_ns: Sequence[int]) -> None:
        """A press counts once. A wire that chatters only lowers what is felt."""
        for edge_ns in edges_ns:
            if edge_ns - self._pressed_ns >= _BOUNCE_NS:
                self._pressed_ns = edge_ns
                commands.hear_button(self._supervisor)

    def _watch_stop_levels(self) -> None:
        """For an edge that may have been lost: a trigger shares the kernel's queue of them."""
        for name, is_open in self._board.stops().items():
            if is_open:
                self._stopped(name, "the stop line is open")
                return

    def _stopped(self, name: StopName, detail: str) -> None:
        self._supervisor.halt(name, name, detail)
        self._supervisor.sessions.stopped(name)

    def _watch_rail(self, monitor: RailMonitor, now_ns: int) -> None:
        """While pulses are fired: before that the power-up judges a rail that rises."""
        power_up = self._supervisor.power_up
        is_measured = power_up is not None and power_up.is_measuring
        if self._supervisor.states.state != "ARMED" and not is_measured:
            return
        rail_v = self._rail.rail_v(now_ns)
        if rail_v is None:
            self._supervisor.halt(
                "fault", "rail", f"the rail is not known ({self._rail.problem or 'stale'})"
            )
        elif not monitor.low_v <= rail_v <= monitor.high_v:
            self._supervisor.halt(
                "fault", "rail", f"{rail_v:.0f} V, not {monitor.low_v} to {monitor.high_v} V"
            )

    def _execute_commands(self, host_ns: int) -> None:
        link = self._gateway_link
        command, executed = link.command(host_ns), 0
        while command is not None:
            commands.execute(self._supervisor, command, host_ns)
            executed += 1
            command = link.command(host_ns) if executed < _COMMANDS_A_POLL else None
        if self._reporter.accounts.awaited:
            commands.answer_accounts(self._supervisor)

    def take_frames(self) -> None:
        """Reads and plans the frames that wait. Planning takes time that the pulses need: only the
        newest streamed frame is planned, and planning stops after `_PLANNING_NS`, one frame at
        least.
        """
        self._read_frames()
        queue = self._gateway_link.queue
        self._reporter.superseded(queue.take_superseded())
        begun_ns = now_ns = self._clock.now_ns()
        while now_ns - begun_ns < _PLANNING_NS and (came := queue.next()) is not None:
            host_ns = self._host_clock.now_ns()
            steps = commands.take_frame(self._supervisor, came.message, host_ns, came.came_host_ns)
            for _ in steps:
                self.poll_meanwhile()
            now_ns = self._clock.now_ns()
        self.planning_ns += now_ns - begun_ns

    def poll_meanwhile(self) -> None:
        """Polls during work that takes longer than the time between two polls may be."""
        if self._host_clock.now_ns() - self._polled_host_ns >= _MEANWHILE_NS:
            self.poll(self._clock.now_ns())

    def _read_frames(self) -> None:
        """Polls between two reads: a gateway may send without end. A frame may have come since the
        last poll.
        """
        for _ in range(_READS_A_POLL):
            came_host_ns = self._unseen_since_host_ns or self._polled_host_ns
            if self._gateway_link.read_frames(came_host_ns):
                self._unseen_since_host_ns = None
                return
            # The remaining frames may have waited as long as those that were read.
            self._unseen_since_host_ns = came_host_ns
            if self._gateway_link.queue.is_full:
                return
            self.poll(self._clock.now_ns())

    def take_frames_within(self) -> None:
        """Takes frames during a scan, so that a lower current need not wait for its end."""
        begun_ns = self._clock.now_ns()
        if begun_ns >= self._may_plan_ns:
            self.take_frames()
            now_ns = self._clock.now_ns()
            self._may_plan_ns = now_ns + _PLANS_REST * (now_ns - begun_ns)

    def beat(self, now_ns: int) -> None:
        heartbeat = self._heartbeat
        if heartbeat == "absent" or self._supervisor.states.state not in ("PROBE", "ARMED"):
            return
        if now_ns - self._beaten_ns >= heartbeat.window_ms * 1_000_000 // _BEATS_PER_WINDOW:
            self._beaten_ns = now_ns
            self._board.beat()
