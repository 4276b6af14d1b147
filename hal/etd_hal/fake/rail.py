"""The high-voltage supply: enable line, heartbeat monostable, set-point, and its slow voltage.

Owns: the rail's course in time. Must not know: who reads it, what it drives.

The rail follows its target with one time constant up and another down. While it falls, its
capacitor also gives what the source draws: nothing else feeds a current whose supply was taken
away. A board without an enable line has its supply on from the start. A heartbeat that was lost
while the supply was enabled is latched: the supply comes back only after the enable line was off. A
stop that is open breaks the supply by its second contact, where the board file does not say that it
has none.
"""

from __future__ import annotations

from math import exp

from etd_hal.bench import StopName
from etd_hal.boardfile import BoardFile
from etd_hal.fake.faults import (
    EnableStuck,
    HeartbeatByLevel,
    HeartbeatIgnored,
    HeartbeatRearms,
    HeartbeatSlow,
    RailOff,
    RailStays,
    SetpointAtPowerUp,
    StopCutsLate,
    StopCutsNothing,
)
from etd_hal.fake.faults_due import Faults

#: The kits' supply: into its feedback string of 3 M, where the file gives no other figure.
_CAPACITOR_NF = 272
_FALL_TAU_NS = 820_000_000
_RISE_TAU_NS = 30_000_000
#: Time constants within the board file's `rise_ms`, and until `off_v` within `fall_ms`.
_RISE_TAUS = 8
_FALL_TAUS = 4
#: The lowest rail that the set-point can make, as a share of the nominal one.
_LOWEST = 0.5


