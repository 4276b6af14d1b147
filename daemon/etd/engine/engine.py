"""The engine's loop: what is watched before every pulse, frames, and the scan.

Owns: the order in which things are looked at each turn, and before every pulse.
Must not know: ZeroMQ, JSON, files, threads, which backend there is.

A turn: watch (gateway silent? lease lapsed? a stop line open? rail away? commands?), take frames,
then one scan if one is due, or a short sleep. The same watch is kept before every pulse. Lapses
are looked at before any queue is read: after a stall nothing stale is shown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import islice

from etd.config import LoadedConfig
from etd.engine import commands
from etd.engine.core import Core
from etd.engine.reporting import STATE_PERIOD_NS
from etd.engine.telling import greeting
from etd.errors import BoardFault, BusError, GuardRefusal, Undecodable
from etd.link import Channel, NewFrame, StopNow, ToEngine
from etd.stabilize.pipeline import Stabilizer
from etd_hal.backend import Backend

#: Between two looks when nothing is due; the heartbeat's monostable wants edges as well.
TICK_NS = 1_000_000
#: Without a look for longer than this the engine was stalled: no visit takes as long.
_STALL_NS = 50_000_000
#: Whatever lies there, a pulse is not held up by more; the rest is read before the next one.
_COMMANDS_A_LOOK = 64
#: More than a link holds: a rest that is left is of a gateway that sends faster than it is read.
_READS_A_LOOK = 16
#: Frames are planned for so long before the pulses go on.
_PLANNING_NS = 10_000_000
#: After a plan made while a scan is under way, the next one waits so many times as long as it took:
#: whoever sends frames faster than they can be planned must not take the time of the pulses.
_PLANS_REST = 9
#: Edges come this often within the monostable's window.
_BEATS_PER_WINDOW = 4


class Engine(Core):
    """See the module. `turn` is called for ever by `process.py`, and by tests."""

    def __init__(
        self,
        loaded: LoadedConfig,
        backend: Backend,
        *,
        stabilizers: Sequence[Stabilizer] | None = None,
        feed_watchdog: Callable[[int], None] = lambda _: None,
        untested: Callable[[], str | None] = lambda: None,
    ) -> None:
        """`untested`: the sentence for which arming is refused, by the last self-test. Asked
        at each arming, and for each state report while nothing can flow.
        """
        super().__init__(loaded, backend, stabilizers=stabilizers, untested=untested)
        self._feed_watchdog = feed_watchdog
        self._beaten_ns = 0
        self._wearer_stop_was_open = False
        self._looked_host_ns = self.host_clock.now_ns()
        #: After a stall: since when nobody has looked at what lies in the queue of frames.
        self._unseen_since_host_ns: int | None = None
        self._may_plan_ns = 0

    def attach(self, commands_: Channel[ToEngine], frames: Channel[NewFrame]) -> None:
        """A gateway has connected."""
        self._dialogue.attach(commands_, frames, self.host_clock.now_ns())
        self._dialogue.send(
            greeting(self.loaded, self.maxima, self.board.switch.states, self.backend.name)
        )
        self._tell_state(self.clock.now_ns())

    @property
    def has_gateway(self) -> bool:
        return self._dialogue.is_attached

    def turn(self) -> None:
        """One look at everything, then a scan or a short sleep. Never raises EtdError."""
        try:
            self._watch(self.clock.now_ns())
            self._take_frames()
            self._work(self.clock.now_ns())
        except (BusError, GuardRefusal, BoardFault) as fault:
            self.halt("fault", type(fault).__name__, str(fault))
            # A board that is gone for good fails every turn: that must not keep a core busy.
            self.clock.doze_until_ns(self.clock.now_ns() + TICK_NS)

    def _work(self, now_ns: int) -> None:
        if self._energizer is not None:
            self._climb(self._energizer, now_ns, self._may_fire)
        standing = self.scanner.standing
        if standing is None or self.states.state != "ARMED":
            self._doze_until(now_ns + TICK_NS)
            return
        if now_ns < standing.next_ns:
            self._wait_for(standing.next_ns, now_ns + TICK_NS)
            return
        if self._visitor.firing.has_drifted:
            self._calibrate_again()
        self._look_at_stop_levels()
        self.scanner.scan(self._visitor, self._may_fire, self._take_frames_within)

    def _wait_for(self, next_ns: int, tick_ns: int) -> None:
        """A scan begins when it is due; a look between two of them may be late, by half a tick."""
        if next_ns > tick_ns + TICK_NS // 2:
            self._doze_until(tick_ns)
            return
        self.reporter.scan_report(self.clock.now_ns(), self.opening.ceiling_ua)
        self.clock.sleep_until_ns(next_ns)

    def _doze_until(self, deadline_ns: int) -> None:
        self.reporter.scan_report(self.clock.now_ns(), self.opening.ceiling_ua)
        self.clock.doze_until_ns(deadline_ns)

    def _calibrate_again(self) -> None:
        self.board.calibrate(lambda: self._beat(self.clock.now_ns()))
        self._visitor.firing.forget_drift()
        self.reporter.counters["recalibrated"] += 1
        self.planner_of_lease()

    # --- before every pulse ------------------------------------------------------------------

    def _may_fire(self, now_ns: int) -> int | None:
        """The ceiling in uA now, or None when no pulse may be fired."""
        self._watch(now_ns)
        self.reporter.scan_report(now_ns, self.opening.ceiling_ua)
        if self.states.state == "ARMED":
            return self.opening.due(now_ns) if self.scanner.standing is not None else None
        if self.states.state == "PROBE" and self._energizer is not None:
            return self.maxima.probe_current_ua
        return None

    def _watch(self, now_ns: int) -> None:
        # What another process said holds for a time of the clock that it reads too.
        host_ns = self.host_clock.now_ns()
        if host_ns - self._looked_host_ns > _STALL_NS:
            self._unseen_since_host_ns = self._looked_host_ns
        self._looked_host_ns = host_ns
        # Before anything is read: what lies in a queue must not renew what has lapsed.
        if self.lease is not None and self.lease.has_lapsed(host_ns):
            self.end_lease("lapsed")
        self.scanner.expire(host_ns)
        self._watch_gateway(host_ns)
        self._watch_stops()
        self._watch_rail(now_ns)
        self._obey(host_ns)
        self._beat(now_ns)
        if now_ns - self._told_ns >= STATE_PERIOD_NS:
            self._tell_state(now_ns)
        if self.backend.modelled is not None:
            self.reporter.modelled(self.backend.modelled, now_ns)
        self._feed_watchdog(host_ns)

    def _watch_gateway(self, host_ns: int) -> None:
        if self._dialogue.undecodable is not None:
            self._hang_up(self._dialogue.undecodable, host_ns)
        elif self._dialogue.is_gone:
            self._dialogue.hang_up()
            self.end_lease("the gateway is gone")
        elif self._dialogue.is_silent(host_ns) and self.lease is not None:
            # What it said just before a stall of ours still lies in the queue.
            self._obey(host_ns)
            if self._dialogue.is_silent(host_ns):
                self.end_lease("the gateway is silent")

    def _hang_up(self, undecodable: Undecodable, host_ns: int) -> None:
        """On a gateway that says what no gateway says. A stop may lie there that was sent before or
        beside it; nothing else is taken from it.
        """
        for command in islice(self._dialogue.commands(host_ns), _COMMANDS_A_LOOK):
            if isinstance(command, StopNow):
                commands.obey(self, command, host_ns)
        why = f"the gateway sent {undecodable}"
        self.reporter.undecodable(why, self.clock.now_ns())
        self.end_lease(why, counted="undecodable")
        self._dialogue.hang_up()

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

    def _look_at_stop_levels(self) -> None:
        """Once a scan, for an edge that may have been lost."""
        for name, is_open in self.board.stops().items():
            if is_open:
                self.halt(name, name, "the stop line is open")
                return

    def _watch_rail(self, now_ns: int) -> None:
        monitor = self.loaded.board.guards.rail_monitor
        if monitor == "absent" or self.states.state != "ARMED":
            return
        rail_v = self.rail.rail_v(now_ns)
        if rail_v is None:
            self.halt("fault", "rail", f"the rail is not known ({self.rail.problem or 'stale'})")
        elif not monitor.low_v <= rail_v <= monitor.high_v:
            self.halt("fault", "rail", f"{rail_v:.0f} V, not {monitor.low_v} to {monitor.high_v} V")

    def _obey(self, host_ns: int) -> None:
        for command in islice(self._dialogue.commands(host_ns), _COMMANDS_A_LOOK):
            commands.obey(self, command, host_ns)

    def _take_frames(self) -> None:
        """What lies there now. Planning takes time that the pulses cannot spare: of those that were
        streamed the newest wins, and they are planned for so long at a time, one at least.
        """
        self._read_frames()
        queue = self._dialogue.queue
        self.reporter.superseded(queue.take_superseded())
        begun_ns = now_ns = self.clock.now_ns()
        while now_ns - begun_ns < _PLANNING_NS and (came := queue.next()) is not None:
            host_ns = self.host_clock.now_ns()
            for _ in commands.take_frame(self, came.message, host_ns, came.came_host_ns):
                self._look_meanwhile()
            now_ns = self.clock.now_ns()

    def _look_meanwhile(self) -> None:
        """While something is worked at that takes longer than everything may go unwatched."""
        if self.host_clock.now_ns() - self._looked_host_ns >= TICK_NS:
            self._watch(self.clock.now_ns())

    def _read_frames(self) -> None:
        """With the watch kept between two reads: there is no end to what a gateway may send."""
        for _ in range(_READS_A_LOOK):
            host_ns = self.host_clock.now_ns()
            came_host_ns = self._unseen_since_host_ns or host_ns
            if self._dialogue.read_frames(came_host_ns):
                self._unseen_since_host_ns = None
                return
            # What is left may have lain there for as long as what was read.
            self._unseen_since_host_ns = came_host_ns
            if self._dialogue.queue.is_full:
                return
            self._watch(self.clock.now_ns())

    def _take_frames_within(self) -> None:
        """While a scan is under way, so that a fall need not wait for its end."""
        begun_ns = self.clock.now_ns()
        if begun_ns >= self._may_plan_ns:
            self._take_frames()
            now_ns = self.clock.now_ns()
            self._may_plan_ns = now_ns + _PLANS_REST * (now_ns - begun_ns)

    def _beat(self, now_ns: int) -> None:
        heartbeat = self.loaded.board.guards.heartbeat
        if heartbeat == "absent" or self.states.state not in ("PROBE", "ARMED"):
            return
        if now_ns - self._beaten_ns >= heartbeat.window_ms * 1_000_000 // _BEATS_PER_WINDOW:
            self._beaten_ns = now_ns
            self.board.beat()
