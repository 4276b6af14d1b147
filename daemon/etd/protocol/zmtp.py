"""ZMTP 3.0 with the NULL mechanism, as bytes: what a ZeroMQ library at the other end speaks.

Owns: the greeting, the handshake, frames, and bounds on what one peer may leave unfinished.
Must not know: sockets, what a message means.

See https://rfc.zeromq.org/spec/23/. Of later versions `PING` is answered, for heartbeats.
"""

from __future__ import annotations

from collections.abc import Sequence

_GREETING_BYTES = 64
#: What is sent first. Version 3.0: then a subscription is a message, in every version of the peer.
GREETING = b"\xff" + bytes(7) + b"\x01\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
_NULL = GREETING[12:32]
_MORE, _LONG, _COMMAND = 1, 2, 4
#: READY has a name, a socket type and an identity of at most 255 bytes.
_MOST_COMMAND_BYTES = 512
#: A request has two parts at most. A few more are read, so that a sentence can refuse them.
MOST_PARTS = 8

#: Whom each type of socket talks to.
PEERS = {
    b"ROUTER": (b"DEALER", b"REQ", b"ROUTER"),
    b"PULL": (b"PUSH",),
    b"XPUB": (b"SUB", b"XSUB"),
    b"DEALER": (b"ROUTER", b"DEALER", b"REP"),
}

Parts = tuple[bytes, ...]


class Violation(Exception):
    """The peer does not keep to ZMTP or to a bound: its connection must be closed."""


def message(parts: Sequence[bytes]) -> bytes:
    """A message on the wire."""
    last = len(parts) - 1
    return b"".join(_frame(_MORE if n < last else 0, part) for n, part in enumerate(parts))


def ready(kind: bytes) -> bytes:
    """A READY on the wire. `kind`: of the socket that sends it."""
    return _frame(_COMMAND, b"\x05READY" + _property(b"Socket-Type", kind))


def _frame(flags: int, body: bytes) -> bytes:
    if len(body) < 256:
        return bytes((flags, len(body))) + body
    return bytes((flags | _LONG,)) + len(body).to_bytes(8, "big") + body


def _property(name: bytes, value: bytes) -> bytes:
    return bytes((len(name),)) + name + len(value).to_bytes(4, "big") + value


class Reader:
    """What one peer sends, put together again. Its memory is what was fed and not yet taken, and
    the parts of one message.

    READY is the answer to the peer's: a library sends messages only after it, so none is on the way
    from a peer that is closed before its handshake is complete, and it keeps them to connect again.
    """

    def __init__(self, kind: bytes, most_bytes: int) -> None:
        """`kind`: this end's. `most_bytes`: of all parts of a message together."""
        self._kind = kind
        self._most_bytes = most_bytes
        self._fed = bytearray()
        self._parts: list[bytes] = []
        self._parts_bytes = 0
        #: The peer speaks ZMTP: READY may be sent.
        self.is_greeted = False
        #: The handshake is complete.
        self.is_ready = False

    @property
    def stored_bytes(self) -> int:
        """What was fed and not taken."""
        return len(self._fed) + self._parts_bytes

    def feed(self, data: bytes) -> None:
        self._fed += data

    def take(self) -> tuple[Parts | None, bytes] | None:
        """The next message, or the answer to a command; None: more must be fed first.

        Raises: Violation.
        """
        if not self.is_greeted and not self._take_greeting():
            return None
        while (taken := self._take_frame()) is not None:
            flags, body = taken
            if flags & _COMMAND:
                return None, self._obey(body)
            if not self.is_ready:
                raise Violation("a message before READY")
            self._parts.append(body)
            self._parts_bytes += len(body)
            if not flags & _MORE:
                parts, self._parts, self._parts_bytes = tuple(self._parts), [], 0
                return parts, b""
        return None

    def _take_greeting(self) -> bool:
        """As soon as the peer is seen not to speak ZMTP 3 with NULL, it need say no more."""
        fed = self._fed
        if (fed and fed[0] != 0xFF) or (len(fed) > 9 and not fed[9] & 1):
            raise Violation("no greeting of ZMTP")
        if len(fed) > 10 and fed[10] < 3:
            raise Violation("a version of ZMTP before 3.0")
        if len(fed) < _GREETING_BYTES:
            return False
        if fed[12:32] != _NULL:
            raise Violation("another mechanism than NULL")
        del fed[:_GREETING_BYTES]
        self.is_greeted = True
        return True

    def _take_frame(self) -> tuple[int, bytes] | None:
        """A length beyond the bound is refused before anything of that length is stored."""
        fed = self._fed
        if not fed:
            return None
        flags = fed[0]
        if flags & ~(_MORE | _LONG | _COMMAND) or (flags & _COMMAND and flags & _MORE):
            raise Violation("a frame of no known kind")
        begin = 9 if flags & _LONG else 2
        if len(fed) < begin:
            return None
        length = int.from_bytes(fed[1:begin], "big")
        if flags & _COMMAND:
            if length > _MOST_COMMAND_BYTES:
                raise Violation("a command that is too long")
        elif length > self._most_bytes - self._parts_bytes or len(self._parts) >= MOST_PARTS:
            raise Violation("a message that is too long")
        end = begin + length
        if len(fed) < end:
            return None
        body = bytes(fed[begin:end])
        del fed[:end]
        return flags, body

    def _obey(self, body: bytes) -> bytes:
        """The answer to a command."""
        name, rest = body[1 : 1 + body[0]] if body else b"", body[1 + body[0] :] if body else b""
        if not self.is_ready:
            if name != b"READY" or _properties(rest).get(b"socket-type") not in PEERS[self._kind]:
                raise Violation("a handshake of no peer of this socket")
            self.is_ready = True
            return ready(self._kind)
        if name == b"PING":
            return _frame(_COMMAND, b"\x04PONG" + rest[2:])  # after two bytes of a time to live
        if name == b"PONG":
            return b""
        raise Violation("an unknown command")


def _properties(data: bytes) -> dict[bytes, bytes]:
    """By name in small letters. Raises: Violation."""
    found = {}
    while data:
        name_end = 1 + data[0]
        begin = name_end + 4
        end = begin + int.from_bytes(data[name_end:begin], "big")
        if len(data) < end or begin > len(data):
            raise Violation("properties that end too early")
        found[data[1:name_end].lower()] = data[begin:end]
        data = data[end:]
    return found
