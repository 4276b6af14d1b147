"""One fake board behind its wires: what each port call does, and when.

Owns: the wiring of chips, rail, switch and body, the kernel's limits on a message, the order and
time of every effect, and the list of rules that were broken.
Must not know: clocks (times come in and go out as nanoseconds), threads, sockets.

Every call comes with the time it starts at and answers with the time it ends at. The kernel's
limits are those of spidev on 64-bit Raspberry Pi OS: each transfer with data is rounded up to
128 bytes in a buffer of 4096, for tx and rx apart, and 512 transfers wrap to a message of none.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence

from etd_body.interface import Sides
from etd_hal.boardfile import BoardFile, Relays
from etd_hal.errors import BusError
from etd_hal.fake import pi4
from etd_hal.fake.ad5452 import Ad5452
from etd_hal.fake.ad7276 import Ad7276
from etd_hal.fake.currentpath import CurrentPath
from etd_hal.fake.faults import (
    I2C_TIMEOUT_NS,
    Fault,
    Faults,
    MisoStuck,
    SpiError,
    SpiShort,
    SpiStall,
    StuckLine,
)
from etd_hal.fake.halfbridges import HalfBridgeChain
from etd_hal.fake.i2cchips import Ads1115, I2cChip, Mcp4725
from etd_hal.fake.lines import Lines
from etd_hal.fake.rail import Rail
from etd_hal.fake.relays import RelayChain
from etd_hal.fake.trace import Trace
from etd_hal.fake.world import StopLine, Touchable, World
from etd_hal.ports import Changes, Edge, LineSetup, Message, SpiSetup, Transfer

_BUFFER_BYTES = 4_096
_ROUNDED_TO = 128
_WRAPS_AT = 512
_SWITCH_LINES = ("POL", "DATA", "LE", "BL", "CLK")
_SAFE_OFF_LINES = frozenset(("POL", "BL", "HV", "HEARTBEAT"))
#: Above this, two closed relays of one electrode would carry current.
_RAIL_IS_UP_V = 30.0
_MOST_VIOLATIONS = 100

#: What a message read, one entry for each transfer with data, and when it ended.
Played = tuple[tuple[bytes, ...], int]


class Circuit:
    def __init__(
        self,
        board: BoardFile,
        body: Touchable,
        electrodes: Sequence[int],
        trace: Trace,
        faults: Iterable[Fault],
        *,
        start_ns: int,
        seed: int,
    ) -> None:
        self.board = board
        self.violations: list[str] = []
        self._faults = Faults(faults)
        self._trace = trace
        self._last_ns = start_ns
        self._names = {line: name for name, line in board.used_lines().items()}
        self._line_of = board.used_lines()
        self._lines = Lines(self._levels_at_power_up())
        self._presses: list[tuple[int, int, int]] = []
        self._rail = Rail(board, self._faults, start_ns)
        self._switch = self._make_switch(electrodes, seed)
        self._path = CurrentPath(board, body, self._rail, self._faults, trace, self._switch.sides)
        self._path.set_sides(start_ns, self._switch.sides)
        self._spi: SpiSetup | None = None
        self._dac = Ad5452(1, self._path.set_code, self._complain)
        self._adc = Ad7276(1)
        self.world = World(body, self._rail, self._faults, self._move_line, self.now_ns)
        self._i2c = self._make_i2c_chips()
        trace.begin(board, electrodes)

    @property
    def dac_code(self) -> int:
        """What the DAC's output stands at."""
        return self._path.code

    @property
    def sides(self) -> Sides:
        """What the switch connects, per electrode."""
        return self._switch.sides

    # Building

    def _levels_at_power_up(self) -> dict[int, int]:
        """What the pulls make: POL high, BL low, the supply off, stop loops closed."""
        levels = dict.fromkeys(self._line_of.values(), 0)
        guards = self.board.guards
        for name in ("POL", "EMERGENCY_STOP", "WEARER_STOP"):
            if name in self._line_of:
                levels[self._line_of[name]] = 1
        if guards.hv_enable != "absent":
            levels[guards.hv_enable.line] = 1 - guards.hv_enable.on
        return levels

    def _make_switch(self, electrodes: Sequence[int], seed: int) -> HalfBridgeChain | RelayChain:
        switch = self.board.switch
        for electrode, output in enumerate(electrodes):
            if not 0 <= output < switch.outputs:
                raise ValueError(f"electrode {electrode} is on output {output} of {switch.outputs}")
        if isinstance(switch, Relays):
            return RelayChain(switch, electrodes, self._faults, self._relays_moved, seed=seed)
        return HalfBridgeChain(
            switch.outputs, electrodes, self._faults, self._outputs_changed, seed=seed
        )

    def _make_i2c_chips(self) -> dict[int, I2cChip]:
        chips: dict[int, I2cChip] = {}
        monitor = self.board.guards.rail_monitor
        if monitor != "absent":
            own = (monitor.address, monitor.channel)

            def input_v(t_ns: int, channel: int) -> float:
                if (monitor.address, channel) == own:
                    return self._rail.volts(t_ns) / monitor.divider
                return self.world.sensor_v(monitor.address, channel)

            chips[monitor.address] = Ads1115(input_v)
        if self.board.rail_setpoint != "absent":
            chips[self.board.rail_setpoint.address] = Mcp4725(self._rail.set_point)
        return chips

    # Requests

    def request(self, t_ns: int, lines: LineSetup, spi: SpiSetup) -> int:
        """Take the lines, with their initial levels, and open the SPI device.

        Raises: BusError (`busy`, `invalid`, `absent`).
        """
        if spi.device != self.board.source.spi:
            raise BusError("absent", spi.device, "open", "the board is on another device")
        if spi.mode not in (0, 1, 2, 3):
            raise BusError("invalid", spi.device, "open", f"there is no mode {spi.mode}")
        self._lines.request(lines)
        self._spi = spi
        self._dac = Ad5452(spi.mode, self._path.set_code, self._complain)
        self._adc = Ad7276(spi.mode)
        t_ns = self._start(t_ns)
        for line, value in lines.outputs:
            self._put(t_ns, line, value, exempt=False)
            t_ns += pi4.GPIO_NEXT_LINE_NS
        return self._end(t_ns + pi4.GPIO_CALL_NS)

    def release(self) -> None:
        """Let go of everything; outputs keep their levels."""
        self._lines.release()
        self._spi = None
        self._trace.write()

    # GPIO

    def set_lines(self, t_ns: int, changes: Changes) -> int:
        """Raises: BusError."""
        ordered = self._lines.ascending(changes)
        t_ns = self._start(t_ns)
        exempt = self._is_safe_off(changes)
        at_ns = t_ns + pi4.GPIO_FIRST_LINE_NS
        for line, value in ordered:
            self._put(at_ns, line, value, exempt)
            at_ns += pi4.GPIO_NEXT_LINE_NS
        return self._end(t_ns + pi4.GPIO_CALL_NS)

    def get_line(self, t_ns: int, line: int) -> tuple[int, int]:
        """Raises: BusError."""
        t_ns = self._start(t_ns)
        if self._names.get(line) == "READBACK":
            self._lines.put(line, self._switch.data_out)
        level = self._stuck(self._names.get(line, ""), self._lines.read(line))
        end_ns = t_ns + pi4.GPIO_CALL_NS
        self._trace.gpio(t_ns + pi4.GPIO_FIRST_LINE_NS, line, level)
        return level, self._end(end_ns)

    def take_edges(self, t_ns: int) -> tuple[tuple[Edge, ...], int]:
        """Raises: BusError."""
        t_ns = self._start(t_ns)
        edges = self._lines.take_edges()
        return edges, self._end(t_ns + pi4.GPIO_CALL_NS)

    def _put(self, t_ns: int, line: int, value: int, exempt: bool) -> None:
        """One output changes: record it, tell what hangs on it, and check the invariants."""
        self._trace.gpio(t_ns, line, value)
        changed = self._lines.put(line, value)
        name = self._names.get(line, "")
        if not changed:
            return
        self._switch.settle(t_ns)
        if name in _SWITCH_LINES:
            if self._path.code and not exempt:
                self._complain(t_ns, f"{name} changed with the DAC at code {self._path.code}")
            self._switch.set(t_ns, name, self._stuck(name, value))
        elif name == "HV":
            self._enable(t_ns, value)
        elif name == "HEARTBEAT":
            self._rail.beat(t_ns)
        if self._switch.blanked_high and self._rail.enabled:
            self._complain(t_ns, "BL 0 with POL 0 while the supply is on")

    def _enable(self, t_ns: int, value: int) -> None:
        hv_enable = self.board.guards.hv_enable
        if hv_enable != "absent":
            self._rail.enable(t_ns, self._stuck("HV", value) == hv_enable.on)

    def _stuck(self, name: str, level: int) -> int:
        for fault in self._faults.of(StuckLine):
            if fault.name == name:
                return fault.level
        return level

    def _is_safe_off(self, changes: Changes) -> bool:
        """Blank to ground and supply off: the one call that may come while current flows."""
        named = {self._names.get(line, ""): value for line, value in changes}
        if isinstance(self.board.switch, Relays):
            return set(named) <= _SAFE_OFF_LINES
        blanked = named.get("POL") == 1 and named.get("BL") == 0
        return blanked and set(named) <= _SAFE_OFF_LINES

    def _outputs_changed(self, t_ns: int, sides: Sides) -> None:
        self._path.set_sides(t_ns, sides)

    def _relays_moved(self, t_ns: int, sides: Sides, shorted: bool) -> None:
        if shorted and (self._path.code or self._rail.volts(t_ns) > _RAIL_IS_UP_V):
            self._complain(t_ns, "both relays of one electrode closed while current can flow")
        self._path.set_sides(t_ns, sides, shorted)

    # The stop lines, driven by the world

    def _move_line(self, stop: StopLine, value: int, at_ns: int | None) -> None:
        line = self._line_of.get(stop.upper())
        if line is None:
            raise ValueError(f"{self.board.name} has no {stop}")
        self._presses.append((self._last_ns if at_ns is None else at_ns, line, value))
        self._presses.sort()

    def _follow_world(self, t_ns: int) -> None:
        while self._presses and self._presses[0][0] <= t_ns:
            at_ns, line, value = self._presses.pop(0)
            if self._lines.input_changes(at_ns, line, value):
                self._trace.gpio(max(at_ns, self._last_ns), line, value)

    # SPI

    def play(self, t_ns: int, message: Message) -> Generator[int, None, Played]:
        """Play a message; yields the times at which it stands still, as a stall does.

        Meanwhile others may act. The message itself goes on whatever they do.
        Raises: BusError (with `now_ns` as the end where some of it was sent).
        """
        setup = self._open_spi()
        self._check_size(message, setup)
        t_ns = self._start(t_ns)
        self._trace.spi_message(t_ns, len(message.transfers))
        faults = self._faults.spi_message()
        error: BusError | None = None
        reads: list[bytes] = []
        sent = 0
        active = False
        t_ns += pi4.MESSAGE_BEFORE_NS
        last = len(message.transfers) - 1
        for index, transfer in enumerate(message.transfers):
            for fault in faults:
                if isinstance(fault, SpiStall) and fault.at_transfer == index:
                    self._end(t_ns)
                    t_ns += fault.stall_us * 1_000
                    yield t_ns
                    t_ns = self._start(t_ns)
                if isinstance(fault, SpiError) and fault.at_transfer == index:
                    detail = f"transfer {index} failed; the rest was not sent"
                    error = BusError(fault.kind, setup.device, "transfer", detail)
            if error is not None:
                break
            if not active:
                t_ns = self._select(t_ns)
                active = True
            read, t_ns = self._clock(t_ns, transfer, setup)
            sent += len(transfer.tx)
            if transfer.tx:
                reads.append(read)
            t_ns += pi4.delay_ns(transfer.delay_us)
            if transfer.cs_change and index != last:
                t_ns = self._deselect(t_ns) + pi4.CS_CHANGE_NS
                active = False
        if active:
            t_ns = self._deselect(t_ns)
        if any(isinstance(fault, SpiShort) for fault in faults):
            sent -= 1
            error = BusError("short", setup.device, "transfer", f"{sent} bytes were reported")
        self._trace.spi_done(t_ns, sent)
        end_ns = self._end(t_ns + pi4.MESSAGE_AFTER_NS)
        if error is not None:
            raise error
        return tuple(reads), end_ns

    def _open_spi(self) -> SpiSetup:
        if self._spi is None:
            raise BusError("gone", self.board.source.spi, "transfer", "the device is not open")
        return self._spi

    def _check_size(self, message: Message, setup: SpiSetup) -> None:
        if len(message.transfers) >= _WRAPS_AT:
            detail = f"{len(message.transfers)} transfers wrap to a message of none"
            raise BusError("invalid", setup.device, "transfer", detail)
        rounded = sum(-(-len(transfer.tx) // _ROUNDED_TO) for transfer in message.transfers)
        if rounded * _ROUNDED_TO > _BUFFER_BYTES:
            detail = f"{rounded} x {_ROUNDED_TO} bytes do not fit into {_BUFFER_BYTES}"
            raise BusError("too_long", setup.device, "transfer", detail)

    def _select(self, t_ns: int) -> int:
        """Chip select falls: the ADC samples."""
        t_ns += pi4.CS_FALL_NS
        self._switch.settle(t_ns)
        self._trace.spi_cs(t_ns, True)
        self._dac.select()
        self._adc.select(self._path.node_code(t_ns))
        return t_ns

    def _clock(self, t_ns: int, transfer: Transfer, setup: SpiSetup) -> tuple[bytes, int]:
        read = b""
        if transfer.tx:
            t_ns += pi4.CS_TO_CLOCK_NS + pi4.clocking_ns(len(transfer.tx), setup.speed_hz)
            self._dac.shift(transfer.tx)
            read = self._adc.shift(len(transfer.tx))
            for stuck in self._faults.of(MisoStuck):
                read = (b"\xff" if stuck.level else b"\x00") * len(transfer.tx)
        else:
            t_ns += pi4.EMPTY_TRANSFER_NS
        self._trace.spi_transfer(t_ns, transfer.tx, read, transfer.delay_us, transfer.cs_change)
        return read, t_ns

    def _deselect(self, t_ns: int) -> int:
        """Chip select rises: the DAC executes its word."""
        t_ns += pi4.CS_RISE_NS
        self._switch.settle(t_ns)
        self._dac.deselect(t_ns)
        self._adc.deselect()
        self._trace.spi_cs(t_ns, False)
        return t_ns

    # I2C

    def i2c_transfer(
        self, t_ns: int, address: int, write: bytes, read_length: int
    ) -> tuple[bytes | BusError, int]:
        """The bytes read, or what went wrong, and when the transaction ends."""
        t_ns = self._start(t_ns)
        device = f"{self.board.i2c} at 0x{address:02x}"
        fault = self._faults.i2c(address)
        chip = self._i2c.get(address)
        if fault is not None or chip is None:
            kind = "absent" if fault is None else fault.kind
            end_ns = t_ns + (I2C_TIMEOUT_NS if kind == "timeout" else pi4.i2c_ns(0, 0))
            self._end(t_ns)
            return BusError(kind, device, "transfer"), end_ns
        if write:
            chip.write(t_ns, write)
        read = chip.read(t_ns, read_length) if read_length else b""
        self._trace.i2c(t_ns, address, write, read)
        self._end(t_ns)
        return read, t_ns + pi4.i2c_ns(len(write), read_length)

    # Time and rules

    def mark(self, t_ns: int, event: str, seq: int, tag: int | None) -> None:
        self._trace.engine(self._start(t_ns), event, seq, tag)
        self._trace.write()

    def close(self) -> None:
        """The end of the board: the DAC must stand at zero."""
        if self._path.code:
            self._complain(self._last_ns, f"the DAC was left at code {self._path.code}")
        self._trace.close()

    def now_ns(self) -> int:
        """The time of the last thing that happened."""
        return self._last_ns

    def _start(self, t_ns: int) -> int:
        """When a call really starts: never before what has already happened."""
        t_ns = max(t_ns, self._last_ns)
        self._follow_world(t_ns)
        self._last_ns = t_ns
        self._switch.settle(t_ns)
        self._path.settle(t_ns)
        return t_ns

    def _end(self, t_ns: int) -> int:
        self._last_ns = max(self._last_ns, t_ns)
        self._trace.write()
        return t_ns

    def _complain(self, t_ns: int, what: str) -> None:
        if len(self.violations) < _MOST_VIOLATIONS:
            self.violations.append(f"{t_ns} ns: {what}")
