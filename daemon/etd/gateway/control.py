"""Turns a request into a command for the engine, and the engine's answer into a reply.

Owns: what each op requires (a lease, operate rights, SAFE), and its reply.
Must not know: sockets, time beyond the given `now_ns`, what the engine decides.
"""

from __future__ import annotations

import functools
import secrets
from collections.abc import Callable
from typing import Any

from etd.gateway import replies
from etd.gateway.config import GatewayConfig
from etd.gateway.engine_link import EngineLink
from etd.gateway.frames import FrameHandler
from etd.gateway.inbound import InboundMessage
from etd.gateway.lease import LeaseView
from etd.gateway.pending import MAX_WAIT_NS, PendingRequest, PendingRequests
from etd.gateway.store import CalibrationStore
from etd.gateway.telemetry import Publisher
from etd.protocol.errors import Refused
from etd.protocol.link import (
    Answer,
    ArmBoard,
    ClearHalt,
    CloseLease,
    Command,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    OpenLease,
    SetMark,
    StopNow,
)
from etd.protocol.messages import (
    Arm,
    CalibrationReply,
    Clear,
    Close,
    Disarm,
    Endpoints,
    FrameRequest,
    GetCalibration,
    Hello,
    Keep,
    Mark,
    Measure,
    Open,
    Request,
    Status,
    StatusReply,
    Stop,
    Success,
)


