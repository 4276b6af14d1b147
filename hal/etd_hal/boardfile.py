"""What a board file and a machine file say, checked.

Owns: the schema of `config/boards/*.toml` and `config/machines/*.toml`, the rules between their
keys, and the sentences that say what would happen if a rule were broken.
Must not know: how a chip is driven, the person who wears the board.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from etd_hal import ceilings
from etd_hal.errors import FileError
from etd_hal.names import PlainName, whole
from etd_hal.tomlfile import Strict, load_toml

Absent = Literal["absent"]
#: Of spidev and i2c-dev: nothing else is opened as one.
SpiDevice = Annotated[str, Meta(pattern=whole(r"/dev/spidev[0-9]{1,3}\.[0-9]{1,3}"))]
I2cDevice = Annotated[str, Meta(pattern=whole(r"(?:/dev/i2c-[0-9]{1,3}|absent)"))]
#: A line of the 40-pin header.
Line = Annotated[int, Meta(ge=2, le=27)]
I2cAddress = Annotated[int, Meta(ge=0x08, le=0x77)]
#: Both ends are bounded: infinity would disable any comparison with it.
Positive = Annotated[float, Meta(gt=0, le=100_000)]

#: The rail's monitor runs on 3.3 V and measures nothing above; a little less, so that saturation
#: shows.
MONITOR_SEES_V = 0.98 * 3.3

#: Header lines that a bus device uses, chip selects included.
_BUS_LINES = {"spidev0": (7, 8, 9, 10, 11), "spidev1": (18, 19, 20, 21), "i2c-1": (2, 3)}
#: Outputs of one chip: a chain has whole chips.
_OUTPUTS_A_CHIP = {"HV507": 64, "HV513": 8, "74HC595": 4}
#: Codes of a DAC or an ADC.
_CODES = {"AD5452": 4096, "AD7276": 4096}


class _Switch(Strict, frozen=True, tag_field="chip"):
    outputs: Annotated[int, Meta(ge=1, le=256)]

    @property
    def chip(self) -> str:
        """The part's name, as in the file."""
        return str(self.__struct_config__.tag)

    @property
    def safe_levels(self) -> tuple[tuple[str, int], ...]:
        """The levels, by line and in order, that alone ground every output; none with relays."""
        return ()


class HalfBridgeLines(Strict, frozen=True):
    POL: Line
    DATA: Line
    LE: Line
    BL: Line
    CLK: Line


class HalfBridges(_Switch, frozen=True):
    """A shift register, a latch, and two lines (BL, POL) for all outputs."""

    lines: HalfBridgeLines

    @property
    def safe_levels(self) -> tuple[tuple[str, int], ...]:
        return (("POL", 1), ("BL", 0))


class Hv507(HalfBridges, frozen=True, tag="HV507"):
    """64 half-bridges in one chip."""


class Hv513(HalfBridges, frozen=True, tag="HV513"):
    """8 half-bridges a chip, chained."""


class RelayLines(Strict, frozen=True):
    """74HC595, named by function: CLK is SRCLK (shift), LE is RCLK (copy on its rising edge)."""

    DATA: Line
    LE: Line
    CLK: Line


class Relays(_Switch, frozen=True, tag="74HC595"):
    """74HC595 with two photorelays an electrode: one to the source, one to ground."""

    lines: RelayLines
    on_bit: Literal[0, 1]
    return_bit: Literal[0, 1]
    ton_us: Annotated[int, Meta(ge=1, le=10_000)]
    toff_us: Annotated[int, Meta(ge=1, le=10_000)]
    bits_per_electrode: Literal[2] = 2


