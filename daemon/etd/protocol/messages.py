"""Wire protocol, version 1: every message that a client sends or gets, as typed structs.

Owns: the public messages and their bounds; `docs/protocol.schema.json` is made from here. One JSON
object a message. Within a version keys are only added; clients ignore unknown keys in replies,
the daemon refuses them in requests.
Must not know: sockets, the engine, boards.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from etd.protocol.calibration import Calibration
from etd.protocol.errors import ErrorCode, TimePart
from etd.protocol.facts import ArrayFacts, BoardFacts, Endpoints, MaximaFacts, RecordFacts
from etd.protocol.felt import FeltFacts, Named
from etd.protocol.frame import ClientName, Frame, Int64, Lease, MarkTag, Name, PlainText, Polarity
from etd.protocol.opening import CalibrationNames, Digests, LeaseCalibration
from etd.protocol.opening import Limits as Limits
from etd.protocol.outcome import Account, Clamp, Shortfall, Withheld
from etd.protocol.scan import Fired as Fired
from etd.protocol.scan import Scan as Scan
from etd.protocol.scan import Shown as Shown
from etd.pulse.measured import ContactState as ContactState
from etd.stabilize.offset_estimate import Answer
from etd.stabilize.said import Followed
from etd.stabilize.shape import PLAIN, Shape

VERSION = 1
#: A larger message ends the connection that sent it; the client refuses to send it.
MAX_MESSAGE_BYTES = 65_536
#: A lease lives this long after the last frame that renews it, or `keep`.
LEASE_MS = 1_000
#: `modelled` telemetry of a fake board comes this often while its body feels anything.
MODELLED_HZ = 10

Id = Annotated[str, Meta(max_length=64)] | Int64
State = Literal["SAFE", "PROBE", "ARMED", "HALTED"]
Topic = Literal["state", "scan", "contact", "refused", "halt", "mark", "modelled"]
TOPICS: tuple[Topic, ...] = ("state", "scan", "contact", "refused", "halt", "mark", "modelled")


class _Request(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="op"
):
    id: Id | None = None


class Hello(_Request, frozen=True, tag="hello"):
    """The daemon's facts: version, board and guards, array, limits, endpoints."""


class Status(_Request, frozen=True, tag="status"):
    """The state now, with what was not granted and what is absent."""


class Stop(_Request, frozen=True, tag="stop"):
    """Silence at once; HALTED until `clear`. Needs nothing but access."""

    client: ClientName = ""


class Open(_Request, frozen=True, tag="open"):
    """Request the lease, with the limits of the stimulated person: a calibration, or several of
    the same person, each made with another polarity; or numbers.
    """

    client: Annotated[ClientName, Meta(min_length=1)]
    calibration: CalibrationNames | None = None
    limits: Limits | None = None
    #: Of each calibration that is meant; one with another content is refused.
    digests: Digests | None = None


class Keep(_Request, frozen=True, tag="keep"):
    lease: Lease


class Close(_Request, frozen=True, tag="close"):
    lease: Lease


class Disarm(_Request, frozen=True, tag="disarm"):
    lease: Lease


class Arm(_Request, frozen=True, tag="arm"):
    """Arms the present holder's lease, whichever client sends it."""


class Clear(_Request, frozen=True, tag="clear"):
    """Leave HALTED for SAFE."""


class Measure(_Request, frozen=True, tag="measure"):
    """Contact of all electrodes, with probe pulses, in PROBE; from SAFE back to SAFE."""

    lease: Lease


class Mark(_Request, frozen=True, tag="mark"):
    """A remark in telemetry and bus trace, and an edge on the SYNC line where there is one."""

    lease: Lease
    tag: MarkTag | None = None


class Felt(_Request, frozen=True, tag="felt"):
    """What the person says of the strength, of these `electrodes` or (null) of all. Whoever does
    not hold the lease can only say `too_strong`.
    """

    answer: Answer
    electrodes: Named | None = None
    lease: Lease | None = None


class AccountOf(_Request, frozen=True, tag="account"):
    """What became of a frame that was sent with `account`; answered when it is over."""

    lease: Lease
    seq: Annotated[int, Meta(ge=0, le=2**63 - 1)]


class GetCalibration(_Request, frozen=True, tag="calibration"):
    """`get` one by name, or `list` all. None is stored or deleted here: `etd calibration import`
    and `etd calibration delete` do that, as the operator's own processes.
    """

    do: Literal["get", "list"]
    name: Name | None = None


