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
from etd.gateway.pending import (
    MAX_WAIT_NS,
    Awaited,
    Done,
    Kind,
    PendingRequest,
    PendingRequests,
)
from etd.gateway.readings import CalibrationReadings
from etd.gateway.records import RecordHandler
from etd.gateway.stops import Stops
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

#: These look at files or write them, or list a folder: at a thousand, 2 ms of the processor.
SLOW: Final = (GetCalibration, Hello, Open, Record)
#: These do nothing for a client that has left: their reply is all, and a lease has its token in it.
ONLY_REPLIES: Final = (AccountOf, GetCalibration, Hello, Open, Status)
#: Why a lease is not one's own, or not any more.
_NOT_THE_HOLDERS: Final = ("no_lease", "other_lease")


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
        stops: Stops,
        store: CalibrationStore,
        readings: CalibrationReadings,
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
        self._stops = stops
        self._store = store
        self._readings = readings
        self._handlers: dict[type, Callable[[Any, InboundMessage], Success | Awaited]] = {
            Hello: self._hello,
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
        if isinstance(request, Stop):
            self._stops.ask(request, inbound, now_ns)
            return None
        reply = self._handlers[type(request)](request, inbound)
        if isinstance(reply, Success):
            return reply
        deadline_ns = now_ns + MAX_WAIT_NS
        pending = PendingRequest(inbound, request.id, reply.done, deadline_ns, reply.kind)
        self._pending.add(reply.ref, pending)
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

    def _open(self, request: Open, inbound: InboundMessage) -> Success | Awaited:
        self._engine.engine_hello()
        if (request.calibration is None) == (request.limits is None):
            raise Refused(
                "limits_missing" if request.limits is None else "bad_message",
                "open needs either a calibration or limits (max_current_ua and width_us)",
            )
        names = _names_of(request.calibration)
        return self._once_read(names, inbound, lambda: self._opened(request, inbound))

    def _opened(self, request: Open, inbound: InboundMessage) -> Success | Awaited:
        """Once its calibrations were read."""
        token = secrets.token_hex(16)
        names = _names_of(request.calibration)
        calibrations = self._store.named(names, self._offers_shipped())
        command = opening(request, token, calibrations, self._pending.next_ref_of(inbound.uid))

        def granted(answer: Answer) -> Success:
            lease = StandingLease(token, request.client, inbound.uid, calibrations, request.limits)
            self._leases.begin(lease)
            self._records.lease_begun(lease)
            return replies.leased(lease, answer)

        return self._sent(command, granted)

    def _close(self, request: Close, inbound: InboundMessage) -> Awaited:
        lease = self._held(request.lease, inbound)

        def closed(answer: Answer) -> Success:
            self._leases.end(lease, "closed")
            return replies.done(answer)

        return self._sent(
            CloseLease(ref=self._pending.next_ref_of(inbound.uid), lease=lease), closed
        )

    def _keep(self, request: Keep, inbound: InboundMessage) -> Awaited:
        lease = self._held(request.lease, inbound)
        return self._sent(KeepLease(ref=self._pending.next_ref_of(inbound.uid), lease=lease))

    def _disarm(self, request: Disarm, inbound: InboundMessage) -> Awaited:
        lease = self._held(request.lease, inbound)
        return self._sent(DisarmBoard(ref=self._pending.next_ref_of(inbound.uid), lease=lease))

    def _arm(self, _: Arm, inbound: InboundMessage) -> Awaited:
        self._operators.check(inbound.uid)
        return self._sent(ArmBoard(ref=self._pending.next_ref_of(inbound.uid)), replies.armed)

    def _clear(self, _: Clear, inbound: InboundMessage) -> Awaited:
        self._operators.check(inbound.uid)
        command = ClearHalt(
            ref=self._pending.next_ref_of(inbound.uid),
            uid=inbound.uid,
            is_operator=self._operators.is_one(inbound.uid),
        )
        return self._sent(command)

    def _measure(self, request: Measure, inbound: InboundMessage) -> Awaited:
        # It puts the supply on, and fires at every electrode.
        self._operators.check(inbound.uid)
        lease = self._held(request.lease, inbound)
        command = MeasureContact(ref=self._pending.next_ref_of(inbound.uid), lease=lease)
        return self._sent(command, replies.measured)

    def _mark(self, request: Mark, inbound: InboundMessage) -> Awaited:
        lease = self._held(request.lease, inbound)
        command = SetMark(ref=self._pending.next_ref_of(inbound.uid), lease=lease, tag=request.tag)
        return self._sent(command, replies.marked)

    def _felt(self, request: Felt, inbound: InboundMessage) -> Awaited:
        """With the lease, anything; without it, or with one that has ended, only what lowers."""
        lease = None
        if request.lease is not None:
            try:
                lease = self._held(request.lease, inbound)
            except Refused as refused:
                if request.answer != "too_strong" or refused.code not in _NOT_THE_HOLDERS:
                    raise
        kind: Kind = "too_strong" if request.answer == "too_strong" else "engine"
        command = SayFelt(
            ref=self._pending.next_ref_of(inbound.uid, kind),
            answer=request.answer,
            electrodes=request.electrodes,
            lease=lease,
        )
        return self._sent(command, replies.heard, kind)

    def _account(self, request: AccountOf, inbound: InboundMessage) -> Awaited:
        """Also of the lease that ended last: what was fired until then can still be asked for."""
        if not self._leases.has_ended(request.lease, inbound.uid):
            self._held(request.lease, inbound)
        ref = self._pending.next_ref_of(inbound.uid, "account")
        command = AskAccount(ref=ref, lease=request.lease, seq=request.seq)
        return self._sent(command, replies.accounted, "account")

    def _frame(self, request: FrameRequest, inbound: InboundMessage) -> Awaited:
        lease = self._frames.check(request, inbound.uid)
        ref = self._pending.next_ref_of(inbound.uid)
        self._frames.pass_on(request, lease, ref)
        return Awaited(ref, functools.partial(replies.framed, request.seq))

    def _calibration(self, request: GetCalibration, inbound: InboundMessage) -> Success | Awaited:
        if request.do == "list":
            return self._named(None)
        if request.name is None:
            raise Refused("bad_message", "calibration with do = get needs the key name")
        name = request.name
        return self._once_read((name,), inbound, lambda: self._named(name))

    def _named(self, name: str | None) -> CalibrationReply:
        """All names, and the calibration of one of them."""
        with_shipped = self._offers_shipped()
        calibration = None if name is None else self._store.get(name, with_shipped)
        names = self._store.names(with_shipped)
        return CalibrationReply(ok=True, now_ns=0, names=names, calibration=calibration)

    def _once_read(
        self, names: tuple[str, ...], inbound: InboundMessage, done: Callable[[], Success | Awaited]
    ) -> Success | Awaited:
        """At once, where all of them were read and are as they were."""
        unread = self._store.unread(names, self._offers_shipped())
        if not unread:
            return done()
        ref = self._pending.next_ref_of(inbound.uid, "reading")
        self._readings.ask(ref, inbound.uid, unread)
        return Awaited(ref, lambda _: done(), "reading")

    def _sent(self, command: Command, done: Done = replies.done, kind: Kind = "engine") -> Awaited:
        self._engine.command(command)
        return Awaited(command.ref, done, kind)

    def _held(self, token: str, inbound: InboundMessage) -> str:
        """The lease named, if it stands. Raises: Refused (`engine_gone`, `halted`, the lease's)."""
        self._engine.engine_hello()
        self._engine.check_not_halted()
        return self._leases.check(token, inbound.uid).token

    def _offers_shipped(self) -> bool:
        """The shipped calibrations are for the fake's body: never for a real board."""
        return self._engine.is_there and self._engine.engine_hello().board.backend == "fake"


def _names_of(calibration: str | tuple[str, ...] | None) -> tuple[str, ...]:
    return (calibration,) if isinstance(calibration, str) else calibration or ()
