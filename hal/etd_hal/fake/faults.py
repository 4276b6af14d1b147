"""Faults of a board, as data.

Owns: the kinds of fault. Must not know: when one is due (`faults_due.py`); how a bus or a chip
carries one out. All counts start when the fault is added: 1 is the next event.
"""

from __future__ import annotations

import functools
import operator
from typing import Any, Literal

import msgspec

from etd_hal.errors import BusErrorKind


class Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Plain data, so that a fault can also be handed to a board process."""


class SpiError(Fault, frozen=True, tag=True):
    """A transfer fails: the rest of the message is not sent, chip select goes inactive."""

    at_message: int = 1
    at_transfer: int = 0
    kind: BusErrorKind = "io"


class SpiStall(Fault, frozen=True, tag=True):
    """The kernel takes the thread off the processor before a transfer; outputs stay as they are."""

    stall_us: int
    at_message: int = 1
    at_transfer: int = 1


class SpiShort(Fault, frozen=True, tag=True):
    """All bytes are sent, but the kernel reports fewer."""

    at_message: int = 1


class DacGain(Fault, frozen=True, tag=True):
    """The source's current is this multiple of the commanded one."""

    factor: float


class GainAbove(Fault, frozen=True, tag=True):
    """Above this code the source's current is this multiple of the commanded one."""

    code: int
    factor: float


class Overshoot(Fault, frozen=True, tag=True):
    """Until `until_us` of each pulse the current is this multiple of the commanded one."""

    factor: float
    until_us: float


class Saturation(Fault, frozen=True, tag=True):
    """The source's current is at most this."""

    current_ua: float


class MisoStuck(Fault, frozen=True, tag=True):
    """The ADC's data line does not move."""

    level: Literal[0, 1]


class I2cFailure(Fault, frozen=True, tag=True):
    """Transactions with `address` fail, `times` times; None: always."""

    address: int
    kind: Literal["absent", "timeout", "io"]
    times: int | None = None


class StuckLine(Fault, frozen=True, tag=True):
    """The board reads `level` on this line always; `name` as in the board file."""

    name: str
    level: Literal[0, 1]


class StuckBehind(Fault, frozen=True, tag=True):
    """Stuck beyond the pin: from the next change on the board reads `level`, while the pin reads
    correctly. Of the lines in `SEEN_BEHIND` (`faults_due.py`).
    """

    name: str
    level: Literal[0, 1]


class LineInverted(Fault, frozen=True, tag=True):
    """Beyond the pin, from the next change on, the board reads the other level; `name` as above."""

    name: str


class LinesSwapped(Fault, frozen=True, tag=True):
    """Beyond the pins two wires are swapped: from its next change on, each drives the other's
    input. Names as above.
    """

    first: str
    second: str


class LostClock(Fault, frozen=True, tag=True):
    """The chain misses one rising edge of CLK; or every so many edges one."""

    at_edge: int = 1
    every: int | None = None


class LostSync(Fault, frozen=True, tag=True):
    """The DAC misses one rise of its chip select, and keeps the code before; or every so many."""

    at_edge: int = 1
    every: int | None = None


class LatchIgnored(Fault, frozen=True, tag=True):
    """The chain misses one rising edge of LE; or every so many edges one."""

    at_edge: int = 1
    every: int | None = None


class ExtraClock(Fault, frozen=True, tag=True):
    """The chain sees one rising edge of CLK twice, as of a line that rings; or every so many."""

    at_edge: int = 1
    every: int | None = None


class DataFlipped(Fault, frozen=True, tag=True):
    """The chain takes the other level of DATA at one rising edge of CLK; or at every so many."""

    at_edge: int = 1
    every: int | None = None


class MosiFlipped(Fault, frozen=True, tag=True):
    """The DAC takes one word with this bit the other way; or every so many. Bit 0 is the lowest,
    2 to 13 are the code, 14 and 15 the command.
    """

    bit: int
    at_word: int = 1
    every: int | None = None


class MosiStuck(Fault, frozen=True, tag=True):
    """The DAC's data line does not move."""

    level: Literal[0, 1]


class MisoFlipped(Fault, frozen=True, tag=True):
    """One word is read with this bit the other way; or every so many. Bits 2 to 13 are the code."""

    bit: int
    at_word: int = 1
    every: int | None = None


class RailOff(Fault, frozen=True, tag=True):
    """The rail's voltage is this multiple of the nominal one."""

    factor: float


class DacOffset(Fault, frozen=True, tag=True):
    """The source's current is higher by this, at every code, also at zero."""

    offset_ua: float


class SourceShort(Fault, frozen=True, tag=True):
    """The source is short: its node is on the rail, whatever the DAC and its one-shot say. What is
    connected takes what it lets through, and a supply that was switched off is emptied by it.
    """


class DacStuck(Fault, frozen=True, tag=True):
    """The DAC's output stays at `code`."""

    code: int