class Record(_Request, frozen=True, tag="record"):
    """Write a record of all that is asked and fired, on the daemon's disk: `start` one, `stop` the
    one that runs, `list` all, `get` a piece of one from `offset` on, or `delete` one. But for
    `start` and `list`: only its user, a named operator, and root.
    """

    do: Literal["start", "stop", "list", "get", "delete"]
    name: Name | None = None
    offset: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0


class Note(_Request, frozen=True, tag="note"):
    """A remark in the record that is being written, by those who may read it."""

    text: Annotated[PlainText, Meta(min_length=1, max_length=1_000)]


class FrameRequest(Frame, frozen=True, kw_only=True, tag_field="op", tag="frame"):
    """A single frame with an answer (control socket), or streamed without one (frames socket)."""

    id: Id | None = None


Request = (
    Hello
    | Status
    | Stop
    | Open
    | Keep
    | Close
    | Disarm
    | Arm
    | Clear
    | Measure
    | Mark
    | Felt
    | AccountOf
    | GetCalibration
    | Record
    | Note
    | FrameRequest
)


class Failure(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The reply to a refused request; nothing changed."""

    ok: Literal[False]
    error: ErrorCode
    reason: str
    now_ns: int
    id: Id | None = None
    electrode: int | None = None
    achievable_hz: float | None = None
    bound_by: TimePart | None = None


class Success(msgspec.Struct, frozen=True, kw_only=True):
    """The keys in the reply to every accepted request, before its own."""

    ok: Literal[True]
    now_ns: int
    id: Id | None = None


class HelloReply(Success, frozen=True, kw_only=True):
    protocol: int
    version: str
    name: str
    board: BoardFacts
    array: ArrayFacts
    body_site: str
    maxima: MaximaFacts
    default_width_us: int
    default_rate_hz: float
    default_polarity: Polarity
    #: The shape of every pulse at this body site: a new calibration holds for it.
    shape: Shape = PLAIN
    #: The stabilizers of the body site, in their order.
    stabilizers: tuple[str, ...] = ()
    #: Whether the person's word may raise a level above the frame's own, by the body site.
    felt_may_raise: bool = False
    #: Whether frames that name no polarity get both phases where one would leave too much direct
    #: current, by the body site.
    balance: Literal["biphasic"] | None = None
    #: SHA-256 of each file of the configuration, by what it describes.
    digests: dict[str, str] = {}
    default_calibration: str | None
    calibrations: tuple[str, ...]
    #: Where they are kept; on the daemon's machine.
    calibrations_folder: str
    endpoints: Endpoints
    max_message_bytes: int
    lease_ms: int


class LeaseReply(Success, frozen=True, kw_only=True):
    lease: str
    lease_ms: int
    calibrations: tuple[LeaseCalibration, ...] = ()


class ArmReply(Success, frozen=True, kw_only=True):
    """`calibrations`: with which the armed lease stands, as the engine has read them."""

    calibrations: tuple[LeaseCalibration, ...] = ()


class FrameReply(Success, frozen=True, kw_only=True):
    """Accepted: shown from the next start of a scan. `clamped` is what its limits take away.
    `calibrated_hz`: its levels were calibrated at this rate, and it has a lower one.
    `trigger_ns`: not shown, since this edge has begun the frame that it renews.
    """

    seq: int
    rate_hz: float
    clamped: tuple[Clamp, ...] = ()
    slowed: tuple[Shortfall, ...] = ()
    calibrated_hz: float | None = None
    trigger_ns: int | None = None


class Contact(msgspec.Struct, frozen=True, kw_only=True):
    """None: unknown. `pressure_kpa` is of the nearest sensor. `withheld`: probes not fired."""

    contact: tuple[bool | None, ...]
    resistance_ohm: tuple[int | None, ...]
    voltage_v: tuple[float | None, ...]
    t_ns: int
    pressure_kpa: tuple[float | None, ...] = ()
    withheld: tuple[Withheld, ...] = ()


class MeasureReply(Success, frozen=True, kw_only=True):
    contact: tuple[bool | None, ...]
    resistance_ohm: tuple[int | None, ...]
    voltage_v: tuple[float | None, ...]
    pressure_kpa: tuple[float | None, ...] = ()
    withheld: tuple[Withheld, ...] = ()


class MarkReply(Success, frozen=True, kw_only=True):
    marked_ns: int
    sync: bool


class FeltReply(Success, frozen=True, kw_only=True):
    """`did`: what the answer did (`FeltDone`); `reason`: why it did not do more."""

    did: Followed
    reason: str = ""


class AccountReply(Success, frozen=True, kw_only=True):
    account: Account


class CalibrationReply(Success, frozen=True, kw_only=True):
    names: tuple[str, ...] = ()
    calibration: Calibration | None = None


class RecordReply(Success, frozen=True, kw_only=True):
    """`data`: of `get`, base64; empty at the record's end. `problem`: why the last one that was
    written ended by itself.
    """

    records: tuple[RecordFacts, ...] = ()
    data: bytes = b""
    problem: str | None = None


class Halt(msgspec.Struct, frozen=True, kw_only=True):
    """Why the daemon is halted: a `stop` and its source, or a fault."""

    cause: str
    source: str
    detail: str
    t_ns: int


class SessionFacts(msgspec.Struct, frozen=True, kw_only=True):
    """`participant` None: a lease with limits. `ends_in_s` unless used; None while it is."""

    participant: str | None
    ends_in_s: float | None


class StateReport(msgspec.Struct, frozen=True, kw_only=True):
    """Telemetry `state`, each second and at each change; also the body of a `status` reply."""

    state: State
    now_ns: int
    engine: Literal["there", "silent", "gone"]
    halt: Halt | None = None
    holder: str | None = None
    #: With which the holder's lease stands; none where it has limits.
    calibrations: tuple[LeaseCalibration, ...] = ()
    ceiling_ua: int = 0
    rail_v: float | None = None
    supply_on: bool = False
    absent_guards: tuple[str, ...] = ()
    not_granted: tuple[str, ...] = ()
    counters: dict[str, int] = {}
    busy_percent: float = 0.0
    #: What it may be at most, and why: what the kernel says of the scan's core. A sentence.
    busy_at_most: str = ""
    #: How far the board's clock, which times all reports, is behind CLOCK_MONOTONIC.
    clock_lag_us: int = 0
    #: On a fake board ttl, lease, the gateway's silence and the stopper's may last so many times as
    #: long; else 1.
    timeout_factor: int = 1
    timing: dict[str, float] = {}
    machine: tuple[str, ...] = ()
    last_disarm: str | None = None
    #: Why `arm` will be refused until configuration, board or self-test change, with what to do.
    arming_refused: str | None = None
    session: SessionFacts | None = None
    #: Sensors without a valid reading, and why; until two seconds after they recover.
    sensor_problems: dict[str, str] = {}
    #: The record that is being written; or else why the last one ended by itself.
    record: str | None = None
    record_problem: str | None = None
    #: What the person said of the strength since arming, and what follows; null: nothing.
    felt: FeltFacts | None = None


class StatusReply(Success, frozen=True, kw_only=True):
    status: StateReport


class RefusedReport(msgspec.Struct, frozen=True, kw_only=True):
    """Telemetry `refused`: a streamed frame was not accepted. `count`: their number so far."""

    now_ns: int
    error: ErrorCode
    reason: str
    count: int
    seq: int | None = None
    electrode: int | None = None
    achievable_hz: float | None = None
    bound_by: TimePart | None = None


class Marked(msgspec.Struct, frozen=True, kw_only=True):
    """Telemetry `mark`: a client marked this time. `sync`: with an edge on the SYNC line."""

    marked_ns: int
    tag: MarkTag | None
    sync: bool


class Modelled(msgspec.Struct, frozen=True, kw_only=True):
    """Telemetry `modelled`, of fake boards only: the sensation of the modelled body. Per electrode
    the strongest since the last report. `felt`: 1.0 is just felt, 0 nothing; `pain`: 1.0 and more
    would hurt.
    """

    now_ns: int
    felt: tuple[float, ...]
    pain: tuple[float, ...]


Telemetry = StateReport | Scan | Contact | RefusedReport | Halt | Marked | Modelled
TELEMETRY_OF_TOPIC: dict[Topic, Any] = {
    "state": StateReport,
    "scan": Scan,
    "contact": Contact,
    "refused": RefusedReport,
    "halt": Halt,
    "mark": Marked,
    "modelled": Modelled,
}

#: The type of the reply to each op that succeeds.
REPLY_OF_OP: dict[str, Any] = {
    "hello": HelloReply,
    "status": StatusReply,
    "stop": Success,
    "open": LeaseReply,
    "keep": Success,
    "close": Success,
    "disarm": Success,
    "arm": ArmReply,
    "clear": Success,
    "measure": MeasureReply,
    "mark": MarkReply,
    "felt": FeltReply,
    "account": AccountReply,
    "calibration": CalibrationReply,
    "record": RecordReply,
    "note": Success,
    "frame": FrameReply,
}
