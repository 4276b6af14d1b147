"""One client's connection to one of the sockets: what it sent, and what it has not read yet.

Owns: its bytes in either direction, each within a bound, and who is at the other end.
Must not know: other connections, what a message means.
"""

from __future__ import annotations

import socket
import struct
from collections import deque

from etd.gateway.turns import Sender
from etd.protocol.zmtp import GREETING, Parts, Reader, Violation

#: Read in one turn: a long message takes some. With the longest message, half received, all that is
#: stored of what was sent.
_CHUNK_BYTES = 4_096
#: Not sent yet. A single message may be longer; a second one then has to wait.
_MOST_UNREAD_BYTES = 131_072
#: What a message takes beside its own bytes: else short ones would take ten times the bound.
_OVERHEAD_BYTES = 64
#: As the kernel keeps them: pid, uid, gid.
_CREDENTIALS = struct.Struct("=iII")


def sender_of(accepted: socket.socket) -> Sender:
    """Who is at the other end, by the kernel."""
    packed = accepted.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(packed)
    return Sender(uid, pid)


class Connection:
    """Never blocks. Closed by either end, it stays so, and does nothing."""

    def __init__(self, accepted: socket.socket, kind: bytes, most_bytes: int, number: int) -> None:
        """`number`: no other connection of this process has it."""
        accepted.setblocking(False)
        self._socket = accepted
        self._reader = Reader(kind, most_bytes)
        self._unread: deque[bytes] = deque()
        self._unread_bytes = 0
        self.number = number
        self.is_open = True
        #: It sent at least one byte.
        self.has_spoken = False
        #: The other end reads no more; what it had sent before it closed is still read.
        self._is_deaf = False
        #: The other end broke the protocol or a bound, and was closed for that.
        self.is_broken_off = False
        #: There was no place for it: it is heard only to stop.
        self.is_guest = False
        #: Telemetry: the beginnings of topics that it wants.
        self.topics: set[bytes] = set()
        #: And how often it asked for one that there is not.
        self.unknown_topics = 0
        #: The events that epoll watches it for.
        self.watched = 0
        self.sender = sender_of(accepted)
        self.uid = self.sender.uid
        self.send(GREETING)

    @property
    def is_ready(self) -> bool:
        return self._reader.is_ready

    @property
    def hears(self) -> bool:
        """As far as is known, the other end reads what is sent."""
        return self.is_open and not self._is_deaf

    @property
    def stored_bytes(self) -> int:
        """Sent by it, received, and not taken."""
        return self._reader.stored_bytes

    @property
    def has_unread(self) -> bool:
        """Something waits for room in the kernel's buffer."""
        return bool(self._unread)

    def has_sent_more(self) -> bool:
        """Something of it was not read yet."""
        try:
            return bool(self._socket.recv(1, socket.MSG_PEEK))
        except OSError:
            return False

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        """Idempotent."""
        self.is_open = False
        self._unread.clear()
        self._socket.close()

    def break_off(self) -> None:
        self.is_broken_off = True
        self.close()

    def take(self) -> Parts | None:
        """The next message; `()` for what was none but took a while; None if nothing is there."""
        was_ready = self.is_ready
        try:
            taken, may_go_on = self._reader.take(), True
            if taken is None:
                may_go_on = self._receive()
                taken = self._reader.take()
            if taken is not None and not was_ready:
                # The end of the handshake: a stop that came with it waits for no other turn, and is
                # heard also of a client that has left and reads no READY.
                self.send(taken[1])
                taken, may_go_on = self._reader.take(), True
        except Violation:
            self.break_off()
            return None
        if taken is None:
            return () if may_go_on else None
        parts, answer = taken
        if answer and not self.send(answer):
            self.break_off()
        return parts or ()

    def _receive(self) -> bool:
        """Whether there may be more."""
        try:
            data = self._socket.recv(_CHUNK_BYTES)
        except BlockingIOError:
            return False
        except OSError:
            data = b""
        if not data:
            self.close()
            return False
        self.has_spoken = True
        self._reader.feed(data)
        return len(data) == _CHUNK_BYTES

    def send(self, message: bytes) -> bool:
        """Whole, now or later. False: the client has left, or does not read what it was sent."""
        if not self.hears:
            return False
        cost = len(message) + _OVERHEAD_BYTES
        if self._unread and self._unread_bytes + cost > _MOST_UNREAD_BYTES:
            return False
        self._unread.append(message)
        self._unread_bytes += cost
        if len(self._unread) == 1:
            self.flush()
        return not self._is_deaf

    def flush(self) -> None:
        """Send what there is room for."""
        while self._unread:
            message = self._unread[0]
            try:
                sent = self._socket.send(message, socket.MSG_NOSIGNAL)
            except BlockingIOError:
                return
            except OSError:
                self._is_deaf = True
                self._unread.clear()
                return
            self._unread_bytes -= sent
            if sent < len(message):
                self._unread[0] = message[sent:]
                return
            self._unread.popleft()
            self._unread_bytes -= _OVERHEAD_BYTES
