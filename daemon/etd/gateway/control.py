"""Turns a request into a command for the engine, and the engine's answer into a reply.

Owns: what each op requires (a lease, operate rights, SAFE), and its reply.
Must not know: sockets, time beyond the given `now_ns`, what the engine decides.
"""

from __future__ import annotations

import functools
import secrets
from collections.abc import Callable
from typing import Any, Final

from etd.gateway import replies
from etd.gateway.config import GatewayConfig, Operators
from etd.gateway.engine_link import EngineLink
from etd.gateway.frames import FrameHandler
from etd.gateway.inbound import InboundMessage
from etd.gateway.lease import LeaseView, StandingLease
from etd.gateway.opening import opening
from etd.gateway.pending import MAX_WAIT_NS, Done, PendingRequest, PendingRequests
from etd.gateway.records import RecordHandler
from etd.gateway.store import CalibrationStore
from etd.gateway.telemetry import Publisher
from etd.protocol.errors import Refused
from etd.protocol.facts import Endpoints
from etd.protocol.link import (
    Answer,
    ArmBoard,
    AskAccount,
    ClearHalt,
    CloseLease,
    Command,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    SayFelt,
    SetMark,
    StopNow,
)
from etd.protocol.messages import (
    AccountOf,
    Arm,
    CalibrationReply,
    Clear,
    Close,
    Disarm,
    Felt,
    FrameRequest,
    GetCalibration,
    Hello,
    Keep,
    Mark,
    Measure,
    Note,
    Open,
    Record,
    Request,
    Status,
    StatusReply,
    Stop,
    Success,
)

#: These read or write files, or list a folder of them: at a thousand, 2 ms of the processor.
SLOW: Final = (GetCalibration, Hello, Open, Record)
#: Why a lease is not one's own, or not any more.
_NOT_THE_HOLDERS: Final = ("no_lease", "other_lease")
#: A request that the engine has got: the ref of its answer, and what makes a reply of that.
_Sent = tuple[int, Done]


