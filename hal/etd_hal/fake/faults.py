"""What can be wrong with a board, as data.

Owns: the kinds of fault. Must not know: when one is due (`faults_due.py`); how a bus or a chip
carries one out. All counts begin when the fault is put in: 1 is the next one.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from etd_hal.errors import BusErrorKind


class _Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Plain data, so that a fault can also be handed to a board process."""


class SpiError(_Fault, frozen=True, tag=True):
    """A transfer fails: what comes after it is not sent, chip select goes inactive."""

    at_message: int = 1
    at_transfer: int = 0
    kind: BusErrorKind = "io"


class SpiStall(_Fault, frozen=True, tag=True):
    """The kernel takes the thread off the processor before a transfer; outputs stay as they are."""

    stall_us: int
    at_message: int = 1
    at_transfer: int = 1


class SpiShort(_Fault, frozen=True, tag=True):
    """All is sent, but the kernel reports fewer bytes than that."""

    at_message: int = 1


class DacGain(_Fault, frozen=True, tag=True):
    """The current source makes this multiple of what it is told."""

    factor: float


class GainAbove(_Fault, frozen=True, tag=True):
    """Above this code the source makes this multiple of what it is told."""

    code: int
    factor: float


class Overshoot(_Fault, frozen=True, tag=True):
    """For the first so many us of each pulse the source makes this multiple of what it is told."""

    factor: float
    until_us: float


class Saturation(_Fault, frozen=True, tag=True):
    """The source makes no more than this, whatever it is told."""

    current_ua: float


class MisoStuck(_Fault, frozen=True, tag=True):
    """The ADC's data line does not move."""

    level: Literal[0, 1]


class I2cFailure(_Fault, frozen=True, tag=True):
    """Transactions with `address` fail, `times` times; None is for ever."""

    address: int
    kind: Literal["absent", "timeout", "io"]
    times: int | None = None


class StuckLine(_Fault, frozen=True, tag=True):
    """The board sees `level` on this line whatever is driven; `name` as in the board file."""

    name: str
    level: Literal[0, 1]


class StuckBehind(_Fault, frozen=True, tag=True):
    """Beyond the pin, from its next change on, the board sees `level`; the pin reads right. Of the
    lines in `SEEN_BEHIND` (`faults_due.py`).
    """

    name: str
    level: Literal[0, 1]


class LostClock(_Fault, frozen=True, tag=True):
    """The chain does not see one rising edge of CLK; or one of so many, again and again."""

    at_edge: int = 1
    every: int | None = None


class LostSync(_Fault, frozen=True, tag=True):
    """The DAC does not see one rise of its chip select: it keeps the code of the word before; or
    one of so many, again and again.
    """

    at_edge: int = 1
    every: int | None = None


class LatchIgnored(_Fault, frozen=True, tag=True):
    """The chain does not see one rising edge of LE; or one of so many, again and again."""

    at_edge: int = 1
    every: int | None = None


class RailOff(_Fault, frozen=True, tag=True):
    """The rail is this multiple of what it should be: over or under voltage."""

    factor: float


class DacOffset(_Fault, frozen=True, tag=True):
    """The source makes so much more than it is told, at every code, zero included."""

    offset_ua: float


class DacStuck(_Fault, frozen=True, tag=True):
    """The DAC's output stands at `code`, whatever is sent."""

    code: int


class AdcScale(_Fault, frozen=True, tag=True):
    """The divider in front of the ADC is another one: readings are this multiple."""

    factor: float


class AdcStuck(_Fault, frozen=True, tag=True):
    """The ADC gives this code, whatever the node is at."""

    code: int


class AdcBitStuck(_Fault, frozen=True, tag=True):
    """One bit of every conversion stands at `level`; bit 0 is the lowest."""

    bit: int
    level: Literal[0, 1]


class AdcNoise(_Fault, frozen=True, tag=True):
    """Every conversion is off by chance: normal, with a standard deviation of so many codes. Up to
    1.5 the board is in order.
    """

    sigma: float
    seed: int = 0


class SpiMode(_Fault, frozen=True, tag=True):
    """The bus runs in this mode, whatever was set."""

    mode: Literal[0, 1, 2, 3]


class HoldShort(_Fault, frozen=True, tag=True):
    """Where data changes on the very edge that the DAC samples, it takes what comes, not what was:
    cable and level shifter make its clock late.
    """


class SlowWords(_Fault, frozen=True, tag=True):
    """Each word takes so much longer."""

    extra_us: int


class SpiJitter(_Fault, frozen=True, tag=True):
    """Every so many messages the kernel comes late, before the first word."""

    every: int
    late_us: int


class MonitorStuck(_Fault, frozen=True, tag=True):
    """The rail monitor's input stands at what `rail_v` would make."""

    rail_v: float


class SetpointAtPowerUp(_Fault, frozen=True, tag=True):
    """The set-point's EEPROM holds this code, given when the board is made."""

    code: int


class EnableStuck(_Fault, frozen=True, tag=True):
    """The supply is on whatever its enable line says."""


class RailStays(_Fault, frozen=True, tag=True):
    """A supply that was switched off keeps its voltage: the bleeder is open."""


class HeartbeatIgnored(_Fault, frozen=True, tag=True):
    """The gate lets the supply through without any beat."""


class HeartbeatRearms(_Fault, frozen=True, tag=True):
    """The gate has no latch: the supply comes back by itself with the next beat."""


class PullMissing(_Fault, frozen=True, tag=True):
    """This line goes the wrong way when nobody drives it; `name` as in the board file."""

    name: str


class HeartbeatByLevel(_Fault, frozen=True, tag=True):
    """The gate counts this level of the line as life, for as long as it lasts."""

    level: Literal[0, 1]


class HeartbeatSlow(_Fault, frozen=True, tag=True):
    """The monostable takes so much longer than the board file says."""

    extra_ms: int


class StopCutsNothing(_Fault, frozen=True, tag=True):
    """The second contact of this stop is bridged: only the program sees that it is open."""

    stop: Literal["emergency_stop", "wearer_stop"]


class StopCutsLate(_Fault, frozen=True, tag=True):
    """Its second contact, or what that switches, takes so long to break the supply."""

    stop: Literal["emergency_stop", "wearer_stop"]
    late_ms: int


class LineCut(_Fault, frozen=True, tag=True):
    """The wire beyond the pin is cut: the pin moves, the board sees nothing; `name` as above."""

    name: str


class SwitchOutput(_Fault, frozen=True, tag=True):
    """An output of the chain stays where it is: connected to nothing, the source or ground."""

    output: int
    side: Literal["open", "source", "ground"]


class AlsoSwitches(_Fault, frozen=True, tag=True):
    """Whatever selects `output` of the chain selects `also` with it, in one polarity or (None) in
    either; of a relay board, what closes its relay to the source (`cathodic`: to ground) closes the
    other's.
    """

    output: int
    also: int
    polarity: Literal["anodic", "cathodic"] | None = None


class OutputsSwapped(_Fault, frozen=True, tag=True):
    """The wires behind two outputs of the chain are swapped."""

    first: int
    second: int


class OutputSeries(_Fault, frozen=True, tag=True):
    """A switch that is half dead: so much in the way to whatever is put on its electrode next."""

    output: int
    resistance_ohm: float


class Bridge(_Fault, frozen=True, tag=True):
    """A drop of solder between two electrodes: on opposite sides they short the source."""

    first: int
    second: int


class MachineTrouble(_Fault, frozen=True, tag=True):
    """Something is wrong with the machine that the board hangs on."""

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
