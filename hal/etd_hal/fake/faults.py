"""Faults of a board, as data.

Owns: the kinds of fault. Must not know: when one is due (`faults_due.py`); how a bus or a chip
carries one out. All counts start when the fault is added: 1 is the next event.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from etd_hal.errors import BusErrorKind


class _Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Plain data, so that a fault can also be handed to a board process."""


class SpiError(_Fault, frozen=True, tag=True):
    """A transfer fails: the rest of the message is not sent, chip select goes inactive."""

    at_message: int = 1
    at_transfer: int = 0
    kind: BusErrorKind = "io"


class SpiStall(_Fault, frozen=True, tag=True):
    """The kernel takes the thread off the processor before a transfer; outputs stay as they are."""

    stall_us: int
    at_message: int = 1
    at_transfer: int = 1


class SpiShort(_Fault, frozen=True, tag=True):
    """All bytes are sent, but the kernel reports fewer."""

    at_message: int = 1


class DacGain(_Fault, frozen=True, tag=True):
    """The source's current is this multiple of the commanded one."""

    factor: float


class GainAbove(_Fault, frozen=True, tag=True):
    """Above this code the source's current is this multiple of the commanded one."""

    code: int
    factor: float


class Overshoot(_Fault, frozen=True, tag=True):
    """Until `until_us` of each pulse the current is this multiple of the commanded one."""

    factor: float
    until_us: float


class Saturation(_Fault, frozen=True, tag=True):
    """The source's current is at most this."""

    current_ua: float


class MisoStuck(_Fault, frozen=True, tag=True):
    """The ADC's data line does not move."""

    level: Literal[0, 1]


class I2cFailure(_Fault, frozen=True, tag=True):
    """Transactions with `address` fail, `times` times; None: always."""

    address: int
    kind: Literal["absent", "timeout", "io"]
    times: int | None = None


class StuckLine(_Fault, frozen=True, tag=True):
    """The board reads `level` on this line always; `name` as in the board file."""

    name: str
    level: Literal[0, 1]


class StuckBehind(_Fault, frozen=True, tag=True):
    """Stuck beyond the pin: from the next change on the board reads `level`, while the pin reads
    correctly. Of the lines in `SEEN_BEHIND` (`faults_due.py`).
    """

    name: str
    level: Literal[0, 1]


class LineInverted(_Fault, frozen=True, tag=True):
    """Beyond the pin, from the next change on, the board reads the other level; `name` as above."""

    name: str


class LinesSwapped(_Fault, frozen=True, tag=True):
    """Beyond the pins two wires are swapped: from its next change on, each drives the other's
    input. Names as above.
    """

    first: str
    second: str


class LostClock(_Fault, frozen=True, tag=True):
    """The chain misses one rising edge of CLK; or every so many edges one."""

    at_edge: int = 1
    every: int | None = None


class LostSync(_Fault, frozen=True, tag=True):
    """The DAC misses one rise of its chip select, and keeps the code before; or every so many."""

    at_edge: int = 1
    every: int | None = None


class LatchIgnored(_Fault, frozen=True, tag=True):
    """The chain misses one rising edge of LE; or every so many edges one."""

    at_edge: int = 1
    every: int | None = None


class RailOff(_Fault, frozen=True, tag=True):
    """The rail's voltage is this multiple of the nominal one."""

    factor: float


class DacOffset(_Fault, frozen=True, tag=True):
    """The source's current is higher by this, at every code, also at zero."""

    offset_ua: float


class DacStuck(_Fault, frozen=True, tag=True):
    """The DAC's output stays at `code`."""

    code: int


class AdcScale(_Fault, frozen=True, tag=True):
    """The divider before the ADC is wrong: readings are this multiple."""

    factor: float


class AdcStuck(_Fault, frozen=True, tag=True):
    """The ADC always reads this code."""

    code: int


class AdcBitStuck(_Fault, frozen=True, tag=True):
    """A bit of every conversion is `level`; bit 0 is the lowest."""

    bit: int
    level: Literal[0, 1]


class AdcNoise(_Fault, frozen=True, tag=True):
    """Normal noise of every conversion, `sigma` in codes. Up to 1.5 the board is good."""

    sigma: float
    seed: int = 0


class SpiMode(_Fault, frozen=True, tag=True):
    """The bus always runs in this mode."""

    mode: Literal[0, 1, 2, 3]


