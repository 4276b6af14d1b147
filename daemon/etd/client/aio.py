"""The display for asyncio.

Owns: sending each request of `Session` to the daemon and awaiting the answer.
Must not know: the order of requests (session), the options of a frame (options).

Requests of one display are sent one after another; `stop` has its own connection and never waits
for another request.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import zmq
import zmq.asyncio

from etd.client import clock, course
from etd.client.aio_exchange import AsyncExchange, is_writable
from etd.client.aio_telemetry import AsyncTelemetry
from etd.client.connection import KEPT_S, Connection
from etd.client.course import Course
from etd.client.options import FrameOptions, Kind
from etd.client.patterns import PatternOptions, playing_pattern, steps_to_play
from etd.client.playing import Played
from etd.client.presented import Presented
from etd.client.presenting import MOST_BEGUN_S, WAIT_S, presenting
from etd.client.session import KEEP_S, Flow, R
from etd.client.values import Numbers, up_to_s
from etd.client.way import silent
from etd.protocol.calibration import Calibration
from etd.protocol.errors import DaemonGone, EtdError, Refused
from etd.protocol.facts import RecordFacts
from etd.protocol.messages import (
    FeltReply,
    FrameReply,
    HelloReply,
    MarkReply,
    MeasureReply,
    StateReport,
    Topic,
)
from etd.protocol.opening import LeaseCalibration
from etd.stabilize.offset_estimate import Answer as FeltAnswer

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

    from etd.files.pattern import Pattern


class AsyncDisplay(Connection[zmq.asyncio.Socket]):
    """`async with AsyncDisplay() as display:`; the methods of `Display`, awaited.

    With a `host` it is there once ssh has connected: make it before other tasks run.
    """

    def _new_context(self) -> zmq.asyncio.Context:
        return zmq.asyncio.Context()

    def _begin(self) -> None:
        self._exchange = self._new_exchange()
        self._underway: set[asyncio.Task[Presented]] = set()

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
        self._way.check_there()
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

    async def arm(
        self,
        timeout_s: float = 10.0,
        *,
        open_to: Numbers | float | None = None,
        open_to_ua: Numbers | float | None = None,
    ) -> tuple[LeaseCalibration, ...]:
        """Open the lease if none stands, check the board and enable the supply; waits for it.
        Returns the calibrations that are in force. `open_to`, `open_to_ua`: see `Display.arm`.
        """
        openings = self._openings(open_to, open_to_ua)
        taken = await self._run(self._session.arm(timeout_s))
        self._leave_out_unfelt(openings, taken)
        for made in openings:
            await self._play(course.opening(self._session, made, clock.now_ns))
        return taken

    async def arm_holder(self, timeout_s: float = 10.0) -> tuple[LeaseCalibration, ...]:
        """The operator's `arm`: arms the lease of its present holder; returns its calibrations."""
        return await self._run(self._session.arm_holder(timeout_s))

    async def disarm(self) -> None:
        await self._run(self._session.disarm())

    async def keep(self) -> None:
        """Renew the lease, without a frame."""
        await self._run(self._session.keep())

    async def show(self, levels: Numbers, **options: Unpack[FrameOptions]) -> FrameReply:
        """One frame of levels, 0..1 for each electrode."""
        return await self._run(self._session.frame(self._fields("level", levels, options)))

    async def show_current(
        self, current_ua: Numbers, **options: Unpack[FrameOptions]
    ) -> FrameReply:
        """One frame of currents, in uA for each electrode; see `Display.show_current`."""
        fields = self._fields("current_ua", current_ua, options)
        return await self._run(self._session.frame(fields))

    async def preview(self, levels: Numbers, **options: Unpack[FrameOptions]) -> FrameReply:
        """See `Display.preview`."""
        return await self._run(self._session.preview(self._fields("level", levels, options)))

    async def present(
        self,
        levels: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> Presented:
        """See `Display.present`. Cancelled, it ends silent."""
        return await self._present("level", levels, seconds, wait_s, options, None)

    async def present_current(
        self,
        current_ua: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> Presented:
        """See `Display.present_current`. Cancelled, it ends silent."""
        return await self._present("current_ua", current_ua, seconds, wait_s, options, None)

    def begin(
        self,
        levels: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> asyncio.Task[Presented]:
        """Present in a task, for 30 s at most: await it, or cancel it."""
        return self._begun("level", levels, seconds, wait_s, options)

    def begin_current(
        self,
        current_ua: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> asyncio.Task[Presented]:
        """The same for currents in uA."""
        return self._begun("current_ua", current_ua, seconds, wait_s, options)

    @contextlib.asynccontextmanager
    async def kept(self, at_most_s: float = KEPT_S) -> AsyncIterator[None]:
        """`async with display.kept(): ...` holds the lease over pauses; see `Display.kept`."""
        longest_ns = int(up_to_s("at_most_s", at_most_s, 24 * 3_600.0) * 1e9)
        keeping = asyncio.create_task(self._keep(longest_ns))
        try:
            yield
        finally:
            keeping.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await keeping

    async def play(
        self, pattern: Pattern | str | os.PathLike[str], **options: Unpack[PatternOptions]
    ) -> Played:
        """See `Display.play`. Cancelled, it ends silent."""
        playing = self._playing(options)
        async with self.telemetry("scan", "halt") as reports:

            async def listen(seconds: float) -> None:
                item = await reports.receive(seconds)
                if item is not None:
                    playing.hear(item[1])

            exchange = self._new_exchange(listen)
            try:
                course = playing_pattern(self._session, playing, pattern, options)
                return await exchange.play(course)
            finally:
                self._exchange.used_ns = exchange.used_ns
                exchange.hang_up()

    async def check_pattern(
        self, pattern: Pattern | str | os.PathLike[str], **options: Unpack[PatternOptions]
    ) -> tuple[str, ...]:
        """See `Display.check_pattern`."""
        told: list[str] = []
        await self._play(steps_to_play(self._session, pattern, options, told.append))
        return tuple(told)

    async def hold(self, levels: Numbers, seconds: float, **options: Unpack[FrameOptions]) -> None:
        """Show levels for `seconds`, then silence. Cancelled, it ends silent."""
        fields = self._fields("level", levels, options)
        await self._play(course.holding(self._session, fields, seconds, clock.now_ns))

    async def hold_current(
        self, current_ua: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> None:
        """Show currents for `seconds`, then silence. Cancelled, it ends silent."""
        fields = self._fields("current_ua", current_ua, options)
        await self._play(course.holding(self._session, fields, seconds, clock.now_ns))

    async def stream(self, levels: Numbers, **options: Unpack[FrameOptions]) -> None:
        """One frame without an answer; the newest wins. A refusal comes as telemetry `refused`."""
        await self._stream(self._fields("level", levels, options))

    async def stream_current(self, current_ua: Numbers, **options: Unpack[FrameOptions]) -> None:
        """The same for currents in uA."""
        await self._stream(self._fields("current_ua", current_ua, options))

    async def measure(self, timeout_s: float = 10.0) -> MeasureReply:
        """See `Display.measure`."""
        return await self._run(self._session.measure(timeout_s))

    async def mark(self, tag: int | str | None = None) -> MarkReply:
        """See `Display.mark`."""
        return await self._run(self._session.mark(tag))

    async def felt(self, answer: FeltAnswer, electrodes: Iterable[int] | None = None) -> FeltReply:
        """See `Display.felt`."""
        return await self._run(self._session.felt(answer, electrodes))

    async def note(self, text: str) -> None:
        """A remark in the record that is being written, if it is this user's. Raises: Refused
        (`no_record`, `not_permitted`; `busy`, after a thousand kilobytes of them).
        """
        await self._run(self._session.note(text))

    async def start_record(self, name: str) -> None:
        """See `Display.start_record`."""
        await self._run(self._session.start_record(name))

    async def stop_record(self) -> None:
        """End the record that is being written. Raises: Refused (`no_record`, `record_failed`)."""
        await self._run(self._session.stop_record())

    async def records(self) -> tuple[RecordFacts, ...]:
        """Those on the daemon's disk, with their sizes."""
        return await self._run(self._session.records())

    async def fetch_record(self, name: str, write: Callable[[bytes], object]) -> int:
        """See `Display.fetch_record`."""
        return await self._run(self._session.fetch_record(name, write))

    async def delete_record(self, name: str) -> None:
        """One of this user's. Raises: Refused (`not_found`, `not_permitted`, `wrong_state`)."""
        await self._run(self._session.delete_record(name))

    @asynccontextmanager
    async def record(self, name: str) -> AsyncIterator[None]:
        """`async with display.record("p01-block2"): ...`, as `Display.record`."""
        await self._run(self._session.start_record(name))
        try:
            yield
        except BaseException:
            with contextlib.suppress(EtdError):  # what ended the block matters more
                await self._run(self._session.end_record(name))
            raise
        await self._run(self._session.end_record(name))

    async def stop(self, why: str = "") -> None:
        """Silence at once, whichever client holds the lease and whatever is under way here."""
        exchange = self._new_exchange()
        try:
            await exchange.run(self._session.stop(why))
        finally:
            exchange.hang_up()

    async def clear(self) -> None:
        """Leave HALTED for SAFE; then `arm()` anew."""
        await self._run(self._session.clear())

    async def calibrations(self) -> tuple[str, ...]:
        return await self._run(self._session.calibrations())

    async def calibration(self, name: str) -> Calibration:
        """Raises: Refused (`not_found`)."""
        return await self._run(self._session.get_calibration(name))

    async def check_may_store(self) -> None:
        """See `Display.check_may_store`."""
        await asyncio.to_thread(self._way.check_may_store, self.facts)

    async def set_calibration(self, name: str, calibration: Calibration) -> None:
        """Store a calibration under a name; see `Display.set_calibration`."""
        await asyncio.to_thread(self._way.put_calibration, self.facts, name, calibration)

    async def delete_calibration(self, name: str) -> None:
        """See `Display.delete_calibration`."""
        await asyncio.to_thread(self._way.delete_calibration, self.facts, name)

    def telemetry(self, *topics: Topic, timeout_s: float | None = None) -> AsyncTelemetry:
        """`async with display.telemetry("scan") as reports: async for topic, report in reports`"""
        self._check_open()
        address, join_s = self._way.telemetry, self._timeout_s
        return AsyncTelemetry(self._context, address, topics, timeout_s, join_s=join_s)

    async def close(self) -> None:
        """Give the lease back (which disarms) and hang up. Idempotent."""
        if self._context.closed:
            return
        try:
            await self._run(self._session.close())
        except DaemonGone:
            pass  # there is no daemon to tell; the lease has ended with the daemon, or lapses
        finally:
            self._exchange.hang_up()
            self._hang_up()

    def _new_exchange(
        self, pause: Callable[[float], Awaitable[None]] = asyncio.sleep
    ) -> AsyncExchange:
        return AsyncExchange(self._context, self._way, self._session, pause)

    async def _present(
        self,
        kind: Kind,
        numbers: Numbers,
        seconds: float,
        wait_s: float,
        options: FrameOptions,
        after: int | None,
    ) -> Presented:
        fields = self._fields(kind, numbers, options)
        course = presenting(self._session, fields, seconds, clock.now_ns, after, wait_s)
        return await self._play(course)

    def _begun(
        self, kind: Kind, numbers: Numbers, seconds: float, wait_s: float, options: FrameOptions
    ) -> asyncio.Task[Presented]:
        up_to_s("seconds", seconds, MOST_BEGUN_S)
        up_to_s("wait_s", wait_s, MOST_BEGUN_S)
        # Whatever the program sends from now on is newer; without a lease there is nothing older.
        after = None if self._session.lease is None else self._session.numbers.newest
        task = asyncio.create_task(self._present(kind, numbers, seconds, wait_s, options, after))
        # asyncio itself refers to a task only weakly.
        self._underway.add(task)
        task.add_done_callback(self._underway.discard)
        return task

    async def _keep(self, longest_ns: int) -> None:
        """For as long as the program comes by."""
        exchange = self._new_exchange()
        try:
            while True:
                await asyncio.sleep(KEEP_S)
                has_come_by = clock.now_ns() - self._exchange.used_ns <= longest_ns
                if has_come_by and self._session.lease is not None:
                    with contextlib.suppress(EtdError):  # the program's next request says why
                        await exchange.run(self._session.keep())
        finally:
            exchange.hang_up()

    async def _stream(self, fields: dict[str, object]) -> None:
        await self._run(self._session.opened())
        data = self._session.streamed(fields)
        frames = self._frames_socket()
        if not await is_writable(frames, self._timeout_s):
            raise silent(self._way, f"no frame was taken within {self._timeout_s:g} s")
        await frames.send(data)

    async def _play(self, course: Course[R]) -> R:
        return await self._exchange.play(course)

    async def _run(self, flow: Flow[R]) -> R:
        return await self._exchange.run(flow)