class Source(Strict, frozen=True):
    """The current path: DAC and ADC on one chip select, current mirror, leak, divider."""

    dac: Literal["AD5452"]
    adc: Literal["AD7276"]
    spi: SpiDevice
    #: The DAC takes a bit on the clock's falling edge. In mode 0 the bit changes on that very edge,
    #: and in mode 3 it takes the one before.
    mode: Literal[1, 2]
    speed_hz: Annotated[int, Meta(ge=4_000_000, le=48_000_000)]
    #: The current of the largest code; pessimistic (largest) where the board has not been measured.
    full_scale_ua: Annotated[int, Meta(ge=1_000, le=50_000)]
    #: From the source's node to ground; it takes its share of every pulse.
    leak_ohm: Annotated[int, Meta(ge=10_000)]
    #: Node voltage for one code of the ADC, divider included.
    node_uv_per_code: Annotated[int, Meta(ge=1_000, le=500_000)]
    #: The source cannot lift its node above this.
    compliance_v: Annotated[int, Meta(ge=20, le=500)]

    @property
    def codes(self) -> int:
        """How many the DAC has."""
        return _CODES[self.dac]

    @property
    def adc_codes(self) -> int:
        return _CODES[self.adc]

    def code_for(self, current_ua: int) -> int:
        """The largest code whose current is not above `current_ua`."""
        return current_ua * (self.codes - 1) // self.full_scale_ua

    def current_of(self, code: int) -> float:
        """What the source is told by `code`, in uA."""
        return code * self.full_scale_ua / (self.codes - 1)


class BoardMaxima(Strict, frozen=True):
    """What this board may do to any person. All are required: a missing limit is a refusal."""

    current_ua: Annotated[int, Meta(ge=50, le=ceilings.CURRENT_UA)]
    width_us: Annotated[int, Meta(ge=20, le=ceilings.WIDTH_US)]
    charge_nc: Annotated[int, Meta(ge=1, le=ceilings.CHARGE_NC)]
    rate_hz: Annotated[int, Meta(ge=1, le=ceilings.RATE_HZ)]
    mean_current_ua: Annotated[int, Meta(ge=1, le=ceilings.MEAN_CURRENT_UA)]
    array_mean_current_ua: Annotated[int, Meta(ge=1, le=ceilings.ARRAY_MEAN_CURRENT_UA)]
    #: The highest current outside ARMED: imperceptible, for contact and self-test.
    probe_current_ua: Annotated[int, Meta(ge=10, le=ceilings.PROBE_CURRENT_UA)]
    probe_width_us: Annotated[int, Meta(ge=16, le=ceilings.PROBE_WIDTH_US)]


class HvEnable(Strict, frozen=True):
    line: Line
    #: The level that switches the supply on; its pull must make the other one at power-up.
    on: Literal[0, 1]


class RailMonitor(Strict, frozen=True):
    """An ADS1115 channel behind a divider."""

    address: I2cAddress
    channel: Annotated[int, Meta(ge=0, le=3)]
    #: Rail volts for one volt at the channel.
    divider: Positive
    low_v: Positive
    high_v: Positive
    #: Below this the rail counts as off.
    off_v: Positive
    rise_ms: Annotated[int, Meta(ge=1, le=10_000)]
    fall_ms: Annotated[int, Meta(ge=1, le=30_000)]


class Heartbeat(Strict, frozen=True):
    """Each edge retriggers a monostable that enables the supply."""

    line: Line
    window_ms: Annotated[int, Meta(ge=2, le=100)]


class OneShot(Strict, frozen=True):
    """Hardware that ends a pulse by itself."""

    on_us: Annotated[int, Meta(ge=200, le=1_000)]


class EdgeInput(Strict, frozen=True):
    """An input of which one edge counts. It is pulled to the level before that edge, so that a plug
    that comes off makes none.
    """

    line: Line
    edge: Literal["rising", "falling"]


class RailSetpoint(Strict, frozen=True):
    """An MCP4725 that sets the rail: 0 V at its output is the lowest rail."""

    address: I2cAddress
    code: Annotated[int, Meta(ge=0, le=4095)]


class Guards(Strict, frozen=True):
    """Each guard is present (with its wiring) or absent; nothing is assumed."""

    emergency_stop: Line | Absent
    wearer_stop: Line | Absent
    hv_enable: HvEnable | Absent
    rail_monitor: RailMonitor | Absent
    readback: Line | Absent
    heartbeat: Heartbeat | Absent
    one_shot: OneShot | Absent
    #: A second contact of each stop breaks the supply, without any program. The self-test requires
    #: it unless the file says that there is none.
    stop_cuts_supply: bool = True


#: In every report and in `accept_absent_guards`, in this order.
GUARDS = tuple(key for key in Guards.__struct_fields__ if key != "stop_cuts_supply")