class HoldShort(_Fault, frozen=True, tag=True):
    """The DAC's clock is late by cable and level shifter: data that changes on the sampled edge is
    read with its new value.
    """


class SlowWords(_Fault, frozen=True, tag=True):
    """Each word takes longer."""

    extra_us: int


class SpiJitter(_Fault, frozen=True, tag=True):
    """Every so many messages the first word is late."""

    every: int
    late_us: int


class MonitorStuck(_Fault, frozen=True, tag=True):
    """The rail monitor always reads `rail_v`."""

    rail_v: float


class SetpointAtPowerUp(_Fault, frozen=True, tag=True):
    """The set-point's EEPROM holds this code; add it when the board is made."""

    code: int


class EnableStuck(_Fault, frozen=True, tag=True):
    """The supply is always on, whatever its enable line."""


class RailStays(_Fault, frozen=True, tag=True):
    """A supply that was switched off keeps its voltage: the bleeder is open."""


class HeartbeatIgnored(_Fault, frozen=True, tag=True):
    """The gate does not cut the supply without beats."""


class HeartbeatRearms(_Fault, frozen=True, tag=True):
    """The gate has no latch: the next beat restores the supply."""


class PullMissing(_Fault, frozen=True, tag=True):
    """The undriven line takes the wrong level; `name` as in the board file."""

    name: str


class HeartbeatByLevel(_Fault, frozen=True, tag=True):
    """The gate keeps the supply on while the line is at this level."""

    level: Literal[0, 1]


class HeartbeatSlow(_Fault, frozen=True, tag=True):
    """The monostable takes longer than the board file says."""

    extra_ms: int


class StopCutsNothing(_Fault, frozen=True, tag=True):
    """The second contact of this stop is bridged: it does not cut the supply."""

    stop: Literal["emergency_stop", "wearer_stop"]


class StopCutsLate(_Fault, frozen=True, tag=True):
    """Its second contact cuts the supply late."""

    stop: Literal["emergency_stop", "wearer_stop"]
    late_ms: int


class LineCut(_Fault, frozen=True, tag=True):
    """The wire beyond the pin is cut: the pin moves, the board does not; `name` as above."""

    name: str


class SwitchOutput(_Fault, frozen=True, tag=True):
    """An output of the chain is stuck: open, on the source, or on ground."""

    output: int
    side: Literal["open", "source", "ground"]


class AlsoSwitches(_Fault, frozen=True, tag=True):
    """Selecting `output` of the chain also selects `also`, in one polarity or (None) both; on a
    relay board, for the relay to the source (`cathodic`: to ground).
    """

    output: int
    also: int
    polarity: Literal["anodic", "cathodic"] | None = None


class OutputsSwapped(_Fault, frozen=True, tag=True):
    """The wires behind two outputs of the chain are swapped."""

    first: int
    second: int


class OutputSeries(_Fault, frozen=True, tag=True):
    """A series resistance in a switch, from the next contact on its electrode on."""

    output: int
    resistance_ohm: float


class Bridge(_Fault, frozen=True, tag=True):
    """A solder bridge between two electrodes: on opposite sides they short the source."""

    first: int
    second: int


class MachineTrouble(_Fault, frozen=True, tag=True):
    """A problem of the machine that drives the board."""

    kind: Literal[
        "clock_back",
        "clock_coarse",
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


Fault = (
    SpiError
    | SpiStall
    | SpiShort
    | DacGain
    | GainAbove
    | Overshoot
    | Saturation
    | MisoStuck
    | I2cFailure
    | StuckLine
    | StuckBehind
    | LineInverted
    | LinesSwapped
    | LostClock
    | LostSync
    | LatchIgnored
    | RailOff
    | DacOffset
    | DacStuck
    | AdcScale
    | AdcStuck
    | AdcBitStuck
    | AdcNoise
    | SpiMode
    | HoldShort
    | SlowWords
    | SpiJitter
    | MonitorStuck
    | SetpointAtPowerUp
    | EnableStuck
    | RailStays
    | HeartbeatIgnored
    | HeartbeatRearms
    | HeartbeatByLevel
    | HeartbeatSlow
    | PullMissing
    | StopCutsNothing
    | StopCutsLate
    | LineCut
    | SwitchOutput
    | AlsoSwitches
    | OutputsSwapped
    | OutputSeries
    | Bridge
    | MachineTrouble
)
