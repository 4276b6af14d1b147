"""Target: ZMTP as bytes, from the greeting to messages of several parts.

Owns: that how the bytes are cut makes no difference, and the bounds of a message. Must not know:
sockets.
"""

from __future__ import annotations

from collections.abc import Iterator

from etd.protocol.zmtp import MOST_PARTS, PEERS, Parts, Reader, Violation, message
from fuzz.choices import Choices
from fuzz.target import Target
from raw_client import hello, part

_KINDS = tuple(PEERS)
_MOST_BYTES = 1_024
#: What was taken of a stream: messages, answers, and a violation at its end.
Taken = list[Parts | bytes | str]


def _read(kind: bytes, pieces: Iterator[bytes]) -> Taken:
    reader = Reader(kind, _MOST_BYTES)
    taken: Taken = []
    for piece in pieces:
        reader.feed(piece)
        try:
            while (found := reader.take()) is not None:
                parts, answer = found
                taken.append(answer if parts is None else parts)
        except Violation:
            return [*taken, "violation"]
    return taken


def _cut(data: bytes, lengths: bytes) -> Iterator[bytes]:
    while data:
        length = 1 + (lengths[0] if lengths else len(data))
        yield data[:length]
        data, lengths = data[length:], lengths[1:]


def _play(data: bytes) -> None:
    choices = Choices(data)
    kind, lengths = choices.pick(_KINDS), choices.taken(4)
    stream = choices.taken(len(data))
    whole = _read(kind, iter([stream]))
    assert _read(kind, _cut(stream, lengths)) == whole
    assert _read(kind, (bytes([byte]) for byte in stream)) == whole
    for parts in whole:
        if isinstance(parts, tuple):
            assert 1 <= len(parts) <= MOST_PARTS
            assert sum(map(len, parts)) <= _MOST_BYTES
            _check_round_trip(kind, parts)


def _check_round_trip(kind: bytes, parts: Parts) -> None:
    peer = PEERS[kind][0].decode()
    sent = hello(peer) + message(parts)
    assert [one for one in _read(kind, iter([sent])) if isinstance(one, tuple)] == [parts]


def _seeds() -> Iterator[bytes]:
    for number, kind in enumerate(_KINDS):
        begin = bytes([number, 1, 9, 63, 2]) + hello(PEERS[kind][0].decode())
        yield begin
        yield begin + part(b"", more=True) + part(b'{"op":"hello"}')
        yield begin + part(b"x" * 600)
        yield begin + bytes([4, 9]) + b"\x04PING\0\0ab" + part(b"\x01state")
        yield begin + bytes([4, 5]) + b"\x04PONG"


TARGETS = (
    Target(
        "zmtp",
        "raw ZMTP: greeting, handshake, frames, cut anywhere",
        _play,
        _seeds,
        ("daemon/etd/protocol/zmtp.py",),
        most_bytes=2_048,
    ),
)