class AdcScale(Fault, frozen=True, tag=True):
    """The divider before the ADC is wrong: readings are this multiple."""

    factor: float


class AdcStuck(Fault, frozen=True, tag=True):
    """The ADC always reads this code."""

    code: int


class AdcBitStuck(Fault, frozen=True, tag=True):
    """A bit of every conversion is `level`; bit 0 is the lowest."""

    bit: int
    level: Literal[0, 1]


class AdcNoise(Fault, frozen=True, tag=True):
    """Normal noise of every conversion, `sigma` in codes. Up to 1.5 the board is good."""

    sigma: float
    seed: int = 0


class SpiMode(Fault, frozen=True, tag=True):
    """The bus always runs in this mode."""

    mode: Literal[0, 1, 2, 3]


class HoldShort(Fault, frozen=True, tag=True):
    """The DAC's clock is late by cable and level shifter: data that changes on the sampled edge is
    read with its new value.
    """


class SlowWords(Fault, frozen=True, tag=True):
    """Each word takes longer."""

    extra_us: int


class SpiJitter(Fault, frozen=True, tag=True):
    """Every so many messages the first word is late."""

    every: int
    late_us: int


class ClockSteps(Fault, frozen=True, tag=True):
    """The machine's clock follows its load: every `every_ms` it changes between full speed and
    `factor` times slower, and with it what the kernel and the wire take of a message. Waits do not
    change.
    """

    factor: float
    every_ms: int


class MonitorStuck(Fault, frozen=True, tag=True):
    """The rail monitor always reads `rail_v`."""

    rail_v: float


class SetpointAtPowerUp(Fault, frozen=True, tag=True):
    """The set-point's EEPROM holds this code, and puts it out until the first one is written."""

    code: int


class EnableStuck(Fault, frozen=True, tag=True):
    """The supply is always on, whatever its enable line."""


class RailStays(Fault, frozen=True, tag=True):
    """A supply that was switched off keeps its voltage: the bleeder is open."""


class HeartbeatIgnored(Fault, frozen=True, tag=True):
    """The gate does not cut the supply without beats."""


class HeartbeatRearms(Fault, frozen=True, tag=True):
    """The gate has no latch: the next beat restores the supply."""


class PullMissing(Fault, frozen=True, tag=True):
    """The undriven line takes the wrong level; `name` as in the board file."""

    name: str


class HeartbeatByLevel(Fault, frozen=True, tag=True):
    """The gate keeps the supply on while the line is at this level."""

    level: Literal[0, 1]


class HeartbeatSlow(Fault, frozen=True, tag=True):
    """The monostable takes longer than the board file says."""

    extra_ms: int


class StopCutsNothing(Fault, frozen=True, tag=True):
    """The second contact of this stop is bridged: it does not cut the supply."""

    stop: Literal["emergency_stop", "wearer_stop"]


class StopCutsLate(Fault, frozen=True, tag=True):
    """Its second contact cuts the supply late."""

    stop: Literal["emergency_stop", "wearer_stop"]
    late_ms: int


class LineCut(Fault, frozen=True, tag=True):
    """The wire beyond the pin is cut: the pin moves, the board does not; `name` as above."""

    name: str


class SwitchOutput(Fault, frozen=True, tag=True):
    """An output of the chain is stuck: open, on the source, or on ground."""

    output: int
    side: Literal["open", "source", "ground"]


class AlsoSwitches(Fault, frozen=True, tag=True):
    """Selecting `output` of the chain also selects `also`, in one polarity or (None) both; on a
    relay board, for the relay to the source (`cathodic`: to ground).
    """

    output: int
    also: int
    polarity: Literal["anodic", "cathodic"] | None = None


class OutputsSwapped(Fault, frozen=True, tag=True):
    """The wires behind two outputs of the chain are swapped."""

    first: int
    second: int


class OutputSeries(Fault, frozen=True, tag=True):
    """A series resistance in a switch, from the next contact on its electrode on."""

    output: int
    resistance_ohm: float


class Bridge(Fault, frozen=True, tag=True):
    """A solder bridge between two electrodes: on opposite sides they short the source."""

    first: int
    second: int


#: What `host.py` can show of a machine.
Trouble = Literal[
    "clock_back",
    "clock_coarse",
    "clock_follows_load",
    "date_wrong",
    "hot",
    "little_memory",
    "not_locked",
    "not_scheduled",
    "package_missing",
    "partly_locked",
    "pins_kept",
    "realtime_refused",
    "throttled",
    "under_voltage",
    "was_throttled",
    "was_under_voltage",
    "wrong_model",
]


class MachineTrouble(Fault, frozen=True, tag=True):
    """A problem of the machine that drives the board."""

    kind: Trouble


def fault_of(data: Any) -> Fault:
    """A fault that has crossed a socket. Raises: msgspec.ValidationError."""
    fault: Fault = msgspec.convert(data, functools.reduce(operator.or_, Fault.__subclasses__()))
    return fault
