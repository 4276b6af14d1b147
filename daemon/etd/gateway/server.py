"""The gateway's loop: one step reads every socket, stops first, and never waits for a client.

Owns: the order within a step, what is due when, and that every request is answered once.
Must not know: what an op means (control), what a frame is (frames).
"""

from __future__ import annotations

import dataclasses
import os
from collections import Counter

import msgspec

from etd.files.calibration_process import CalibrationProcess, CalibrationReader
from etd.files.exclusive import NameLock
from etd.files.paths import check_name, prepare_runtime
from etd.gateway.config import GatewayConfig, Operators
from etd.gateway.control import ONLY_REPLIES, SLOW, ControlHandler
from etd.gateway.engine_link import EngineLink
from etd.gateway.frames import FrameHandler
from etd.gateway.inbound import InboundMessage, Unreadable
from etd.gateway.journal import Journal
from etd.gateway.last_frames import LastFrames
from etd.gateway.lease import LeaseView
from etd.gateway.pending import PendingRequest, PendingRequests
from etd.gateway.readings import CalibrationReadings
from etd.gateway.record_file import Disk
from etd.gateway.record_store import RecordStore
from etd.gateway.recorder import ReadClocks, Recorder
from etd.gateway.records import RecordHandler
from etd.gateway.request_queue import RequestQueue
from etd.gateway.sockets import Sockets
from etd.gateway.stops import Stops
from etd.gateway.store import CalibrationStore
from etd.gateway.streams import Streams
from etd.gateway.telemetry import Publisher
from etd.gateway.wall_clock import read_clocks
from etd.protocol.errors import FileError, Refused, Undecodable
from etd.protocol.link import ALIVE_NS, Answer, EngineHello, LeaseEnded, Report
from etd.protocol.messages import Failure, FrameRequest, Id, Request, Success
from etd_hal.ports import Clock

#: Of the requests, at most this many are read in one turn; and none is handled after so many bytes.
REQUESTS_A_TURN = 64
BYTES_A_TURN = 16_384
#: While there is no engine, the gateway tries to connect this often.
CONNECT_NS = 200_000_000
#: While a calibration is read, it is looked so often whether that is done.
_READING_MS = 5
_TOO_LATE = (
    "there was no answer within 15 s, of the engine or from the reading of a calibration: ask again"
)
_ENDED = "the engine ended before it answered"
#: At its end the gateway waits so long for a slow disk to take the end of a record.
_LAST_LINES_S = 2.0

_encoder = msgspec.json.Encoder()