class ControlHandler:
    """Handles one request at a time; `id` and time of a reply are filled in when it is sent."""

    def __init__(
        self,
        config: GatewayConfig,
        operators: Operators,
        endpoints: Endpoints,
        engine: EngineLink,
        leases: LeaseView,
        frames: FrameHandler,
        publisher: Publisher,
        pending: PendingRequests,
        records: RecordHandler,
    ) -> None:
        self._config = config
        self._endpoints = endpoints
        self._engine = engine
        self._leases = leases
        self._frames = frames
        self._publisher = publisher
        self._pending = pending
        self._operators = operators
        self._records = records
        folder = config.calibrations or config.state_dir / "calibrations"
        self._store = CalibrationStore(folder, config.shipped_calibrations)
        self._handlers: dict[type, Callable[[Any, InboundMessage], Success | _Sent]] = {
            Hello: self._hello,
            Stop: self._stop,
            Open: self._open,
            Keep: self._keep,
            Close: self._close,
            Disarm: self._disarm,
            Arm: self._arm,
            Clear: self._clear,
            Measure: self._measure,
            Mark: self._mark,
            Felt: self._felt,
            AccountOf: self._account,
            GetCalibration: self._calibration,
            Record: records.handle,
            Note: records.note,
            FrameRequest: self._frame,
        }

    def handle(self, request: Request, inbound: InboundMessage, now_ns: int) -> Success | None:
        """The reply, or None if it comes from the engine later. Raises: Refused."""
        if isinstance(request, Status):
            return StatusReply(ok=True, now_ns=now_ns, status=self._publisher.state(now_ns))
        reply = self._handlers[type(request)](request, inbound)
        if isinstance(reply, Success):
            return reply
        ref, done = reply
        deadline_ns = now_ns + MAX_WAIT_NS
        is_stop = isinstance(request, Stop)
        self._pending.add(ref, PendingRequest(inbound, request.id, done, deadline_ns, is_stop))
        return None

    def _hello(self, _request: Hello, _: InboundMessage) -> Success:
        return replies.hello(
            self._engine.engine_hello(),
            name=self._config.name,
            endpoints=self._endpoints,
            calibrations=self._store.names(self._offers_shipped()),
            calibrations_folder=str(self._store.folder),
            default_calibration=self._config.default_calibration,
        )

    def _stop(self, request: Stop, inbound: InboundMessage) -> _Sent:
        """Sent even if too many requests wait for an answer already."""
        client = request.client or f"user {inbound.uid}"
        try:
            ref = self._pending.next_ref(is_stop=True)
        except Refused:
            self._engine.stop(StopNow(ref=0, client=client))
            raise
        self._engine.stop(StopNow(ref=ref, client=client))
        return ref, replies.done

    def _open(self, request: Open, inbound: InboundMessage) -> _Sent:
        self._engine.engine_hello()
        if (request.calibration is None) == (request.limits is None):
            raise Refused(
                "limits_missing" if request.limits is None else "bad_message",
                "open needs either a calibration or limits (max_current_ua and width_us)",
            )
        token = secrets.token_hex(16)
        calibrations = self._store.named(request.calibration, self._offers_shipped())
        command = opening(request, token, calibrations, self._pending.next_ref())

        def granted(answer: Answer) -> Success:
            lease = StandingLease(token, request.client, inbound.uid, calibrations, request.limits)
            self._leases.begin(lease)
            self._records.lease_begun(lease)
            return replies.leased(lease, answer)

        return self._sent(command, granted)

    def _close(self, request: Close, inbound: InboundMessage) -> _Sent:
        lease = self._held(request.lease, inbound)

        def closed(answer: Answer) -> Success:
            self._leases.end(lease, "closed")
            return replies.done(answer)

        return self._sent(CloseLease(ref=self._pending.next_ref(), lease=lease), closed)

    def _keep(self, request: Keep, inbound: InboundMessage) -> _Sent:
        lease = self._held(request.lease, inbound)
        return self._sent(KeepLease(ref=self._pending.next_ref(), lease=lease))

    def _disarm(self, request: Disarm, inbound: InboundMessage) -> _Sent:
        lease = self._held(request.lease, inbound)
        return self._sent(DisarmBoard(ref=self._pending.next_ref(), lease=lease))

    def _arm(self, _: Arm, inbound: InboundMessage) -> _Sent:
        self._operators.check(inbound.uid)
        return self._sent(ArmBoard(ref=self._pending.next_ref()), replies.armed)

    def _clear(self, _: Clear, inbound: InboundMessage) -> _Sent:
        self._operators.check(inbound.uid)
        return self._sent(ClearHalt(ref=self._pending.next_ref()))

    def _measure(self, request: Measure, inbound: InboundMessage) -> _Sent:
        # It puts the supply on, and fires at every electrode.
        self._operators.check(inbound.uid)
        lease = self._held(request.lease, inbound)
        command = MeasureContact(ref=self._pending.next_ref(), lease=lease)
        return self._sent(command, replies.measured)

    def _mark(self, request: Mark, inbound: InboundMessage) -> _Sent:
        lease = self._held(request.lease, inbound)
        command = SetMark(ref=self._pending.next_ref(), lease=lease, tag=request.tag)
        return self._sent(command, replies.marked)

    def _felt(self, request: Felt, inbound: InboundMessage) -> _Sent:
        """With the lease, anything; without it, or with one that has ended, only what lowers."""
        lease = None
        if request.lease is not None:
            try:
                lease = self._held(request.lease, inbound)
            except Refused as refused:
                if request.answer != "too_strong" or refused.code not in _NOT_THE_HOLDERS:
                    raise
        command = SayFelt(
            ref=self._pending.next_ref(),
            answer=request.answer,
            electrodes=request.electrodes,
            lease=lease,
        )
        return self._sent(command, replies.heard)

    def _account(self, request: AccountOf, inbound: InboundMessage) -> _Sent:
        """Also of the lease that ended last: what was fired until then can still be asked for."""
        if not self._leases.has_ended(request.lease, inbound.uid):
            self._held(request.lease, inbound)
        command = AskAccount(ref=self._pending.next_ref(), lease=request.lease, seq=request.seq)
        return self._sent(command, replies.accounted)

    def _frame(self, request: FrameRequest, inbound: InboundMessage) -> _Sent:
        lease = self._frames.check(request, inbound.uid)
        ref = self._pending.next_ref()
        self._frames.pass_on(request, lease, ref)
        return ref, functools.partial(replies.framed, request.seq)

    def _calibration(self, request: GetCalibration, _: InboundMessage) -> Success:
        calibration = None
        if request.do == "get":
            if request.name is None:
                raise Refused("bad_message", "calibration with do = get needs the key name")
            calibration = self._store.get(request.name, self._offers_shipped())
        names = self._store.names(self._offers_shipped())
        return CalibrationReply(ok=True, now_ns=0, names=names, calibration=calibration)

    def _sent(self, command: Command, done: Done = replies.done) -> _Sent:
        self._engine.command(command)
        return command.ref, done

    def _held(self, token: str, inbound: InboundMessage) -> str:
        """The lease named, if it stands. Raises: Refused (`engine_gone`, `halted`, the lease's)."""
        self._engine.engine_hello()
        self._engine.check_not_halted()
        return self._leases.check(token, inbound.uid).token

    def _offers_shipped(self) -> bool:
        """The shipped calibrations are for the fake's body: never for a real board."""
        return self._engine.is_there and self._engine.engine_hello().board.backend == "fake"
