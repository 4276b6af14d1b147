"""A message that arrives at a socket: its reply address, its sender, and its content.

Owns: strict decoding of untrusted bytes, and the errors for what cannot be decoded.
Must not know: leases, the engine, how a request is handled.
"""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass, field
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec

from etd.gateway.connection import Connection
from etd.protocol.calibration import Method
from etd.protocol.errors import Refused
from etd.protocol.frame import POLARITIES, RETURNS_IN_WORDS, Int64, Lease
from etd.protocol.messages import (
    REPLY_OF_OP,
    FrameRequest,
    GetCalibration,
    Id,
    Record,
    Request,
    Stop,
)
from etd.protocol.text import PATTERN_IN_WORDS, escaped
from etd.protocol.zmtp import Parts

#: The order in which an error lists the ops.
OPS = tuple(REPLY_OF_OP)

#: What may stand at a key, in words; also by op, where keys of one name differ.
_CHOICES = {
    "polarity": ", ".join(POLARITIES),
    "method": ", ".join(get_args(Method)),
    "returns": RETURNS_IN_WORDS,
}
_CHOICES_OF_OP = {
    (request.__struct_config__.tag, "do"): ", ".join(get_args(get_type_hints(request)["do"]))
    for request in (GetCalibration, Record)
}
_CHOICES_OF_OP["calibration", "do"] += (
    "; `etd calibration import` stores one and `etd calibration delete` deletes one, each as a"
    " process of the operator's own"
)

#: Characters, in a reason, of what a client sent.
_MOST_QUOTED = 200
_PER_ELECTRODE = re.compile(r"(?:level|current_ua|width_us|polarity|rate_hz|returns)\[(\d+)\]")
#: Wherever it stands: at what depth cannot be told of a message that is no JSON as a whole, and a
#: request that is meant otherwise has it nowhere. In a text its quotes are escaped. That is looked
#: for after the word: what begins with a word is found in a twentieth of the time.
_STOP = re.compile(rb'"op"(?<!\\"op")\s*:\s*"stop"')
_NO_NUMBER = re.compile(rb"[:\[,]\s*[-+]?(?:nan|inf)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class InboundMessage:
    """A message as it came. `connection`: where the reply goes. `route`: the parts before the last.
    `uid`: the sender by the kernel. `number`: no other message of this process has it.
    """

    connection: int
    route: tuple[bytes, ...]
    uid: int
    data: bytes
    number: int = field(default_factory=itertools.count(1).__next__)


class Unreadable(Refused):
    """A message that cannot be decoded. Fields: those of Refused, and its id as far as it can."""

    def __init__(
        self,
        refusal: Refused,
        id: Id | None = None,  # noqa: A002 (the wire's word)
    ) -> None:
        self.id = id
        super().__init__(refusal.code, refusal.reason, refusal.electrode)


R = TypeVar("R", bound=Refused)
D = TypeVar("D")


def without_frames(refusal: R) -> R:
    """The refusal, to be stored for the rest of a turn.

    Its traceback, and that of its context, refer to the frame that stores it. Such a cycle would
    hold the bytes of a whole turn until a garbage collection: a flood would fill the memory.
    """
    refusal.__context__ = None
    return refusal.with_traceback(None)


class _Id(msgspec.Struct):
    id: Id | None = None


class _Op(msgspec.Struct):
    op: str | None = None


class _Head(_Op):
    """What is read of a message that cannot be decoded."""

    id: Id | None = None


class FrameHead(msgspec.Struct):
    """Whose frame it is."""

    lease: Lease
    seq: Int64


_request_decoder: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)
_stop_decoder = msgspec.json.Decoder(Stop)
_frame_decoder = msgspec.json.Decoder(FrameRequest)
_head_decoder = msgspec.json.Decoder(_Head)
_frame_head_decoder = msgspec.json.Decoder(FrameHead)
_id_decoder = msgspec.json.Decoder(_Id)
_op_decoder = msgspec.json.Decoder(_Op)


def inbound_of(connection: Connection, parts: Parts) -> InboundMessage:
    """A message of this client, with its user id by the kernel."""
    return InboundMessage(connection.number, parts[:-1], connection.uid, parts[-1])