class ControlHandler:
    """Handles one request at a time. None: the reply follows when the engine has answered."""

    def __init__(
        self,
        config: GatewayConfig,
        operators: frozenset[int] | None,
        endpoints: Endpoints,
        engine: EngineLink,
        leases: LeaseView,
        frames: FrameHandler,
        publisher: Publisher,
        pending: PendingRequests,
    ) -> None:
        self._config = config
        self._endpoints = endpoints
        self._engine = engine
        self._leases = leases
        self._frames = frames
        self._publisher = publisher
        self._pending = pending
        self._operators = operators
        self._store = CalibrationStore(config.state_dir, config.shipped_calibrations)
        self._handlers: dict[type, Callable[[Any, InboundMessage, int], Success | None]] = {
            Hello: self._hello,
            Status: self._status,
            Stop: self._stop,
            Open: self._open,
            Keep: self._keep,
            Close: self._close,
            Disarm: self._disarm,
            Arm: self._arm,
            Clear: self._clear,
            Measure: self._measure,
            Mark: self._mark,
            GetCalibration: self._calibration,
            FrameRequest: self._frame,
        }

    def handle(self, request: Request, inbound: InboundMessage, now_ns: int) -> Success | None:
        """The reply, or None if it comes from the engine later. Raises: Refused."""
        return self._handlers[type(request)](request, inbound, now_ns)

    def _hello(self, request: Hello, _: InboundMessage, now_ns: int) -> Success:
        return replies.hello(
            request,
            now_ns,
            self._engine.engine_hello(),
            name=self._config.name,
            endpoints=self._endpoints,
            calibrations=self._store.names(self._offers_shipped()),
            default_calibration=self._config.default_calibration,
        )

    def _status(self, request: Status, _: InboundMessage, now_ns: int) -> Success:
        status = self._publisher.state(now_ns)
        return StatusReply(ok=True, now_ns=now_ns, id=request.id, status=status)

    def _stop(self, request: Stop, inbound: InboundMessage, now_ns: int) -> None:
        """Sent even if too many requests wait for an answer already."""
        client = request.client or f"user {inbound.uid}"
        try:
            ref = self._pending.next_ref(is_stop=True)
        except Refused:
            self._engine.stop(StopNow(ref=0, client=client))
            raise
        self._engine.stop(StopNow(ref=ref, client=client))
        self._await(ref, request, inbound, now_ns, replies.done(request.id), is_stop=True)

    def _open(self, request: Open, inbound: InboundMessage, now_ns: int) -> None:
        self._engine.engine_hello()
        if (request.calibration is None) == (request.limits is None):
            raise Refused(
                "limits_missing" if request.limits is None else "bad_message",
                "open needs either a calibration or limits (max_current_ua and width_us)",
            )
        token = secrets.token_hex(16)
        name = request.calibration
        command = OpenLease(
            ref=self._pending.next_ref(),
            lease=token,
            client=request.client,
            calibration=self._store.get(name, self._offers_shipped()) if name else None,
            limits=request.limits,
        )

        def granted(_: Answer) -> Success:
            self._leases.begin(token, request.client, inbound.uid)
            return replies.granted(request.id, token)

        self._send_command(command, request, inbound, now_ns, granted)

    def _keep(self, request: Keep, inbound: InboundMessage, now_ns: int) -> None:
        lease = self._held(request.lease, inbound)
        self._send_command(
            KeepLease(ref=self._pending.next_ref(), lease=lease), request, inbound, now_ns
        )

    def _close(self, request: Close, inbound: InboundMessage, now_ns: int) -> None:
        lease = self._held(request.lease, inbound)

        def closed(_: Answer) -> Success:
            self._leases.end(lease, "closed")
            return Success(ok=True, now_ns=0, id=request.id)

        command = CloseLease(ref=self._pending.next_ref(), lease=lease)
        self._send_command(command, request, inbound, now_ns, closed)

    def _disarm(self, request: Disarm, inbound: InboundMessage, now_ns: int) -> None:
        lease = self._held(request.lease, inbound)
        self._send_command(
            DisarmBoard(ref=self._pending.next_ref(), lease=lease), request, inbound, now_ns
        )

    def _arm(self, request: Arm, inbound: InboundMessage, now_ns: int) -> None:
        self._check_operator(inbound)
        self._send_command(ArmBoard(ref=self._pending.next_ref()), request, inbound, now_ns)

    def _clear(self, request: Clear, inbound: InboundMessage, now_ns: int) -> None:
        self._check_operator(inbound)
        self._send_command(ClearHalt(ref=self._pending.next_ref()), request, inbound, now_ns)

    def _measure(self, request: Measure, inbound: InboundMessage, now_ns: int) -> None:
        command = MeasureContact(
            ref=self._pending.next_ref(), lease=self._held(request.lease, inbound)
        )
        self._send_command(
            command, request, inbound, now_ns, functools.partial(replies.measured, request.id)
        )

    def _mark(self, request: Mark, inbound: InboundMessage, now_ns: int) -> None:
        command = SetMark(
            ref=self._pending.next_ref(),
            lease=self._held(request.lease, inbound),
            tag=request.tag,
        )
        self._send_command(
            command, request, inbound, now_ns, functools.partial(replies.marked, request.id)
        )

    def _frame(self, request: FrameRequest, inbound: InboundMessage, now_ns: int) -> None:
        lease = self._frames.check(request, inbound.uid)
        ref = self._pending.next_ref()
        self._frames.pass_on(request, lease, ref)
        done = functools.partial(replies.framed, request.id, request.seq)
        self._await(ref, request, inbound, now_ns, done)

    def _calibration(
        self, request: GetCalibration, inbound: InboundMessage, now_ns: int
    ) -> Success:
        calibration = None
        if request.do == "get":
            calibration = self._store.get(_name_of(request), self._offers_shipped())
        elif request.do == "set":
            self._set_calibration(request, inbound)
        elif request.do == "delete":
            self._check_operator(inbound)
            self._store.delete(_name_of(request))
        return CalibrationReply(
            ok=True,
            now_ns=now_ns,
            id=request.id,
            names=self._store.names(self._offers_shipped()),
            calibration=calibration,
        )

    def _set_calibration(self, request: GetCalibration, inbound: InboundMessage) -> None:
        self._check_operator(inbound)
        engine_hello = self._engine.engine_hello()
        if request.calibration is None:
            raise Refused("bad_message", "calibration with do = set needs the key calibration")
        state = self._engine.state
        if state is None or state.state != "SAFE":
            raise Refused(
                "wrong_state",
                f"a calibration can be set in SAFE only; the state is"
                f" {state.state if state else 'not known'}: disarm first",
            )
        replies.check_fits(request.calibration, engine_hello)
        self._store.put(_name_of(request), request.calibration)

    def _send_command(
        self,
        command: Command,
        request: Request,
        inbound: InboundMessage,
        now_ns: int,
        done: Callable[[Answer], Success] | None = None,
    ) -> None:
        self._engine.command(command)
        self._await(command.ref, request, inbound, now_ns, done or replies.done(request.id))

    def _await(
        self,
        ref: int,
        request: Request,
        inbound: InboundMessage,
        now_ns: int,
        done: Callable[[Answer], Success],
        is_stop: bool = False,
    ) -> None:
        self._pending.add(
            ref, PendingRequest(inbound, request.id, done, now_ns + MAX_WAIT_NS, is_stop)
        )

    def _held(self, token: str, inbound: InboundMessage) -> str:
        """The lease named, if it stands. Raises: Refused (`engine_gone` and the lease's)."""
        self._engine.engine_hello()
        return self._leases.check(token, inbound.uid).token

    def _check_operator(self, inbound: InboundMessage) -> None:
        """Raises: Refused (`not_permitted`)."""
        if self._operators is not None and inbound.uid not in self._operators:
            raise Refused(
                "not_permitted",
                f"user {inbound.uid} has no operate rights: only users listed as operators in the"
                " configuration have them",
            )

    def _offers_shipped(self) -> bool:
        """The shipped calibrations are for the fake's body: never for a real board."""
        return self._engine.is_there and self._engine.engine_hello().board.backend == "fake"


def _name_of(request: GetCalibration) -> str:
    if request.name is None:
        raise Refused("bad_message", f"calibration with do = {request.do} needs the key name")
    return request.name
