"""The GPIO side of a board: which pin drives what, stop lines, and the rules of the switch.

Owns: the order and time of line changes, and who breaks a rule by one.
Must not know: SPI, I2C, what the current does.
"""

from __future__ import annotations

from etd_hal.bench import EdgeName, StopName
from etd_hal.boardfile import BoardFile, Relays
from etd_hal.fake.currentpath import CurrentPath
from etd_hal.fake.faults import (
    LineCut,
    LineInverted,
    LinesSwapped,
    PullMissing,
    StuckBehind,
    StuckLine,
)
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.halfbridges import HalfBridgeChain
from etd_hal.fake.lines import Lines
from etd_hal.fake.machines import MachineModel
from etd_hal.fake.rail import Rail
from etd_hal.fake.relays import RelayChain
from etd_hal.fake.timeline import Timeline
from etd_hal.fake.trace import Trace
from etd_hal.ports import Changes, Edge, LineSetup

_SWITCH_LINES = frozenset(("POL", "DATA", "LE", "BL", "CLK"))
_STOP_OF: dict[str, StopName] = {
    "EMERGENCY_STOP": "emergency_stop",
    "WEARER_STOP": "wearer_stop",
}
_SAFE_OFF_LINES = frozenset(("POL", "BL", "HV", "HEARTBEAT"))