class Rail:
    def __init__(self, board: BoardFile, faults: Faults, start_ns: int) -> None:
        guards = board.guards
        self._nominal_v = float(board.source.compliance_v)
        self._rise_tau_ns, self._fall_tau_ns = _RISE_TAU_NS, _FALL_TAU_NS
        if guards.rail_monitor != "absent":
            monitor = guards.rail_monitor
            self._nominal_v = (monitor.low_v + monitor.high_v) / 2
            self._rise_tau_ns = monitor.rise_ms * 1_000_000 // _RISE_TAUS
            self._fall_tau_ns = monitor.fall_ms * 1_000_000 // _FALL_TAUS
        self._enabled = guards.hv_enable == "absent"
        self._window_ns = (
            None if guards.heartbeat == "absent" else guards.heartbeat.window_ms * 1_000_000
        )
        self._heartbeat_level = 0
        self._beat_until_ns = start_ns
        self._has_beaten = False
        self._is_latched_off = False
        self._stops_cut = guards.stop_cuts_supply
        #: From when on each that is open cuts the supply.
        self._open_stops: dict[str, int] = {}
        self._setpoint_code = None if board.rail_setpoint == "absent" else board.rail_setpoint.code
        #: None: nothing was written to the set-point yet.
        self._set_code: int | None = None
        self._faults = faults
        self._t_ns = start_ns
        self._load_ua = 0.0
        self._volts = self._target_v() if self._enabled else 0.0

    @property
    def enabled(self) -> bool:
        """The enable line says on (whether or not the heartbeat agrees)."""
        return self._enabled

    def enable(self, t_ns: int, on: bool) -> None:
        self.volts(t_ns)
        if on and not self._enabled:
            self._has_beaten = self._is_latched_off = False
        self._enabled = on

    def heartbeat(self, t_ns: int, level: int) -> None:
        """What the gate sees of the heartbeat line: at each edge the monostable starts anew."""
        if self._window_ns is not None and level != self._heartbeat_level:
            self.volts(t_ns)
            self._heartbeat_level = level
            extra_ms = sum(slow.extra_ms for slow in self._faults.of(HeartbeatSlow))
            self._beat_until_ns = t_ns + self._window_ns + extra_ms * 1_000_000
            self._has_beaten = self._enabled

    def stop(self, t_ns: int, name: StopName, is_open: bool) -> None:
        """The contacts of a stop open or close."""
        self.volts(t_ns)
        if is_open:
            late_ms = sum(
                stop_cuts_late.late_ms
                for stop_cuts_late in self._faults.of(StopCutsLate)
                if stop_cuts_late.stop == name
            )
            self._open_stops[name] = t_ns + late_ms * 1_000_000
        else:
            self._open_stops.pop(name, None)

    def load(self, t_ns: int, load_ua: float) -> None:
        """What the source draws from now on."""
        self.volts(t_ns)
        self._load_ua = load_ua

    def set_point(self, t_ns: int, code: int) -> None:
        """The set-point's DAC changes; the board file's code makes the nominal rail."""
        self.volts(t_ns)
        self._set_code = code

    def woken_code(self) -> int:
        """What the set-point puts out until one is written."""
        return next((fault.code for fault in self._faults.of(SetpointAtPowerUp)), 0)

    def _setpoint(self) -> float:
        """The part of the nominal rail."""
        if not self._setpoint_code:
            return 1.0
        code = self.woken_code() if self._set_code is None else self._set_code
        return _LOWEST + (1 - _LOWEST) * code / self._setpoint_code

    def volts(self, t_ns: int) -> float:
        """The rail at `t_ns`; never earlier than asked before."""
        if self._window_ns is not None and self._is_held_on():
            self._beat_until_ns = max(self._beat_until_ns, t_ns + self._window_ns)
        if self._open_stops or self._t_ns < self._beat_until_ns < t_ns:
            self._turn_until(t_ns)
        self._follow(t_ns)
        return self._volts

    def _is_held_on(self) -> bool:
        return any(
            fault.level == self._heartbeat_level for fault in self._faults.of(HeartbeatByLevel)
        )

    def _turn_until(self, t_ns: int) -> None:
        for turn_ns in sorted((self._beat_until_ns, *self._open_stops.values())):
            if self._t_ns < turn_ns < t_ns:
                self._follow(turn_ns)
                self._latch()

    def _latch(self) -> None:
        if self._window_ns is not None and self._t_ns == self._beat_until_ns:
            rearms = bool(self._faults.of(HeartbeatRearms))
            self._is_latched_off |= self._has_beaten and self._enabled and not rearms

    def _follow(self, t_ns: int) -> None:
        target_v = self._target_v()
        if self._volts == target_v:
            self._t_ns = max(t_ns, self._t_ns)
            return
        gap_v = self._volts - target_v
        if gap_v > 0 and self._faults.of(RailStays):
            self._t_ns = max(t_ns, self._t_ns)
            return
        is_falling = gap_v > 0
        tau_ns = self._fall_tau_ns if is_falling else self._rise_tau_ns
        # As far below the target as the load would pull a string of this resistance by itself.
        load_v = self._load_ua * tau_ns / (_CAPACITOR_NF * 1e6) if is_falling else 0.0
        left = exp(-max(0, t_ns - self._t_ns) / tau_ns)
        self._volts = target_v + (gap_v + load_v) * left - load_v
        if abs(self._volts - target_v) < 0.01 or (is_falling and self._volts < target_v):
            self._volts = target_v
        self._t_ns = max(t_ns, self._t_ns)

    def _target_v(self) -> float:
        beating = self._window_ns is None or self._t_ns < self._beat_until_ns
        beating = beating and not self._is_latched_off
        enabled = self._enabled
        if self._faults.are_there:
            beating = beating or bool(self._faults.of(HeartbeatIgnored))
            enabled = enabled or bool(self._faults.of(EnableStuck))
        if not (enabled and beating) or self._is_cut_by_a_stop():
            return 0.0
        target_v = self._nominal_v * self._setpoint()
        for fault in self._faults.of(RailOff):
            target_v *= fault.factor
        return target_v

    def _is_cut_by_a_stop(self) -> bool:
        if not self._open_stops:
            return False
        bridged = {fault.stop for fault in self._faults.of(StopCutsNothing)}
        cuts = {name for name, from_ns in self._open_stops.items() if self._t_ns >= from_ns}
        return self._stops_cut and bool(cuts - bridged)
