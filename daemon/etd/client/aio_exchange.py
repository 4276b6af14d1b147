"""Requests over one control socket, each with its reply, awaited.

Owns: that socket, and driving flows and courses over it. Must not know: what is requested.

Requests of several tasks are sent one after another.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, TypeVar

import zmq
import zmq.asyncio

from etd.client import clock, wire
from etd.client.course import Course, Pause
from etd.client.drive import has_ended
from etd.client.replies import settled
from etd.client.session import KEEP_S, Ask, Flow, Session
from etd.client.way import Way, closed, silent
from etd.protocol.errors import DaemonGone, EtdError, Refused
from etd.protocol.messages import Success

R = TypeVar("R")


class AsyncExchange:
    def __init__(
        self,
        context: zmq.Context[zmq.asyncio.Socket],
        way: Way,
        session: Session,
        pause: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._pause = pause
        self._context = context
        self._way = way
        self._session = session
        self._turn = asyncio.Lock()
        self._socket: zmq.asyncio.Socket | None = None
        self._ending: set[asyncio.Future[Any]] = set()
        #: When something was last asked.
        self.used_ns = clock.now_ns()

    async def play(self, course: Course[R]) -> R:
        """Drive a course to its end; what interrupts a step is raised in the course as well."""
        done: object = None
        raised: BaseException | None = None
        while True:
            # As in `drive`.
            try:
                step = course.send(done) if raised is None else course.throw(raised)
                is_ending = raised is not None
                done = raised = None
                done = await (self._to_its_end(step) if is_ending else self._do(step))
            except StopIteration as end:
                result: R = end.value
                return result
            except EtdError as error:
                if has_ended(course):
                    raise error.with_traceback(None)  # noqa: B904 (as `Exchange` does)
                raised = error
            except BaseException as error:
                if has_ended(course):
                    raise
                raised = error

    async def _to_its_end(self, step: Flow[Any] | Pause) -> Any:
        """Also if this is cancelled meanwhile: it was cancelled already, and ends silent."""
        ending = asyncio.ensure_future(self._do(step))
        # asyncio itself refers to a task only weakly.
        self._ending.add(ending)
        ending.add_done_callback(self._ending.discard)
        return await asyncio.shield(ending)

    async def run(self, flow: Flow[R]) -> R:
        """Drive one of the session's flows to its end, one caller after another."""
        async with self._turn:
            try:
                ask = next(flow)
                while True:
                    refused: Refused | None = None
                    try:
                        reply = await self._ask(ask)
                    except Refused as refusal:
                        refused = refusal
                    ask = flow.send(reply) if refused is None else flow.throw(refused)
            except StopIteration as end:
                result: R = end.value
                return result
            except EtdError as error:
                raise error.with_traceback(None)  # noqa: B904

    def hang_up(self) -> None:
        """What was not answered must not reach a daemon that comes back later. Idempotent."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    async def _do(self, step: Flow[Any] | Pause) -> Any:
        if isinstance(step, Pause):
            await self._pause(step.seconds)
            return None
        return await self.run(step)

    async def _ask(self, ask: Ask) -> Success:
        """Send one request and await its reply, keeping the lease if it is a slow one."""
        self.used_ns = clock.now_ns()
        socket = self._connected()
        deadline_ns = clock.now_ns() + int(ask.timeout_s * 1e9)
        while await self._is_there(socket, zmq.POLLOUT, deadline_ns):
            sent_ns = clock.now_ns()
            try:
                await socket.send(ask.data, zmq.NOBLOCK)
            except zmq.Again:
                continue  # as in `Exchange`
            while await self._is_there(socket, zmq.POLLIN, deadline_ns, ask.keep):
                parts: list[Any] = await socket.recv_multipart()
                got_ns = clock.now_ns()
                reply = settled(self._session, self._way, ask, parts[-1])
                if reply is not None:
                    self._session.daemon_clock.observe(sent_ns, got_ns, reply.now_ns)
                    return reply
            break
        self.hang_up()
        raise silent(self._way, f"no answer to {ask.op} within {ask.timeout_s:g} s")

    async def _is_there(
        self,
        socket: Any,
        event: int,
        deadline_ns: int,
        keep: Callable[[], bytes] | None = None,
    ) -> bool:
        """Awaits the event; False after the deadline. Raises: DaemonGone, if it cannot come. Any:
        pyzmq's stub of the awaited poll leaves out its flags.
        """
        while (left_s := (deadline_ns - clock.now_ns()) / 1e9) > 0:
            if await socket.poll(max(1, int(min(left_s, KEEP_S) * 1000)), event):
                return True
            self._check_alive()
            if keep is not None:
                # As in `Exchange`.
                with suppress(zmq.Again):
                    await socket.send(keep(), zmq.NOBLOCK)
        return False

    def _check_alive(self) -> None:
        """Raises: DaemonGone."""
        try:
            self._way.check_alive()
        except DaemonGone:
            self.hang_up()
            raise

    def _connected(self) -> zmq.asyncio.Socket:
        if self._context.closed:
            raise closed(self._way)
        if self._socket is None:
            self._socket = wire.configure(self._context.socket(zmq.DEALER), self._way.control)
        return self._socket


async def is_writable(socket: Any, timeout_s: float) -> bool:
    """Any: pyzmq's stub of the awaited poll leaves out its flags."""
    return bool(await socket.poll(int(timeout_s * 1000), zmq.POLLOUT))
