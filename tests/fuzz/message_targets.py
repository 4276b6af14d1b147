"""Targets: the messages of clients, and those between gateway and engine.

Owns: requests and streamed frames (JSON), and both directions of the link (msgpack). Must not know:
sockets, what is done with a message.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterator
from typing import Any

import msgspec

from etd.gateway.inbound import InboundMessage, Unreadable, read_frame, read_request
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import Undecodable
from etd.protocol.frame import Frame, Ring
from etd.protocol.link import (
    Alive,
    Answer,
    AskAccount,
    LeaseEnded,
    MeasureContact,
    NewFrame,
    OpenLease,
    PulseBatch,
    Report,
    SayFelt,
    SetMark,
    StopNow,
    ToEngine,
    ToGateway,
    decoded,
)
from etd.protocol.messages import FrameRequest, Halt, Limits, Stop
from etd.protocol.opening import WantedCalibration
from etd.protocol.pulse_row import ROW_BYTES, rows_of
from fuzz.frame_bounds import check_frame
from fuzz.sentences import check_error, check_refusal
from fuzz.target import Target
from scripted_engine import account, engine_hello

_LEASE = "0123456789abcdef0123456789abcdef"
_to_engine: Any = msgspec.msgpack.Decoder(ToEngine)
_frame: Any = msgspec.msgpack.Decoder(NewFrame)
_to_gateway: Any = msgspec.msgpack.Decoder(ToGateway)


def inbound(data: bytes) -> InboundMessage:
    return InboundMessage(connection=1, route=(), uid=0, data=data)


def _play_request(data: bytes) -> None:
    try:
        request = read_request(inbound(data))
    except Unreadable as unreadable:
        check_refusal(unreadable)
        assert not _says_stop(data), "a stop is a stop, whatever else is wrong"
        return
    assert not _says_stop(data) or isinstance(request, Stop)
    again = read_request(inbound(msgspec.json.encode(request)))
    assert again == request
    if isinstance(request, FrameRequest):
        check_frame(request)


def _says_stop(data: bytes) -> bool:
    """By another reader of JSON: an object of which an `op` is "stop", the only one or plainly."""
    if not data.startswith(b"{"):
        return False
    try:
        pairs = json.loads(data.decode(), object_pairs_hook=lambda pairs: pairs)
    except (ValueError, RecursionError):
        return False
    ops = [value for key, value in pairs if key == "op"]
    return "stop" in ops and (len(ops) == 1 or b"\\" not in data)


def request_seeds() -> Iterator[bytes]:
    limits = {"max_current_ua": 3_000, "width_us": 100}
    lease = {"lease": _LEASE}
    for request in (
        {"op": "hello"},
        {"op": "status", "id": "a"},
        {"op": "stop", "id": 1, "client": "my {best} study"},
        {"op": "open", "id": 2, "client": "study", "limits": limits},
        {"op": "open", "client": "study", "calibration": "P01"},
        {"op": "open", "client": "study", "calibration": ["P01", "P01-cathodic"]},
        *({"op": op, "id": 2**63 - 1, **lease} for op in ("keep", "close", "disarm", "measure")),
        {"op": "arm"},
        {"op": "clear"},
        {"op": "mark", "tag": "now", **lease},
        {"op": "felt", "answer": "too_strong", "electrodes": [0, 3]},
        {"op": "account", "seq": 4, **lease},
        {"op": "calibration", "do": "get", "name": "P01"},
        {"op": "record", "do": "start", "name": "p01"},
        {"op": "note", "text": "a remark"},
    ):
        yield json.dumps(request).encode()
    made = {"op": "calibration", "do": "set", "name": "P01"}
    yield json.dumps({**made, "calibration": msgspec.to_builtins(calibration())}).encode()
    yield b'{"x":{"y":1},"op":"hello","op":"stop"}'
    yield from _streamed_seeds()


def _play_streamed(data: bytes) -> None:
    try:
        frame = read_frame(inbound(data))
    except Unreadable as unreadable:
        check_refusal(unreadable)
        return
    check_frame(frame)
    assert read_frame(inbound(msgspec.json.encode(frame))) == frame


def frames() -> Iterator[Frame]:
    """One of each form, for four electrodes."""
    base: dict[str, Any] = {"lease": _LEASE, "seq": 1}
    currents = (0, 500, 1_000, 0)
    yield Frame(**base, level=(0.0, 0.5, 1.0, 0.0))
    yield Frame(**base, current_ua=currents, width_us=(50, 100, 50, 50), rate_hz=60.0, tag=7)
    yield Frame(**base, current_ua=currents, polarity=("anodic", "cathodic") * 2, strict=True)
    yield Frame(**base, current_ua=currents, polarity="biphasic", returns=Ring(ring_mm=2.5))
    yield Frame(**base, current_ua=currents, returns=((1,), (0, 2), (3,), (0, 1, 2)), pulses=2)
    yield Frame(**base, current_ua=currents, rate_hz=(20.0,) * 4, allow_slower=True, sync=True)
    yield Frame(**base, level=(0.5,) * 4, on_trigger=True, lasts_ms=50, renews=0, sent_ns=-1)
    yield Frame(**base, current_ua=(700,) * 64, preview=True, account=True, ttl_ms=1_000)


def _streamed_seeds() -> Iterator[bytes]:
    for frame in frames():
        known = {"op": "frame", **msgspec.to_builtins(frame)}
        yield json.dumps({key: value for key, value in known.items() if value is not None}).encode()


def calibration() -> Calibration:
    """For four electrodes."""
    return Calibration(
        participant="P01",
        body_site="fingertip",
        array="row-4",
        polarity="anodic",
        width_us=100,
        rate_hz=60.0,
        returns="all",
        date=datetime.date(2025, 1, 15),
        program="test",
        electrode=(ElectrodeLimits(threshold_ua=500, comfortable_ua=1_000, cap_ua=2_000),) * 4,
    )


def _play_to_engine(data: bytes) -> None:
    for decoder in (_to_engine, _frame):
        try:
            message = decoded(decoder, data)
        except Undecodable as undecodable:
            check_error(undecodable)
            continue
        # Also keeps NaN out: it is not equal to itself.
        assert decoded(decoder, msgspec.msgpack.encode(message)) == message
        if isinstance(message, NewFrame):
            check_frame(message.frame)
        if isinstance(message, OpenLease):
            # They become the names of files.
            assert all("/" not in wanted.name for wanted in message.calibrations)


def check_caps(made: Calibration) -> None:
    """What an accepted calibration may allow at most."""
    assert 20 <= made.width_us <= 200
    assert 0.0 < made.rate_hz <= 200.0
    for limits in made.electrode:
        assert 0 <= limits.threshold_ua <= limits.comfortable_ua <= limits.cap_ua <= 10_000


def to_engine_seeds() -> Iterator[bytes]:
    limits = Limits(max_current_ua=3_000, width_us=100)
    for message in (
        Alive(),
        OpenLease(ref=1, lease=_LEASE, client="study", limits=limits),
        OpenLease(
            ref=1, lease=_LEASE, client="study", calibrations=(WantedCalibration(name="P01"),)
        ),
        OpenLease(
            lease=_LEASE,
            client="a",
            calibrations=tuple(
                WantedCalibration(name=name, digest="0123456789abcdef" * 4)
                for name in ("P01-anodic", "P01-cathodic")
            ),
        ),
        MeasureContact(ref=3, lease=_LEASE),
        StopNow(ref=4, client="study"),
        SetMark(ref=5, lease=_LEASE, tag="now"),
        SayFelt(ref=6, answer="too_strong", electrodes=(0, 3)),
        AskAccount(ref=7, lease=_LEASE, seq=3),
        *(NewFrame(ref=8, frame=frame) for frame in frames()),
    ):
        yield msgspec.msgpack.encode(message)


def _play_to_gateway(data: bytes) -> None:
    try:
        message = decoded(_to_gateway, data)
    except Undecodable as undecodable:
        check_error(undecodable)
        return
    msgspec.json.encode(message)
    if isinstance(message, PulseBatch):
        try:
            rows = list(rows_of(message.rows))
        except Undecodable:
            return
        assert len(rows) == len(message.rows) // ROW_BYTES
        msgspec.json.encode(rows)


def engine_messages() -> Iterator[bytes]:
    halt = Halt(cause="stop", source="study", detail="asked", t_ns=700)
    for message in (
        engine_hello(),
        Answer(ref=1, rate_hz=60.0, account=account(3)),
        Answer(ref=1, error="halted", reason="latched"),
        LeaseEnded(lease=_LEASE, reason="lapsed"),
        Report(halt=halt),
        PulseBatch(rows=bytes(2 * ROW_BYTES), lost=1),
    ):
        yield msgspec.msgpack.encode(message)


_PROTOCOL = (
    *("daemon/etd/protocol/*.py", "daemon/etd/pulse/*.py", "daemon/etd/stabilize/shape.py"),
    "hal/etd_hal/names.py",
)
TARGETS = (
    Target(
        "requests",
        "a client's bytes as a request",
        _play_request,
        request_seeds,
        (*_PROTOCOL, "daemon/etd/gateway/inbound.py"),
    ),
    Target(
        "frames",
        "a client's bytes as a streamed frame",
        _play_streamed,
        _streamed_seeds,
        (*_PROTOCOL, "daemon/etd/gateway/inbound.py"),
    ),
    Target(
        "link-to-engine",
        "the gateway's bytes, as the engine decodes them",
        _play_to_engine,
        to_engine_seeds,
        _PROTOCOL,
    ),
    Target(
        "link-to-gateway",
        "the engine's bytes, as the gateway decodes them",
        _play_to_gateway,
        engine_messages,
        _PROTOCOL,
    ),
)
