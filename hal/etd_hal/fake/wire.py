"""The datagrams between a board process and its clients.

Owns: their shapes, one per port call and per answer, and how they are packed.
Must not know: sockets, what a call does.

Every call carries the time at which it starts on the client's clock, every answer the time at
which it ends; the client waits for that by itself.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from etd_body.electrode import Contact
from etd_hal.bench import StopName
from etd_hal.errors import BusErrorKind
from etd_hal.ports import Changes, Edge, LineSetup, SpiSetup, Transfer

#: The largest message (511 transfers) fits.
MAX_DATAGRAM_BYTES = 65_536


class _Datagram(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """Packed by position: both ends are the same program."""


class TakeLines(_Datagram, frozen=True):
    """Request the lines, with initial levels, and open the SPI device."""

    t_ns: int
    board: str
    lines: LineSetup
    spi: SpiSetup


class Play(_Datagram, frozen=True):
    t_ns: int
    transfers: tuple[Transfer, ...]


class Resume(_Datagram, frozen=True):
    """Go on with a message that waits."""


class SetLines(_Datagram, frozen=True):
    t_ns: int
    changes: Changes


class GetLine(_Datagram, frozen=True):
    t_ns: int
    line: int


class TakeEdges(_Datagram, frozen=True):
    t_ns: int


class TransferI2c(_Datagram, frozen=True):
    t_ns: int
    address: int
    write: bytes
    read_length: int


class Mark(_Datagram, frozen=True):
    t_ns: int
    event: Literal["frame", "mark"]
    seq: int
    tag: int | str | None


class Press(_Datagram, frozen=True):
    """The world moves a stop line: 0 opens its loop, 1 closes it. No time means now."""

    stop: StopName
    level: int
    at_ns: int | None = None


class GiveEdge(_Datagram, frozen=True):
    """Another instrument gives an edge on the trigger, and lets go of it after so long."""

    lasts_ns: int
    at_ns: int | None = None


class Touch(_Datagram, frozen=True):
    """The world puts a contact under an electrode."""

    electrode: int
    contact: Contact


class PutIn(_Datagram, frozen=True):
    """`fault`: one of `faults.py`, which reads it (`fault_of`)."""

    fault: Any


class AskState(_Datagram, frozen=True):
    """What a test wants to know about the board."""


Call = (
    TakeLines | Play | Resume | SetLines | GetLine | TakeEdges | TransferI2c | Mark
)  # from a client
Knock = Press | GiveEdge | Touch | PutIn | AskState  # through the second door


class Done(_Datagram, frozen=True):
    """The call is over at `end_ns`; the value's type depends on the call."""

    end_ns: int
    reads: tuple[bytes, ...] = ()
    value: int = 0
    edges: tuple[Edge, ...] = ()


class Waits(_Datagram, frozen=True):
    """A message stands still until `until_ns`; the client resumes it."""

    until_ns: int


class Failed(_Datagram, frozen=True):
    """The call raised BusError; it took until `end_ns`."""

    end_ns: int
    kind: BusErrorKind
    device: str
    operation: str
    detail: str


class State(_Datagram, frozen=True):
    violations: tuple[str, ...]
    dac_code: int
    rail_v: float
    held: bool


Answer = Done | Waits | Failed | State

encode = msgspec.msgpack.Encoder().encode
_calls: msgspec.msgpack.Decoder[Call | Knock] = msgspec.msgpack.Decoder(Call | Knock)
_answers: msgspec.msgpack.Decoder[Answer] = msgspec.msgpack.Decoder(Answer)
decode_call = _calls.decode
decode_answer = _answers.decode
