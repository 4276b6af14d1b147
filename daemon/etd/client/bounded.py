"""A request over a plain Unix socket, whose answer is bounded: what listens may be anybody's.

Owns: that connection. Must not know: what is requested.

libzmq puts a message together before it gives it away, however long it becomes: a socket that sends
without end would fill the memory of the process that asks it. Root asks the sockets of every user
to stop.
"""

from __future__ import annotations

import errno
import socket
from typing import Final, TypeVar

from etd.client import clock
from etd.client.drive import drive
from etd.client.exchange import settled
from etd.client.session import Ask, Flow, Session
from etd.client.way import Way, silent, unreadable
from etd.protocol.errors import DaemonGone, EtdError, Refused
from etd.protocol.messages import MAX_MESSAGE_BYTES, Success
from etd.protocol.zmtp import GREETING, Reader, Violation, message, ready

R = TypeVar("R")
_SCHEME: Final = "ipc://"
_CHUNK_BYTES: Final = 65_536
#: A queue of connections that is full is tried again after so long.
_AGAIN_S: Final = 0.01
_FULL: Final = (errno.EAGAIN, errno.EINTR)


class BoundedExchange:
    """Each request has a connection of its own. `way`: to a socket of this machine."""

    def __init__(self, way: Way, session: Session) -> None:
        self._way = way
        self._session = session

    def run(self, flow: Flow[R]) -> R:
        """Drive one of the session's flows to its end. Raises: DaemonGone, Refused."""
        try:
            return drive(flow, self._ask, Refused)
        except EtdError as error:
            raise error.with_traceback(None)  # noqa: B904

    def _ask(self, ask: Ask) -> Success:
        deadline_ns = clock.now_ns() + int(ask.timeout_s * 1e9)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            try:
                reply = self._asked(ask, connection, deadline_ns)
            except Violation as error:
                raise unreadable(self._way, ask.op, error) from None
            except TimeoutError:
                reply = None
            except OSError as error:
                raise silent(self._way, f"no answer to {ask.op} ({error.strerror})") from None
        if reply is None:
            raise silent(self._way, f"no answer to {ask.op} within {ask.timeout_s:g} s")
        return reply

    def _asked(self, ask: Ask, connection: socket.socket, deadline_ns: int) -> Success | None:
        """None where none came in time. Raises: OSError, TimeoutError, Violation, Refused."""
        if not self._connect(connection, deadline_ns):
            return None
        connection.sendall(GREETING)
        reader, is_sent = Reader(b"DEALER", MAX_MESSAGE_BYTES), False
        while (left_s := _left_s(deadline_ns)) > 0.0:
            connection.settimeout(left_s)
            data = connection.recv(_CHUNK_BYTES)
            if not data:
                raise DaemonGone(self._way.place, "it hung up", "is the daemon running?")
            reader.feed(data)
            while (taken := reader.take()) is not None:
                parts, _ = taken
                if parts is not None and (reply := self._settled(ask, parts[-1])) is not None:
                    return reply
            if reader.is_greeted and not is_sent:
                # libzmq hangs up on what comes together with a greeting.
                connection.sendall(ready(b"DEALER") + message((ask.data,)))
                is_sent = True
        return None

    def _settled(self, ask: Ask, data: bytes) -> Success | None:
        return settled(self._session, self._way, ask, data)

    def _connect(self, connection: socket.socket, deadline_ns: int) -> bool:
        path = self._way.control.removeprefix(_SCHEME)
        while (left_s := _left_s(deadline_ns)) > 0.0:
            connection.settimeout(left_s)
            try:
                connection.connect(path)
                return True
            except BlockingIOError as error:
                if error.errno not in _FULL:
                    raise
                clock.sleep_s(min(_AGAIN_S, left_s))
        return False


def _left_s(deadline_ns: int) -> float:
    return (deadline_ns - clock.now_ns()) / 1e9
