"""Gateways and clients that die, hang, flood or send what they must not.

Owns: these kinds of faults, at messages of an engine that has a link. Must not know: boards, buses.
"""

from __future__ import annotations

from collections.abc import Iterator

from campaign.kind import Doing, Kind
from campaign.own_memory import OwnChannel
from campaign.subject import Subject
from engine_rig import LEASE, EngineRig
from etd.protocol.frame import Frame
from etd.protocol.link import (
    ArmBoard,
    ClearHalt,
    DisarmBoard,
    KeepLease,
    NewFrame,
    OpenLease,
    SetMark,
)
from etd.protocol.messages import Limits

_MANY = 500
_JUNK = (b"\xc1", b"\x81" * 5_000, b"\x80")


def of_gateway_and_client() -> Iterator[Kind]:
    yield Kind(
        "the gateway dies", "there", ("spi",), lambda subject: _rig(subject).commands.close()
    )
    yield Kind("the gateway hangs", "there", ("spi",), _hang)
    for junk in _JUNK:
        yield Kind("the gateway sends junk", repr(junk[:4]), ("spi",), _junk(junk))
    yield Kind("the gateway asks for too much", "once", ("spi",), _ask_too_much)
    yield Kind("a client floods", f"{_MANY} of each", ("spi",), _flood)
    yield Kind("the client hangs", "there", ("spi",), _client_hangs)


def _rig(subject: Subject) -> EngineRig:
    assert subject.rig is not None
    return subject.rig


def _hang(subject: Subject) -> None:
    """What clients send waits in it as well."""
    _rig(subject).is_gateway_alive = subject.is_client_alive = False


def _client_hangs(subject: Subject) -> None:
    subject.is_client_alive = False


def _junk(data: bytes) -> Doing:
    def do(subject: Subject) -> None:
        commands = _rig(subject).commands
        assert isinstance(commands, OwnChannel)
        commands.send_bytes(data)

    return do


def _ask_too_much(subject: Subject) -> None:
    """What a gateway that was taken over may say: a lease of its own, and more than any maximum."""
    rig = _rig(subject)
    limits = Limits(max_current_ua=9_000, width_us=200)
    for command in (
        OpenLease(lease="another", client="x", limits=limits),
        ArmBoard(),
        ClearHalt(),
        DisarmBoard(lease="another"),
    ):
        rig.commands.send(command)
    strong = tuple(9_000 for _ in range(rig.engine.components.loaded.array.count))
    frame = Frame(lease=LEASE, seq=1_000_000, current_ua=strong, width_us=200, rate_hz=200.0)
    rig.frames.send(NewFrame(ref=0, frame=frame))


def _flood(subject: Subject) -> None:
    """Valid requests, as fast as they come, without a lease that stands."""
    rig = _rig(subject)
    off = (0,) * rig.engine.components.loaded.array.count
    for seq in range(_MANY):
        rig.commands.send(KeepLease(lease="another", ref=0))
        rig.commands.send(SetMark(lease="another", ref=0))
        rig.frames.send(NewFrame(ref=0, frame=Frame(lease="another", seq=seq, current_ua=off)))
