"""The display for asyncio.

Owns: sending each request of `Session` to the daemon and awaiting the answer.
Must not know: the order of requests (session), the options of a frame (options).

Requests of one display are sent one after another; `stop` has its own connection and never waits
for another request.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any, Self, Unpack

import zmq
import zmq.asyncio

from etd.client import clock, values, wire
from etd.client.connection import Connection
from etd.client.opening import Opening
from etd.client.options import FrameOptions, Kind, frame_fields, renewal_s, silent_fields
from etd.client.session import KEEP_S, Ask, Flow, R
from etd.client.telemetry import AsyncTelemetry
from etd.client.values import Numbers
from etd.protocol.calibration import Calibration
from etd.protocol.errors import DaemonGone, EtdError, Refused
from etd.protocol.messages import (
    FrameReply,
    HelloReply,
    MarkReply,
    MeasureReply,
    StateReport,
    Success,
    Topic,
)


class AsyncDisplay(Connection[zmq.asyncio.Socket]):
    """`async with AsyncDisplay() as display:`; the methods of `Display`, awaited."""

    def _new_context(self) -> zmq.asyncio.Context:
        return zmq.asyncio.Context()

    def _begin(self) -> None:
        self._turn = asyncio.Lock()

    async def __aenter__(self) -> Self:
        try:
            await self.connect()
        except BaseException:
            self._hang_up()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def connect(self) -> None:
        """Learn the facts; without an engine there are none, and `status` and `stop` still work."""
        wire.check_there(self.address)
        try:
            await self._run(self._session.greet())
        except Refused as refusal:
            if refusal.code != "engine_gone":
                raise

    async def greet(self) -> HelloReply:
        """Ask for the facts again. Raises: Refused (`engine_gone`)."""
        return await self._run(self._session.greet())

    @property
    def facts(self) -> HelloReply:
        """Board, array with positions, maxima, calibrations. Raises: Refused (`engine_gone`)."""
        if self._session.facts is None:
            raise Refused("engine_gone", "the facts are not known yet: await connect() or greet()")
        return self._session.facts

    @property
    def electrodes(self) -> int:
        """How many values a frame has."""
        return self.facts.array.electrodes

    async def status(self) -> StateReport:
        return await self._run(self._session.status())

    async def arm(self, timeout_s: float = 10.0, *, open_to: Numbers | float | None = None) -> None:
        """Open the lease if none stands, check the board and enable the supply; waits for it.
        `open_to`: see `Display.arm`.
        """
        await self._run(self._session.arm(timeout_s))
        if open_to is not None:
            await self._open_to(open_to)

    async def arm_holder(self, timeout_s: float = 10.0) -> None:
        """The operator's `arm`: arms the lease of its present holder."""
        await self._run(self._session.arm_holder(timeout_s))

    async def disarm(self) -> None:
        await self._run(self._session.disarm())

    async def keep(self) -> None:
        """Renew the lease, without a frame."""
        await self._run(self._session.keep())

    async def show(self, levels: Numbers, **options: Unpack[FrameOptions]) -> FrameReply:
        """One frame of levels, 0..1 for each electrode."""
        return await self._run(self._session.frame(frame_fields("level", levels, options)))

    async def show_current(
        self, current_ua: Numbers, **options: Unpack[FrameOptions]
    ) -> FrameReply:
        """One frame of currents, in uA for each electrode; see `Display.show_current`."""
        fields = frame_fields("current_ua", current_ua, options)
        return await self._run(self._session.frame(fields))

    async def hold(self, levels: Numbers, seconds: float, **options: Unpack[FrameOptions]) -> None:
        """Show levels for `seconds`, then silence. Cancelled, it ends silent."""
        await self._hold("level", levels, seconds, options)

    async def hold_current(
        self, current_ua: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> None:
        """Show currents for `seconds`, then silence. Cancelled, it ends silent."""
        await self._hold("current_ua", current_ua, seconds, options)

    async def stream(self, levels: Numbers, **options: Unpack[FrameOptions]) -> None:
        """One frame without an answer; the newest wins. A refusal comes as telemetry `refused`."""
        await self._stream(frame_fields("level", levels, options))

    async def stream_current(self, current_ua: Numbers, **options: Unpack[FrameOptions]) -> None:
        """The same for currents in uA."""
        await self._stream(frame_fields("current_ua", current_ua, options))

    async def measure(self, timeout_s: float = 10.0) -> MeasureReply:
        """Contact of all electrodes, with probe pulses; from SAFE back to SAFE."""
        return await self._run(self._session.measure(timeout_s))

    async def mark(self, tag: int | None = None) -> MarkReply:
        return await self._run(self._session.mark(tag))

    async def stop(self) -> None:
        """Silence at once, whichever client holds the lease and whatever is under way here."""
        socket = wire.configure(self._context.socket(zmq.DEALER), self.address)
        try:
            flow = self._session.stop()
            await self._exchange(socket, next(flow))
        finally:
            socket.close()

    async def clear(self) -> None:
        """Leave HALTED for SAFE; then `arm()` anew."""
        await self._run(self._session.clear())

    async def calibrations(self) -> tuple[str, ...]:
        return await self._run(self._session.calibrations())

    async def calibration(self, name: str) -> Calibration:
        """Raises: Refused (`not_found`)."""
        return await self._run(self._session.get_calibration(name))

    async def set_calibration(self, name: str, calibration: Calibration) -> None:
        """Keep a calibration under a name; in SAFE only, needs operate rights."""
        await self._run(self._session.set_calibration(name, calibration))

    async def delete_calibration(self, name: str) -> None:
        """Have the daemon forget it; needs operate rights. Raises: Refused (`not_found`)."""
        await self._run(self._session.delete_calibration(name))

    def telemetry(self, *topics: Topic, timeout_s: float | None = None) -> AsyncTelemetry:
        """`async with display.telemetry("scan") as reports: async for topic, report in reports`"""
        address = self._telemetry_address()
        return AsyncTelemetry(self._context, address, topics, timeout_s, join_s=self._timeout_s)

    async def close(self) -> None:
        """Give the lease back (which disarms) and hang up. Idempotent."""
        if self._context.closed:
            return
        try:
            await self._run(self._session.close())
        except DaemonGone:
            pass  # nobody is there to be told; the lease has ended with the daemon, or lapses
        finally:
            self._hang_up()

    async def _hold(
        self, kind: Kind, numbers: Numbers, seconds: float, options: FrameOptions
    ) -> None:
        fields = frame_fields(kind, numbers, options)
        held_s = values.above_zero_s("seconds", seconds)
        end_ns = clock.now_ns() + int(held_s * 1e9)
        try:
            while (left_s := (end_ns - clock.now_ns()) / 1e9) > 0:
                await self._run(self._session.frame({**fields, "sent_ns": clock.now_ns()}))
                await asyncio.sleep(min(renewal_s(options), left_s))
        except asyncio.CancelledError:
            with contextlib.suppress(EtdError):  # the frame expires by itself
                await self._run(self._session.frame(silent_fields(fields)))
            raise
        await self._run(self._session.frame(silent_fields(fields)))

    async def _open_to(self, levels: Numbers | float) -> None:
        opening = Opening(levels, self.electrodes, clock.now_ns())
        while True:
            reply = await self._run(self._session.frame(opening.frame()))
            if opening.is_done(reply, clock.now_ns()):
                break
            await asyncio.sleep(opening.renewal_s)
        await self._run(self._session.frame(opening.silence()))

    async def _stream(self, fields: dict[str, object]) -> None:
        await self._run(self._session.opened())
        data = self._session.streamed(fields)
        frames = self._frames_socket()
        if not await _is_writable(frames, self._timeout_s):
            raise DaemonGone(self.address, f"no frame was taken within {self._timeout_s:g} s")
        await frames.send(data)

    async def _run(self, flow: Flow[R]) -> R:
        """Drive one of the session's generators to its end, one caller after another."""
        async with self._turn:
            try:
                ask = next(flow)
                while True:
                    try:
                        reply = await self._exchange(self._connected(), ask)
                    except Refused as refusal:
                        ask = flow.throw(refusal)
                    except DaemonGone:
                        self._drop_control()
                        raise
                    else:
                        ask = flow.send(reply)
            except StopIteration as end:
                result: R = end.value
                return result

    async def _exchange(self, socket: zmq.asyncio.Socket, ask: Ask) -> Success:
        """Send one request and await its reply, keeping the lease if it is a slow one."""
        deadline_ns = clock.now_ns() + int(ask.timeout_s * 1e9)
        if await _is_writable(socket, ask.timeout_s):
            await socket.send(ask.data)
            while (left_s := (deadline_ns - clock.now_ns()) / 1e9) > 0:
                wait_s = left_s if ask.keep is None else min(left_s, KEEP_S)
                if await socket.poll(max(1, int(wait_s * 1000))):
                    parts: list[Any] = await socket.recv_multipart()
                    reply = self._session.settle(ask, parts[-1])
                    if reply is not None:
                        return reply
                elif ask.keep is not None:
                    await socket.send(ask.keep())
        raise DaemonGone(self.address, f"no answer to {ask.op} within {ask.timeout_s:g} s")


async def _is_writable(socket: Any, timeout_s: float) -> bool:
    """Any: pyzmq's stub of the awaited poll leaves out its flags."""
    return bool(await socket.poll(int(timeout_s * 1000), zmq.POLLOUT))
