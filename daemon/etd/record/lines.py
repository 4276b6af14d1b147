"""The lines of a record: JSON, one object a line, in the order in which they came to be known.

Owns: what each kind of line has. Must not know: files, who writes a line and who reads it.

Times are of CLOCK_MONOTONIC in ns. Those of the board (pulses, scans, halts, marks, notes) are on
the board's clock, which is the same but for a fake's: that lags, and `clocks` tells how far.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from etd.protocol.calibration import Calibration
from etd.protocol.carried import CarriedOver
from etd.protocol.frame import Int64
from etd.protocol.link import EngineHello
from etd.protocol.messages import (
    Contact,
    Halt,
    Limits,
    RefusedReport,
    Shown,
    StateReport,
)
from etd.protocol.opening import NamedCalibration
from etd.protocol.outcome import Clamp, Shortfall
from etd.protocol.pulse_row import PulseRow

#: Keys are only added within a format.
FORMAT = 1

#: As the clocks count: sums of a few are still a date.
TimeNs = Int64
Count = Annotated[int, Meta(ge=0, le=2**63 - 1)]
#: Three hundred years, as all times.
LagUs = Annotated[int, Meta(ge=-(2**53), le=2**53)]


class _Line(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", omit_defaults=True):
    """Tagged by `kind`."""


class Header(_Line, frozen=True, kw_only=True, tag="header"):
    """The first line. `columns`: of the rows in `pulses`."""

    format: int
    name: str
    #: Of the program that wrote it, and of the daemon.
    etd: str
    daemon: str
    protocol: int
    begun: str
    begun_ns: TimeNs
    uid: int | None
    columns: tuple[str, ...]


class Engine(_Line, frozen=True, kw_only=True, tag="engine"):
    """An engine is there, with its board, array, maxima and the digests of its files."""

    t_ns: TimeNs
    facts: EngineHello


class EngineGone(_Line, frozen=True, kw_only=True, tag="engine_gone"):
    t_ns: TimeNs


class Carried(_Line, frozen=True, kw_only=True, tag="carried"):
    """What the engine carries over from before the record and that decides over pulses to come;
    every pulse from then on is in the record. `frames`: the requests before the record of those
    that are shown, or wait for a scan. Both only for a replay.
    """

    carried: CarriedOver
    frames: tuple[dict[str, Any], ...] = ()


class Clocks(_Line, frozen=True, kw_only=True, tag="clocks"):
    """The wall time (ns since 1970, UTC) at a time of CLOCK_MONOTONIC; at the beginning, and each
    minute. `uncertainty_ns`: between which two readings it lies. `clock_lag_us`: of the board's
    clock.
    """

    t_ns: TimeNs
    wall_ns: TimeNs
    uncertainty_ns: Count
    clock_lag_us: LagUs = 0


class LeaseBegun(_Line, frozen=True, kw_only=True, tag="lease"):
    """A lease with a person's limits: a calibration, with its name and digest, or numbers.
    `others`: the calibrations for other polarities that it was opened with.
    """

    t_ns: TimeNs
    client: str
    uid: int | None
    calibration_name: str | None = None
    calibration_digest: str | None = None
    calibration: Calibration | None = None
    others: tuple[NamedCalibration, ...] = ()
    limits: Limits | None = None


class LeaseEnded(_Line, frozen=True, kw_only=True, tag="lease_ended"):
    t_ns: TimeNs
    reason: str


class Asked(_Line, frozen=True, kw_only=True, tag="request"):
    """A request of a client; `number` comes back in its reply. What has its default is left out,
    and so is the lease's token. `number` 0: a streamed frame, to which there is no reply.
    """

    t_ns: TimeNs
    number: Count
    client: str
    uid: int | None
    request: dict[str, Any]


class Replied(_Line, frozen=True, kw_only=True, tag="reply"):
    t_ns: TimeNs
    number: Count
    ok: bool
    reply: dict[str, Any] = {}


class Pulses(_Line, frozen=True, kw_only=True, tag="pulses"):
    """Pulses in the order in which they were fired, in the header's columns."""

    rows: tuple[PulseRow, ...]


class Scans(_Line, frozen=True, kw_only=True, tag="scan"):
    """As telemetry `scan`, without the pulses."""

    now_ns: TimeNs
    shown: tuple[Shown, ...] = ()
    scans: Count = 0
    clamped: tuple[Clamp, ...] = ()
    not_fired: tuple[Shortfall, ...] = ()
    ceiling_ua: int = 0
    pressure_kpa: tuple[float | None, ...] = ()


class State(_Line, frozen=True, kw_only=True, tag="state"):
    """At each change, and each minute."""

    report: StateReport


class Touched(_Line, frozen=True, kw_only=True, tag="contact"):
    report: Contact


class Halted(_Line, frozen=True, kw_only=True, tag="halt"):
    report: Halt


class Refusal(_Line, frozen=True, kw_only=True, tag="refused"):
    """A streamed frame that was not accepted."""

    report: RefusedReport


class Note(_Line, frozen=True, kw_only=True, tag="note"):
    t_ns: TimeNs
    text: str
    uid: int | None


class Lost(_Line, frozen=True, kw_only=True, tag="lost"):
    """What is missing here: pulses that the engine could not pass on, or lines for which the disk
    was too slow. `requests`: requests and replies of users without the lease, beyond what such a
    user may add; nothing came of them but what stops or lowers. `lines` has also what such users
    made the daemon say (refused frames, a state for each answer), beyond what all may.
    """

    t_ns: TimeNs
    pulses: Count = 0
    lines: Count = 0
    requests: Count = 0


#: `stopped` by a request, `full` at its bound, `ended` with the daemon.
Why = Literal["stopped", "full", "ended"]


class End(_Line, frozen=True, kw_only=True, tag="end"):
    """The last line. Without it the record was cut off: by a kill, or a failing disk. `detail`: of
    `full`, where that was another bound than the record's own.
    """

    t_ns: TimeNs
    why: Why
    detail: str | None = None


Line = (
    Header
    | Engine
    | EngineGone
    | Carried
    | Clocks
    | LeaseBegun
    | LeaseEnded
    | Asked
    | Replied
    | Pulses
    | Scans
    | State
    | Touched
    | Halted
    | Refusal
    | Note
    | Lost
    | End
)

_encoder = msgspec.json.Encoder()
_decoder: msgspec.json.Decoder[Line] = msgspec.json.Decoder(Line)


def encoded(line: Line) -> bytes:
    """With its line feed."""
    return _encoder.encode(line) + b"\n"


def decoded(data: bytes) -> Line:
    """Raises: msgspec.DecodeError (its ValidationError too)."""
    return _decoder.decode(data)
