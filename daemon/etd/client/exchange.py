"""Requests over one control socket, each with its reply, blocking.

Owns: that socket, and driving flows and courses over it. Must not know: what is requested.

For one thread. What goes on beside the program (`begin`, `kept`) has an exchange of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

import zmq

from etd.client import clock, wire
from etd.client.course import Course, Pause
from etd.client.drive import drive
from etd.client.replies import settled
from etd.client.session import KEEP_S, Ask, Flow, Session
from etd.client.way import Way, closed, silent
from etd.protocol.errors import DaemonGone, EtdError, Refused
from etd.protocol.messages import Success

R = TypeVar("R")


class Exchange:
    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        way: Way,
        session: Session,
        pause: Callable[[float], None] = clock.sleep_s,
    ) -> None:
        self._pause = pause
        self._context = context
        self._way = way
        self._session = session
        self._socket: zmq.Socket[bytes] | None = None
        #: When something was last asked.
        self.used_ns = clock.now_ns()

    def play(self, course: Course[R]) -> R:
        """Drive a course to its end; what interrupts a step is raised in the course as well."""
        try:
            return drive(course, self._do)
        except EtdError as error:
            # Where in the client it came up tells a program nothing.
            raise error.with_traceback(None)  # noqa: B904 (it is the same one)

    def run(self, flow: Flow[R]) -> R:
        """Drive one of the session's flows to its end."""
        try:
            return drive(flow, self._ask, Refused)
        except EtdError as error:
            raise error.with_traceback(None)  # noqa: B904

    def hang_up(self) -> None:
        """What was not answered must not reach a daemon that comes back later. Idempotent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _do(self, step: Flow[object] | Pause) -> object:
        if isinstance(step, Pause):
            return self._pause(step.seconds)
        return self.run(step)

    def _ask(self, ask: Ask) -> Success:
        """Send one request and wait for its reply, keeping the lease if it is a slow one."""
        try:
            return self._answered(ask)
        except zmq.ZMQError:
            # The program's thread has closed it, beside this one.
            if self._context.closed or (self._socket is not None and self._socket.closed):
                raise closed(self._way) from None
            raise

    def _answered(self, ask: Ask) -> Success:
        self.used_ns = clock.now_ns()
        socket = self._connected()
        deadline_ns = clock.now_ns() + int(ask.timeout_s * 1e9)
        while self._is_there(socket, zmq.POLLOUT, deadline_ns):
            sent_ns = clock.now_ns()
            try:
                socket.send(ask.data, zmq.NOBLOCK)
            except zmq.Again:
                continue  # the other end has hung up since: another one may come in time
            while self._is_there(socket, zmq.POLLIN, deadline_ns, ask.keep):
                data = socket.recv_multipart()[-1]
                got_ns = clock.now_ns()
                reply = settled(self._session, self._way, ask, data)
                if reply is not None:
                    self._session.daemon_clock.observe(sent_ns, got_ns, reply.now_ns)
                    return reply
            break
        self.hang_up()
        raise silent(self._way, f"no answer to {ask.op} within {ask.timeout_s:g} s")

    def _is_there(
        self,
        socket: zmq.Socket[bytes],
        event: int,
        deadline_ns: int,
        keep: Callable[[], bytes] | None = None,
    ) -> bool:
        """Waits for the event; False after the deadline. Raises: DaemonGone, if it cannot come."""
        while (left_s := (deadline_ns - clock.now_ns()) / 1e9) > 0:
            if socket.poll(max(1, int(min(left_s, KEEP_S) * 1000)), event):
                return True
            self._check_alive()
            if keep is not None:
                # Without a peer a blocking send would never return.
                with suppress(zmq.Again):
                    socket.send(keep(), zmq.NOBLOCK)
        return False

    def _check_alive(self) -> None:
        """Raises: DaemonGone."""
        try:
            self._way.check_alive()
        except DaemonGone:
            self.hang_up()
            raise

    def _connected(self) -> zmq.Socket[bytes]:
        if self._context.closed:
            raise closed(self._way)
        if self._socket is None:
            self._socket = wire.configure(self._context.socket(zmq.DEALER), self._way.control)
        return self._socket
