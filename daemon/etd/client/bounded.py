"""A request over a plain Unix socket, whose answer is bounded: what listens may be any program.

Owns: that connection. Must not know: what is requested.

libzmq puts a message together before it gives it away, however long it becomes: a socket that sends
without end would fill the memory of the process that asks it. Root asks the sockets of every user
to stop.
"""

from __future__ import annotations

import socket
from typing import Final, TypeVar

from etd.client import clock
from etd.client.drive import drive
from etd.client.replies import settled
from etd.client.session import Ask, Flow, Session
from etd.client.way import Way, silent, unreadable
from etd.protocol.errors import EtdError, Refused
from etd.protocol.messages import MAX_MESSAGE_BYTES, Success
from etd.protocol.zmtp import GREETING, Reader, Violation, message, ready

R = TypeVar("R")
_SCHEME: Final = "ipc://"
_CHUNK_BYTES: Final = 65_536
#: Between two attempts.
_AGAIN_S: Final = 0.01


class BoundedExchange:
    """Each attempt has a connection of its own. `way`: to a socket of this machine."""

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
        """Asked again where it hung up, or its queue is full: it may be on its way back."""
        deadline_ns = clock.now_ns() + int(ask.timeout_s * 1e9)
        while (left_s := _left_s(deadline_ns)) > 0.0:
            try:
                reply = self._asked(ask, deadline_ns)
            except Violation as error:
                raise unreadable(self._way, ask.op, error) from None
            except OSError:
                reply = None
            if reply is not None:
                return reply
            clock.sleep_s(min(_AGAIN_S, left_s))
        raise silent(self._way, f"no answer to {ask.op} within {ask.timeout_s:g} s")

    def _asked(self, ask: Ask, deadline_ns: int) -> Success | None:
        """None where it hung up, or none came in time. Raises: OSError, Violation, Refused."""
        reader, is_sent = Reader(b"DEALER", MAX_MESSAGE_BYTES), False
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(_left_s(deadline_ns))
            connection.connect(self._way.control.removeprefix(_SCHEME))
            connection.sendall(GREETING)
            while (left_s := _left_s(deadline_ns)) > 0.0:
                connection.settimeout(left_s)
                data = connection.recv(_CHUNK_BYTES)
                if not data:
                    return None
                reader.feed(data)
                if (reply := self._reply_in(reader, ask)) is not None:
                    return reply
                if reader.is_greeted and not is_sent:
                    # libzmq hangs up on what comes together with a greeting.
                    connection.sendall(ready(b"DEALER") + message((ask.data,)))
                    is_sent = True
        return None

    def _reply_in(self, reader: Reader, ask: Ask) -> Success | None:
        while (taken := reader.take()) is not None:
            parts, _ = taken
            if parts is not None:
                reply = settled(self._session, self._way, ask, parts[-1])
                if reply is not None:
                    return reply
        return None


def _left_s(deadline_ns: int) -> float:
    return max(0.0, (deadline_ns - clock.now_ns()) / 1e9)