def is_stop(inbound: InboundMessage) -> bool:
    """Whether `read_request` makes a stop of it. A tenth of the time, and no memory: an array is
    stepped over, and not decoded.

    Written plainly, `"op":"stop"` is one whatever else there is: half of a pair in the client's
    name, a lost end, a second `op`. With an escape it is one where the message is JSON.
    """
    return _STOP.search(inbound.data) is not None or _head_of(inbound.data).op == "stop"


def id_of(inbound: InboundMessage) -> Id | None:
    """By which the client knows the reply, as far as it can be decoded."""
    return _head_of(inbound.data).id


def read_request(inbound: InboundMessage) -> Request:
    """A request from the control socket. Raises: Unreadable.

    A stop is a stop whatever else is wrong with the message, its parts too (a proxy adds one): then
    it names no client.
    """
    is_whole = inbound.route in ((), (b"",))
    if is_stop(inbound):
        stop = _decoded(_stop_decoder, inbound.data) if is_whole else None
        return stop or Stop(id=id_of(inbound))
    if not is_whole:
        what = "a request must be one part, or an empty part and one more"
        raise Unreadable(Refused("bad_message", what))
    request: Request = _read(inbound.data, _request_decoder)
    return request


def head_of_frame(inbound: InboundMessage) -> FrameHead:
    """Of a frame from the frames socket; arrays are stepped over, and not decoded. Raises:
    Unreadable.
    """
    if inbound.route:
        raise Unreadable(Refused("bad_message", "a streamed frame must be one part"))
    head: FrameHead = _read(inbound.data, _frame_head_decoder)
    return head


def read_frame(inbound: InboundMessage) -> FrameRequest:
    """The whole of it. Raises: Unreadable."""
    frame: FrameRequest = _read(inbound.data, _frame_decoder)
    return frame


def _read(data: bytes, decoder: msgspec.json.Decoder[Any]) -> Any:
    if not data.startswith(b"{"):
        what = "a message must be one JSON object in UTF-8, from { on"
        raise Unreadable(Refused("bad_message", what), _head_of(data).id)
    try:
        return decoder.decode(data)
    except msgspec.ValidationError as error:
        head = _head_of(data)
        raise Unreadable(_why_invalid(head.op, str(error)), head.id) from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Unreadable(_why_no_json(data, error), _head_of(data).id) from None


def _why_invalid(op: str | None, error: str) -> Refused:
    """`error`: of msgspec, like "Expected `float`, got `str` - at `$.level[3]`"."""
    if op is not None and op not in OPS:
        # Cut before it is quoted: a long one takes longer to quote than to read.
        return Refused("unknown_op", f"there is no op {op[:40]!r}; there are {', '.join(OPS)}")
    what, _, path = escaped(error).partition(" - at `$.")
    what, path = _cut(what), _cut(path)
    for pattern, words in PATTERN_IN_WORDS.items():
        what = words if repr(pattern) in what else what
    place = path.removesuffix("`")
    found = _PER_ELECTRODE.match(place)
    reason = f"{place}: {what[:1].lower()}{what[1:]}" if place else what
    reason += _choices(op, place)
    return Refused("bad_message", reason, int(found[1]) if found else None)


def _cut(quoted: str) -> str:
    """A reply does not give back what a client sent by the kilobyte: it may never be read."""
    return quoted if len(quoted) <= _MOST_QUOTED else f"{quoted[:_MOST_QUOTED]} (cut short)"


def _choices(op: str | None, place: str) -> str:
    """What may stand there, where that is one of a few."""
    for key in place.split("."):
        name = key.partition("[")[0]
        choices = _CHOICES_OF_OP.get((op, name)) or _CHOICES.get(name)
        if choices is not None:
            return f"; give {choices}"
    return ""


def _why_no_json(data: bytes, error: Exception) -> Refused:
    if _NO_NUMBER.search(data):
        return Refused(
            "bad_message", f"NaN and infinity are not valid in JSON: send finite numbers ({error})"
        )
    return Refused("bad_message", f"the message is not a JSON object in UTF-8: {error}")


def _head_of(data: bytes) -> _Head:
    """Both at once where both can be decoded, since a message may be long; or else each alone."""
    found = _decoded(_head_decoder, data)
    if found is not None:
        return found
    op, id_of_it = _decoded(_op_decoder, data), _decoded(_id_decoder, data)
    return _Head(op=op.op if op else None, id=id_of_it.id if id_of_it else None)


def _decoded(decoder: msgspec.json.Decoder[D], data: bytes) -> D | None:
    try:
        return decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