class BoardFile(Strict, frozen=True):
    """One board: wiring, constants, maxima, rest, guards."""

    name: PlainName
    title: str
    source_of_facts: str
    switch: Hv507 | Hv513 | Relays
    source: Source
    maxima: BoardMaxima
    guards: Guards
    #: All electrodes together on ground for at least this long after each pulse.
    rest_us: Annotated[int, Meta(ge=20, le=10_000)]
    i2c: I2cDevice = "absent"
    gpio_chip_labels: tuple[str, ...] = ("pinctrl-bcm2711", "pinctrl-bcm2835")
    sync_line: Line | Absent = "absent"
    #: Its edge begins a frame that waits for it.
    trigger: EdgeInput | Absent = "absent"
    #: A button of the wearer's: each press says that all is too strong.
    too_strong: EdgeInput | Absent = "absent"
    rail_setpoint: RailSetpoint | Absent = "absent"

    @property
    def absent_guards(self) -> tuple[str, ...]:
        """The guards this board does not have, by name."""
        return tuple(name for name in GUARDS if getattr(self.guards, name) == "absent")

    @property
    def present_guards(self) -> tuple[str, ...]:
        return tuple(name for name in GUARDS if getattr(self.guards, name) != "absent")

    def used_lines(self) -> dict[str, int]:
        """Every GPIO line by function, in the order of the file."""
        lines: dict[str, int] = msgspec.structs.asdict(self.switch.lines)
        guards = self.guards
        if guards.hv_enable != "absent":
            lines["HV"] = guards.hv_enable.line
        if guards.heartbeat != "absent":
            lines["HEARTBEAT"] = guards.heartbeat.line
        for name in ("readback", "emergency_stop", "wearer_stop"):
            line = getattr(guards, name)
            if line != "absent":
                lines[name.upper()] = line
        if self.sync_line != "absent":
            lines["SYNC"] = self.sync_line
        if self.trigger != "absent":
            lines["TRIGGER"] = self.trigger.line
        if self.too_strong != "absent":
            lines["TOO_STRONG"] = self.too_strong.line
        return lines


class Bounds(Strict, frozen=True):
    """A plausible range, both ends included."""

    low: Annotated[float, Meta(ge=0, le=100_000)]
    high: Annotated[float, Meta(ge=0, le=100_000)]


class MachineFile(Strict, frozen=True):
    """How one model of machine plays a message: bounds for what calibration finds, in us."""

    name: PlainName
    title: str
    #: Parts of the device tree's model string; empty for a machine without one.
    models: tuple[Annotated[str, Meta(min_length=1)], ...]
    #: One 2-byte word with its chip-select gap.
    word_us: Bounds
    #: What a pure delay costs on top of its delay.
    delay_extra_us: Bounds
    #: What a message costs before its first word and after its last.
    message_us: Bounds
    #: Largest spread of repeated messages (90th percentile less median) at calibration.
    spread_us: Annotated[float, Meta(gt=0, le=ceilings.SPREAD_US)]
    #: A single message this much over its plan halts the daemon.
    halt_excess_us: Annotated[float, Meta(gt=0, le=ceilings.HALT_EXCESS_US)]
    #: A mean deviation beyond this asks for a new calibration.
    drift_us: Annotated[float, Meta(gt=0, le=ceilings.DRIFT_US)]
    #: A GPIO set call, and the processor time of a pulse: for planning. The guard derives from the
    #: first how long a flip of the switch may take.
    gpio_call_us: Positive
    visit_us: Annotated[float, Meta(gt=0, le=100_000)]
    #: The guard's own worst case for the two constants above: never the calibrated ones.
    guard_word_us: Positive
    guard_delay_extra_us: Positive


def load_board(path: Path) -> BoardFile:
    """Read and check a board file. Raises: FileError."""
    board = load_toml(path, BoardFile)
    _check_chain(board, str(path))
    _check_lines(board, str(path))
    _check_current_path(board, str(path))
    _check_guards(board, str(path))
    return board


def load_machine(path: Path) -> MachineFile:
    """Read and check a machine file. Raises: FileError."""
    machine = load_toml(path, MachineFile)
    for key in ("word_us", "delay_extra_us", "message_us"):
        bounds: Bounds = getattr(machine, key)
        if bounds.low > bounds.high:
            raise FileError(
                str(path), key, f"low {bounds.low} is above high {bounds.high}", "swap them"
            )
    for key, bounds in (("word_us", machine.word_us), ("delay_extra_us", machine.delay_extra_us)):
        worst_us: float = getattr(machine, f"guard_{key}")
        if worst_us < bounds.high:
            raise FileError(
                str(path),
                f"guard_{key}",
                f"{worst_us} is below the high end of {key} ({bounds.high})",
                "the guard uses the worst case: give at least that",
            )
    return machine