class Gateway:
    """Bound when made; call `step` until `close`. One thread.

    Raises, when made: AlreadyRunning, FileError (configuration).
    """

    def __init__(
        self,
        config: GatewayConfig,
        clock: Clock,
        read_clocks: ReadClocks = read_clocks,
        disk: Disk | None = None,
        reader: CalibrationReader | None = None,
    ) -> None:
        """`read_clocks`: the wall's time beside `clock`. `disk`: that records are on. `reader`: of
        calibrations; None: a process for each.
        """
        check_name(config.name)
        operators = Operators(config.operators)
        prepare_runtime(config.runtime_folder)
        self._clock = clock
        #: Then the engine's end is no event: as a rule it was asked as well.
        self.is_asked_to_end = False
        self._lock = NameLock(config.runtime_folder, config.name)
        try:
            self._sockets = Sockets(config.runtime_folder)
        except BaseException:
            self._lock.close()
            raise
        self._requests = RequestQueue(self._sockets)
        self.counters: Counter[str] = Counter()
        self._engine = EngineLink(config.runtime_folder, self.counters)
        self._leases = LeaseView()
        self._pending = PendingRequests()
        store = RecordStore(config.state_dir, disk)
        shown = LastFrames()
        self._recorder = Recorder(
            config.name, store, self._leases, shown, read_clocks, self._engine.record_pulses
        )
        self._publisher = Publisher(
            self._sockets.telemetry, self._engine, self.counters, self._recorder
        )
        folder = config.calibrations or config.state_dir / "calibrations"
        calibrations = CalibrationStore(folder, config.shipped_calibrations)
        reader = reader or CalibrationProcess(folder, config.shipped_calibrations, None)
        self._readings = CalibrationReadings(reader, calibrations.read, self._pending.has)
        self._stops = Stops(self._engine, self._pending)
        frames = FrameHandler(self._engine, self._leases, shown)
        self._streams = Streams(self._sockets.frames, frames, self.counters, self._record_streamed)
        self._records = records = RecordHandler(
            store, self._recorder, self._engine, self._pending, clock, operators
        )
        self._control = ControlHandler(
            config,
            operators,
            self._sockets.endpoints,
            self._engine,
            self._leases,
            frames,
            self._publisher,
            self._pending,
            records,
            self._stops,
            calibrations,
            self._readings,
        )
        self._journal = Journal(config.name)
        self._alive_due_ns = 0
        self._connect_due_ns = 0
        if config.record is not None:
            self._begin_record(records, config.record)

    def step(self, timeout_ms: int = 50) -> None:
        """Wait at most `timeout_ms` for a message, then handle what arrived."""
        self._wait(timeout_ms if self._readings.is_idle else min(timeout_ms, _READING_MS))
        self._stay_in_touch()
        self._answer_requests()
        self._hear_engine()
        self._pass_on_frames()
        now_ns = self._clock.now_ns()
        self._give_up_late(now_ns)
        self.counters.update(self._sockets.take_counts())
        self._recorder.look(now_ns)
        for answer in (*self._records.written(now_ns), *self._readings.answers(now_ns)):
            self._settle(answer)
        self._publisher.repeat_state(now_ns)
        recorder = self._recorder
        self._journal.record(recorder.running, recorder.problem, recorder.uid)
        self._journal.lease(self._leases.standing)
        self._journal.refusals(self.counters, now_ns)

    def close(self) -> None:
        """Idempotent. The engine sees the link end and falls silent."""
        self._recorder.stop("ended", self._clock.now_ns())
        self._readings.close()
        self._engine.hang_up()
        self._sockets.close()
        # Last: this blocks, and by now the link and the sockets are closed.
        self._recorder.wait_closed(_LAST_LINES_S)
        self._lock.close()
        if self.is_asked_to_end:
            self._journal.asked_to_end()
        self._journal.close()

    def _wait(self, timeout_ms: int) -> None:
        if not self._requests.is_idle:
            timeout_ms = 0
        due_ns = self._alive_due_ns if self._engine.is_connected else self._connect_due_ns
        left_ms = max(0, -((self._clock.now_ns() - due_ns) // 1_000_000))
        self._sockets.wait(self._engine.filenos(), min(timeout_ms, left_ms))

    def _stay_in_touch(self) -> None:
        """The engine must hear from its gateway, however much there is to read."""
        now_ns = self._clock.now_ns()
        if self._engine.has_ended:
            self._lose_engine(now_ns)
        if not self._engine.is_connected and now_ns >= self._connect_due_ns:
            self._connect_due_ns = now_ns + CONNECT_NS
            self._engine.try_connect()
        if self._engine.is_connected and now_ns >= self._alive_due_ns:
            self._alive_due_ns = now_ns + ALIVE_NS
            self._engine.stay_alive()

    def _answer_requests(self) -> None:
        """Stops are looked for before each other request, and the engine's answer to one after it.
        A slow one is the last of its turn, so is a long one, and of a flood only so much is read:
        frames and subscribers do not wait for it. A stop that came meanwhile goes before them.
        """
        most, left_bytes = self._requests.read + REQUESTS_A_TURN, BYTES_A_TURN
        for _ in range(REQUESTS_A_TURN):
            self._heed_stops()
            waiting = self._requests.take()
            if waiting is None:
                return
            if self._is_for_nothing(*waiting):
                self.counters["left_before_the_reply"] += 1
                continue
            self._answer(*waiting)
            self._stay_in_touch()
            self._hear_engine()
            left_bytes -= len(waiting[1].data)
            is_over = left_bytes <= 0 or self._requests.read >= most
            if is_over or isinstance(waiting[0], SLOW):
                self._heed_stops()
                return

    def _is_for_nothing(self, request: Request | Unreadable, inbound: InboundMessage) -> bool:
        """A client that has left may have sent thousands."""
        is_answered = self._sockets.control.is_heard_by(inbound.connection)
        return isinstance(request, ONLY_REPLIES) and not is_answered

    def _heed_stops(self) -> None:
        """A stop is sent before any other request is handled or refused."""
        refused = self._requests.look()
        while (stop := self._requests.take_stop()) is not None:
            self._answer(*stop)
            self._stay_in_touch()
        for refusal, id_of_it, inbound in refused:
            self.counters[f"refused_{refusal.code}"] += 1
            self._refuse(inbound, id_of_it, refusal)

    def _answer(self, request: Request | Unreadable, inbound: InboundMessage) -> None:
        if isinstance(request, Unreadable):
            self.counters["malformed"] += 1
            self._refuse(inbound, request.id, request)
            return
        now_ns = self._clock.now_ns()
        self._recorder.asked(request, inbound, now_ns)
        self._journal.asked(request, inbound)
        try:
            reply = self._control.handle(request, inbound, now_ns)
        except Refused as refusal:
            self.counters[f"refused_{refusal.code}"] += 1
            self._refuse(inbound, request.id, refusal)
        else:
            if reply is not None:
                self._reply(inbound, request.id, reply)

    def _hear_engine(self) -> None:
        for message in self._engine.receive():
            now_ns = self._clock.now_ns()
            try:
                self._recorder.heard(message, now_ns)
            except Undecodable:
                self._engine.break_off()
                break
            if isinstance(message, Answer):
                self._settle(message)
            elif isinstance(message, LeaseEnded):
                self._leases.end(message.lease, message.reason)
            elif isinstance(message, EngineHello):
                self._journal.engine_found(message)
            elif isinstance(message, Report):
                if message.state is not None:
                    self._journal.state(message.state, self._leases.standing)
                self._publisher.pass_on(message, now_ns)
        if self._engine.has_ended:
            self._lose_engine(self._clock.now_ns())

    def _settle(self, answer: Answer) -> None:
        pending = self._pending.take(answer.ref)
        if pending is None:
            self.counters["answers_too_late"] += 1
            return
        if pending.kind == "stop":
            self._stops.answered(answer.ref)
        try:
            if answer.error is not None:
                raise Refused(
                    answer.error,
                    answer.reason,
                    answer.electrode,
                    answer.achievable_hz,
                    answer.bound_by,
                )
            reply = pending.done(answer)
        except Refused as refusal:
            for inbound, id_of_it in pending.all_of_them:
                self._refuse(inbound, id_of_it, refusal)
            return
        if isinstance(reply, Success):
            for inbound, id_of_it in pending.all_of_them:
                self._reply(inbound, id_of_it, reply)
        else:
            follows = dataclasses.replace(pending, done=reply.done, kind=reply.kind)
            self._pending.add(reply.ref, follows)

    def _pass_on_frames(self) -> None:
        refusals = self._streams.drain()
        if refusals:
            for report in self._publisher.refused_stream(refusals, self._clock.now_ns()):
                self._recorder.refused_stream(report, report.now_ns)

    def _record_streamed(self, frame: FrameRequest, uid: int | None) -> None:
        self._recorder.streamed(frame, uid, self._clock.now_ns())

    def _begin_record(self, records: RecordHandler, name: str) -> None:
        """Raises: FileError."""
        try:
            records.start(name, os.geteuid())
        except Refused as refusal:
            self.close()
            raise FileError("--record", "", refusal.reason, "a name that is free") from None

    def _lose_engine(self, now_ns: int) -> None:
        if self._engine.is_there and not self.is_asked_to_end:
            self._journal.engine_lost(is_cut_off=self._engine.is_cut_off)
        self._recorder.engine_gone(now_ns)
        self._engine.hang_up()
        self._leases.reset()
        self._publisher.drop_engine()
        why = self._engine.why_gone if self._engine.is_cut_off else _ENDED
        self._give_up_on(self._pending.take_all(), why)
        self._publisher.publish_state(now_ns)

    def _give_up_late(self, now_ns: int) -> None:
        """An engine that has not answered a stop in time is cut off, which stops as well."""
        late = self._pending.take_late(now_ns)
        stops = [request for request in late if request.kind == "stop"]
        self._give_up_on([request for request in late if request.kind != "stop"], _TOO_LATE)
        if stops:
            self._give_up_on(stops, self._engine.cut_off())

    def _give_up_on(self, pending: list[PendingRequest], why: str) -> None:
        for request in pending:
            for inbound, id_of_it in request.all_of_them:
                self.counters["refused_engine_gone"] += 1
                self._refuse(inbound, id_of_it, Refused("engine_gone", why))

    def _refuse(self, inbound: InboundMessage, id: Id | None, refusal: Refused) -> None:  # noqa: A002
        failure = Failure(ok=False, now_ns=self._clock.now_ns(), id=id, **refusal.fields)
        self._send(inbound, failure)

    def _reply(self, inbound: InboundMessage, id: Id | None, reply: Success) -> None:  # noqa: A002
        self._send(inbound, msgspec.structs.replace(reply, now_ns=self._clock.now_ns(), id=id))

    def _send(self, inbound: InboundMessage, reply: Success | Failure) -> None:
        """A client that has left, or that does not read, is counted."""
        self._recorder.replied(inbound, reply, self._clock.now_ns())
        self._journal.replied(inbound, is_done=reply.ok)
        parts = (*inbound.route, _encoder.encode(reply))
        if not self._sockets.control.reply(inbound.connection, parts):
            self.counters["replies_not_delivered"] += 1