class Header:
    def __init__(
        self,
        board: BoardFile,
        switch: HalfBridgeChain | RelayChain,
        path: CurrentPath,
        rail: Rail,
        faults: Faults,
        timeline: Timeline,
        trace: Trace,
        machine: MachineModel,
    ) -> None:
        self._board = board
        self._switch = switch
        self._path = path
        self._rail = rail
        self._faults = faults
        self._timeline = timeline
        self._trace = trace
        self._machine = machine
        self._line_of = board.used_lines()
        self._names = {line: name for name, line in self._line_of.items()}
        self._lines = Lines(self._levels_at_power_up())
        #: By the changes of a call, whether they move the switch.
        self._moves: dict[Changes, bool] = {}
        #: What the world does to inputs at a time to come: when, line, level.
        self._doings: list[tuple[int, int, int]] = []
        #: The level that the board sees of a line whatever is driven; None: no change of it. As of
        #: the faults' count of changes.
        self._altered: dict[str, int | None] = {}
        self._altered_at = -1
        #: The input that a line really drives, and 1 where the board reads the other level.
        self._rewired: dict[str, tuple[str, int]] = {}
        timeline.before_call.append(self._follow_world)

    def _levels_at_power_up(self) -> dict[int, int]:
        """What the pulls make: POL high, BL low, the supply off, stop loops closed."""
        levels = dict.fromkeys(self._line_of.values(), 0)
        hv_enable = self._board.guards.hv_enable
        for name in ("POL", "EMERGENCY_STOP", "WEARER_STOP"):
            if name in self._line_of:
                levels[self._line_of[name]] = 1
        for edge_input in (self._board.trigger, self._board.too_strong):
            if edge_input != "absent":
                levels[edge_input.line] = int(edge_input.edge == "falling")
        if hv_enable != "absent":
            levels[hv_enable.line] = 1 - hv_enable.on
        return levels

    def request(self, t_ns: int, setup: LineSetup) -> int:
        """Take the lines; initial levels go out in the order given. Raises: BusError."""
        self._lines.request(setup)
        t_ns = self._timeline.start(t_ns)
        for line, value in setup.outputs:
            self._put(t_ns, line, value, exempt=False)
            t_ns += self._machine.gpio_next_line_ns
        return self._timeline.end(t_ns + self._machine.gpio_call_ns)

    def release(self) -> None:
        """Let go of the lines; outputs keep their levels."""
        self._lines.release()

    def set(self, t_ns: int, changes: Changes) -> int:
        """Set outputs, one after another in ascending order. Raises: BusError."""
        ordered = self._lines.ascending(changes)
        t_ns = self._timeline.start(t_ns)
        # Asked only while current flows.
        exempt = bool(self._path.code) and self._is_safe_off(changes)
        at_ns = t_ns + self._machine.gpio_first_line_ns
        for line, value in ordered:
            self._put(at_ns, line, value, exempt)
            at_ns += self._machine.gpio_next_line_ns
        return self._timeline.end(t_ns + self._machine.gpio_call_ns)

    def moves_switch(self, changes: Changes) -> bool:
        """Whether the switch has any of the lines."""
        moves = self._moves.get(changes)
        if moves is None:
            moves = any(self._names.get(line) in _SWITCH_LINES for line, _ in changes)
            self._moves[changes] = moves
        return moves

    def let_float(self, t_ns: int) -> None:
        """No pin drives the outputs: the pulls do, as at power-up."""
        pulled = self._levels_at_power_up()
        wrong = {fault.name for fault in self._faults.of(PullMissing)}
        t_ns = self._timeline.start(t_ns)
        for line in self._lines.outputs:
            level = pulled[line] ^ (self._names[line] in wrong)
            self._put(t_ns, line, level, exempt=False)
        self._timeline.end(t_ns)

    def get(self, t_ns: int, line: int) -> tuple[int, int]:
        """The level of a line, and when the call ends. Raises: BusError."""
        t_ns = self._timeline.start(t_ns)
        name = self._names.get(line, "")
        if name == "READBACK":
            self._lines.put(line, self._switch.data_out)
        level = self._stuck(name, self._lines.read(line))
        if not self._lines.is_output(line):
            # Of an output the trace has every change already.
            self._trace.gpio(t_ns + self._machine.gpio_first_line_ns, line, level)
        return level, self._timeline.end(t_ns + self._machine.gpio_call_ns)

    def take_edges(self, t_ns: int) -> tuple[tuple[Edge, ...], int]:
        """The edges since the last call, and when this one ends. Raises: BusError."""
        t_ns = self._timeline.start(t_ns)
        edges = self._lines.take_edges()
        return edges, self._timeline.end(t_ns + self._machine.gpio_call_ns)

    def drive(self, t_ns: int, line: int, value: int) -> None:
        """One output changes on a bus that is not ours: a kernel's, which orders them itself."""
        t_ns = self._timeline.start(t_ns)
        self._put(t_ns, line, value, exempt=False)
        self._timeline.end(t_ns)

    def sense(self, t_ns: int, line: int) -> int:
        """What a line of such a bus reads."""
        self._timeline.start(t_ns)
        if self._names.get(line) == "READBACK":
            return self._stuck("READBACK", self._switch.data_out)
        return self._stuck(self._names.get(line, ""), self._lines.level(line))

    def move_stop(self, stop: StopName, value: int, at_ns: int | None) -> None:
        """The world opens (0) or closes (1) the loop of a stop line, now or at a time to come."""
        line = self._line_of.get(stop.upper())
        if line is None:
            raise ValueError(f"{self._board.name} has no {stop}")
        self._move(at_ns, line, value)

    def give_edge(self, name: EdgeName, lasts_ns: int, at_ns: int | None) -> None:
        """The world gives the edge of this input that counts, now or at a time to come; the line is
        back at rest after `lasts_ns`.
        """
        found = self._board.trigger if name == "trigger" else self._board.too_strong
        if found == "absent":
            raise ValueError(f"{self._board.name} has no {name}")
        begins_ns = self._timeline.now_ns if at_ns is None else at_ns
        level = int(found.edge == "rising")
        self._move(begins_ns, found.line, level)
        self._move(begins_ns + lasts_ns, found.line, 1 - level)

    def _move(self, at_ns: int | None, line: int, value: int) -> None:
        self._doings.append((self._timeline.now_ns if at_ns is None else at_ns, line, value))
        self._doings.sort()

    def _follow_world(self, t_ns: int) -> None:
        while self._doings and self._doings[0][0] <= t_ns:
            at_ns, line, value = self._doings.pop(0)
            stop = _STOP_OF.get(self._names[line])
            if stop is not None:
                self._rail.stop(at_ns, stop, value == 0)
            if self._lines.move_input(at_ns, line, value):
                self._trace.gpio(max(at_ns, self._timeline.now_ns), line, value)

    def _put(self, t_ns: int, line: int, value: int, exempt: bool) -> None:
        """One output is driven: record it, tell what hangs on it, and check the rules."""
        self._trace.gpio(t_ns, line, value)
        if not self._lines.put(line, value):
            return
        try:
            self._tell(t_ns, self._names.get(line, ""), value, exempt)
        except BaseException:
            # Not all have heard of it: a repeated call tells them again.
            self._lines.put(line, 1 - value)
            raise

    def _tell(self, t_ns: int, name: str, value: int, exempt: bool) -> None:
        level = value
        if self._faults.are_there:
            if self._altered_at != self._faults.changes:
                self._find_altered()
            if name in self._altered:
                seen = self._altered[name]
                if seen is None:
                    return
                level = seen
            elif name in self._rewired:
                name, is_inverted = self._rewired[name]
                level = value ^ is_inverted
        if name in _SWITCH_LINES:
            if self._path.code and not exempt:
                what = f"{name} changed with the DAC at code {self._path.code}"
                self._timeline.complain(t_ns, what)
            self._switch.set(t_ns, name, level)
        elif name == "HV":
            hv_enable = self._board.guards.hv_enable
            self._rail.enable(t_ns, hv_enable != "absent" and level == hv_enable.on)
        elif name == "HEARTBEAT":
            self._rail.heartbeat(t_ns, level)
        if self._switch.blanked_high and self._rail.enabled:
            self._timeline.complain(t_ns, "BL 0 with POL 0 while the supply is on")

    def _stuck(self, name: str, level: int) -> int:
        for fault in self._faults.of(StuckLine):
            if fault.name == name:
                return fault.level
        return level

    def _find_altered(self) -> None:
        """Stuck beyond the pin counts before stuck at it, and a line that is cut before both."""
        self._altered_at = self._faults.changes
        pins, behind = self._faults.of(StuckLine), self._faults.of(StuckBehind)
        self._altered = {fault.name: fault.level for fault in reversed(pins)}
        self._altered |= {fault.name: fault.level for fault in reversed(behind)}
        self._altered |= dict.fromkeys(cut.name for cut in self._faults.of(LineCut))
        self._rewired = {fault.name: (fault.name, 1) for fault in self._faults.of(LineInverted)}
        for swap in self._faults.of(LinesSwapped):
            self._rewired |= {swap.first: (swap.second, 0), swap.second: (swap.first, 0)}

    def _is_safe_off(self, changes: Changes) -> bool:
        """All on ground and the supply off: the one call that may come while current flows."""
        named = {self._names.get(line, ""): value for line, value in changes}
        if not set(named) <= _SAFE_OFF_LINES:
            return False
        if isinstance(self._board.switch, Relays):
            return True
        return named.get("POL") == 1 and named.get("BL") == 0