def _check_chain(board: BoardFile, file: str) -> None:
    outputs, a_chip = board.switch.outputs, _OUTPUTS_A_CHIP[board.switch.chip]
    if outputs % a_chip:
        raise FileError(
            file,
            "switch.outputs",
            f"{outputs} is not a whole number of chips with {a_chip} each",
            "give all outputs of the chain, wired or not: old bits would stay in the rest of it",
        )


def _bus_lines(board: BoardFile) -> dict[int, str]:
    """The lines that SPI and I2C have taken, by the names of their devices."""
    devices = (board.source.spi, board.i2c)
    return {
        line: device
        for device in devices
        for bus, lines in _BUS_LINES.items()
        if Path(device).stem == bus
        for line in lines
    }


def _check_lines(board: BoardFile, file: str) -> None:
    taken = _bus_lines(board)
    for function, line in board.used_lines().items():
        if line in taken:
            raise FileError(
                file,
                f"line {line}",
                f"it is used for {taken[line]} and for {function}",
                "give each function a line of its own: two on one would drive each other",
            )
        taken[line] = function
    lines = board.switch.lines
    if lines.DATA > lines.CLK:
        raise FileError(
            file,
            "switch.lines.DATA",
            f"line {lines.DATA} is above CLK (line {lines.CLK})",
            "lines of one call change in ascending order, so the clock would rise before its"
            " data: put DATA below CLK",
        )
    if isinstance(lines, HalfBridgeLines):
        for name in ("LE", "POL"):
            line = getattr(lines, name)
            if line > lines.BL:
                raise FileError(
                    file,
                    f"switch.lines.{name}",
                    f"line {line} is above BL (line {lines.BL})",
                    "lines of one call change in ascending order, so the outputs would be"
                    f" un-blanked before {name} is settled: put {name} below BL",
                )


def _check_current_path(board: BoardFile, file: str) -> None:
    if board.maxima.current_ua > board.source.full_scale_ua:
        raise FileError(
            file,
            "maxima.current_ua",
            f"{board.maxima.current_ua} uA is more than the source makes"
            f" ({board.source.full_scale_ua} uA)",
            "give at most the full scale",
        )
    for key, unit, advice in (
        ("current_ua", "uA", "a probe is weaker than a stimulus"),
        ("width_us", "us", "a probe is no wider than a stimulus"),
    ):
        probe = getattr(board.maxima, f"probe_{key}")
        if probe > getattr(board.maxima, key):
            raise FileError(file, f"maxima.probe_{key}", f"{probe} {unit} is above {key}", advice)
    if isinstance(board.switch, Relays) and board.switch.on_bit == board.switch.return_bit:
        raise FileError(
            file,
            "switch.return_bit",
            "it is the same bit as on_bit",
            "one relay goes to the source (on_bit), the other to ground (return_bit)",
        )


def _check_guards(board: BoardFile, file: str) -> None:
    guards = board.guards
    if board.rail_setpoint != "absent" and guards.rail_monitor == "absent":
        hint = "declare the monitor: that a set-point was not written would go unseen"
        raise FileError(file, "rail_setpoint", "there is no guards.rail_monitor", hint)
    if guards.rail_monitor != "absent" and board.i2c == "absent":
        raise FileError(
            file, "i2c", "it is absent", "the rail's chips are on I2C: name the bus device"
        )
    if guards.rail_monitor != "absent":
        rail = guards.rail_monitor
        if not rail.off_v < rail.low_v < rail.high_v:
            raise FileError(
                file, "guards.rail_monitor", "off_v, low_v, high_v do not rise", "order them"
            )
        if rail.high_v > MONITOR_SEES_V * rail.divider:
            raise FileError(
                file,
                "guards.rail_monitor.high_v",
                f"{rail.high_v} V are {rail.high_v / rail.divider:.2f} V at the monitor's input,"
                f" which tells voltages up to {MONITOR_SEES_V:.2f} V",
                "a larger divider, or a lower high_v: beyond its scale a rail that is too high"
                " would look right",
            )
    if guards.heartbeat != "absent" and guards.hv_enable == "absent":
        raise FileError(
            file,
            "guards.heartbeat",
            "there is no hv_enable",
            "a heartbeat gates the supply: declare the line that enables it",
        )
