"""The engine's loop: the life of a pulse, from the poll before it to the report of it.

Owns: the order of the steps of one pulse. Must not know: ZeroMQ, JSON, files, threads, which
backend there is, what is due when (`sequencer.py`), what a poll checks (`poller.py`), how the
states follow one another (`supervisor.py`).

Nothing that a step calls calls back into the step. A poll may end everything: what is due is
determined after the poll.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from etd.engine.clearance import Cleared
from etd.engine.components import components_of
from etd.engine.idle_wait import TICK_NS
from etd.engine.opening import GivenCalibrations
from etd.engine.poller import Poller
from etd.engine.sequencer import Sequencer
from etd.engine.supervisor import Supervisor
from etd.files.calibration_process import CalibrationReader
from etd.files.configuration import LoadedConfig
from etd.planning.schedule import AfterProbe, DuePulse
from etd.protocol.errors import BoardFault, BusError, GuardRefusal
from etd.protocol.link import Channel, NewFrame, ToEngine
from etd.stabilize.pipeline import Stabilizer
from etd_hal.backend import Backend
from etd_hal.supply_note import SupplyNote


class Engine:
    """See the module. `process.py` calls `step` in a loop; tests call it too."""

    def __init__(
        self,
        loaded: LoadedConfig,
        backend: Backend,
        *,
        stabilizers: Sequence[Stabilizer] | None = None,
        feed_watchdog: Callable[[int], None] = lambda _: None,
        untested: Callable[[], str | None] = lambda: None,
        supply_note: SupplyNote | None = None,
        calibrations: CalibrationReader | None = None,
    ) -> None:
        """`stabilizers` None: those of the body-site file. `calibrations` None: there are none, and
        leases are opened with limits. `untested` returns the sentence with
        which arming is refused because of the last self-test; it is called at each arming, and for
        each state report while no current can flow. `supply_note`: what the stopper keeps, and what
        the last engine may have left.
        """
        self.components = components = components_of(
            loaded, backend, calibrations or GivenCalibrations({}), stabilizers, supply_note
        )
        self.supervisor = Supervisor(components, untested)
        self._poller = Poller(components, self.supervisor, feed_watchdog)
        self._sequencer = Sequencer(components, self.supervisor, self._poller)
        #: The time and the array's ceiling of the last poll.
        self._polled_ns = 0
        self._ceiling_ua = 0
        #: The pulse whose own probe has just been fired.
        self._follow_up: DuePulse | None = None

    def attach(self, commands: Channel[ToEngine], frames: Channel[NewFrame]) -> None:
        """A gateway has connected."""
        parts = self.components
        parts.gateway_link.attach(commands, frames, parts.host_clock.now_ns())
        parts.pulse_log.turn(is_on=False)
        self.supervisor.greet()
        self.supervisor.report_state(parts.clock.now_ns())

    @property
    def has_gateway(self) -> bool:
        return self.components.gateway_link.is_attached

    @property
    def is_between_scans(self) -> bool:
        """Neither a scan nor a measurement of contact is under way."""
        return self._sequencer.is_between_scans

    def step(self) -> None:
        """One poll, then what is due: one pulse at most. Never raises EtdError."""
        clock = self.components.clock
        try:
            self._step()
        except (BusError, GuardRefusal, BoardFault) as fault:
            self._follow_up = None
            self.supervisor.halt("fault", type(fault).__name__, str(fault))
            self._sequencer.leave()
            # A board that is gone fails every step, which must not keep a core busy.
            clock.doze_until_ns(clock.now_ns() + TICK_NS)

    def _step(self) -> None:
        """The life of a pulse, in its order."""
        due, self._follow_up = self._follow_up, None
        if due is None:
            now_ns = self._poll()
            if self._sequencer.holds(now_ns):
                return
            due = self._sequencer.next_due()
            if due is None:
                if self._sequencer.go_on():
                    self._check_source()
                return
        parts, board = self.components, self.components.board
        scheduled, is_connected = due.scheduled, due.after is not None
        asked_ns, ceiling_ua = self._polled_ns, self._ceiling_ua
        if due.after is not None:
            asked_ns, ceiling_ua = due.after.asked_ns, due.after.ceiling_ua
        else:
            board.prepare(scheduled.selection, whole=due.rewrites_chain)
        cleared = self._cleared(due, ceiling_ua, asked_ns)
        booking = None
        if cleared is not None:
            firing = parts.firing
            booking = firing.book(cleared) if is_connected else firing.connect(cleared)
        if cleared is None or booking is None or not self._still_valid(due):
            if is_connected or booking is not None:
                board.discharge()
            if booking is not None:
                parts.firing.take_back(booking)
            if parts.pulse_log.is_on:
                parts.pulse_log.withheld(due, parts.reporter.seq, asked_ns)
            self._sequencer.not_fired(due)
            return
        first, last = parts.firing.fire(booking, cleared, stays_connected=cleared.leads)
        if cleared.leads:
            parts.findings.of_probe(due, cleared, first, asked_ns)
            after = AfterProbe(cleared.request, cleared.pulse.commanded_ua, asked_ns, ceiling_ua)
            # The pulse itself is due at once, with nothing in between.
            self._follow_up = due.following(after)
            return
        parts.findings.of_pulse(due, cleared, first, last)
        parts.findings.report(due, cleared, first, last, asked_ns)
        self._sequencer.fired(due, first.begun_ns)

    def _poll(self) -> int:
        """Check everything that can stop a pulse; returns the time now."""
        parts, now_ns = self.components, self.components.clock.now_ns()
        self._polled_ns = now_ns
        self._poller.poll(now_ns)
        active = parts.active
        if active.scanning is None and self.is_between_scans:
            return now_ns
        if now_ns >= parts.reporter.due_ns:
            parts.reporter.scan_report(now_ns, parts.soft_start.ceiling_ua)
            parts.pulse_log.send_off()
        if self.supervisor.states.state == "PROBE":
            self._ceiling_ua = self.supervisor.maxima.probe_current_ua
        elif active.schedule is not None:
            self._ceiling_ua = parts.soft_start.due(now_ns)
        return now_ns

    def _check_source(self) -> None:
        """Raises: BoardFault, for a source that makes another current than it is told; BusError and
        GuardRefusal.
        """
        fault = self.components.source_check.check(self.components.clock.now_ns())
        if fault is not None:
            raise fault
        self._sequencer.checked()

    def _cleared(self, due: DuePulse, ceiling_ua: int, now_ns: int) -> Cleared | None:
        """The pulse that may be fired now; its probe first, where it has one."""
        parts = self.components
        request = parts.requests.of(due, now_ns)
        if request is None:
            return None
        cleared = parts.clearance.limit(due, request, ceiling_ua, now_ns)
        if cleared is None:
            return None
        probe = parts.requests.probe_before(due, cleared.given)
        return parts.clearance.fit(due, cleared, probe, now_ns)

    def _still_valid(self, due: DuePulse) -> bool:
        """Checked once the electrodes are connected. Where connecting takes milliseconds,
        everything is polled again; where it is one call, the frame's expiry is enough.
        """
        parts, supervisor = self.components, self.supervisor
        if due.purpose == "measurement":
            self._poll()
            power_up = supervisor.power_up
            return supervisor.states.state == "PROBE" and power_up is not None and power_up.has(due)
        if parts.board.switch.can_choose_returns:
            self._poll()
        schedule = parts.active.schedule
        if schedule is None or schedule is not parts.active.scanning:
            return False
        return parts.host_clock.now_ns() < schedule.expires_host_ns
