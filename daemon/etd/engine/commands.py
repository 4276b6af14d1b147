"""What the gateway may ask of the engine, and the answer to each.

Owns: the meaning of every command and frame of the link. Must not know: sockets, ZeroMQ, how a
pulse is made. A command that is refused changes nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from etd.engine.lease import Lease, check_holder, check_seq
from etd.engine.limits import limits_of_calibration, limits_of_numbers
from etd.errors import Refused
from etd.link import (
    Alive,
    Answer,
    ArmBoard,
    ClearHalt,
    CloseLease,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    NewFrame,
    OpenLease,
    SetMark,
    StopNow,
    ToEngine,
)
from etd.protocol import RefusedReport

if TYPE_CHECKING:
    from etd.engine.engine import Engine

#: A client on this machine reads the same clock; more than this ahead is not that clock.
_AHEAD_NS = 100_000_000


def obey(engine: Engine, command: ToEngine, now_ns: int) -> None:
    """Carry out one command and answer it, unless its answer comes later (arm, measure)."""
    try:
        answer = _done(engine, command, now_ns)
    except Refused as refusal:
        answer = refused(command.ref, refusal)
    if answer is not None and command.ref:
        engine.answer(answer)


def refused(ref: int, refusal: Refused) -> Answer:
    """The answer to what was not accepted."""
    return Answer(
        ref=ref,
        error=refusal.code,
        reason=refusal.reason,
        electrode=refusal.electrode,
        achievable_hz=refusal.achievable_hz,
    )


def _done(engine: Engine, command: ToEngine, now_ns: int) -> Answer | None:
    """Raises: Refused."""
    match command:
        case Alive():
            return None
        case StopNow(who=who):
            engine.halt("stop", who, "asked to stop")
        case OpenLease():
            _open(engine, command, now_ns)
        case KeepLease(lease=token):
            check_holder(engine.lease, token).renew(now_ns)
        case CloseLease(lease=token):
            check_holder(engine.lease, token)
            engine.end_lease("closed")
        case DisarmBoard(lease=token):
            check_holder(engine.lease, token)
            engine.make_safe("disarmed")
        case ArmBoard():
            engine.energize("arm", command.ref)
            return None
        case MeasureContact(lease=token):
            check_holder(engine.lease, token)
            engine.energize("measure", command.ref)
            return None
        case ClearHalt():
            engine.clear()
        case SetMark(lease=token):
            check_holder(engine.lease, token)
            return _mark(engine, command, now_ns)
    return Answer(ref=command.ref)


def _open(engine: Engine, command: OpenLease, now_ns: int) -> None:
    engine.states.need("SAFE")
    if engine.lease is not None:
        raise Refused("other_lease", f"the lease is held by {engine.lease.client!r}")
    loaded = engine.loaded
    if command.calibration is not None:
        person = limits_of_calibration(
            command.calibration,
            engine.maxima,
            loaded.array.name,
            loaded.array.count,
            loaded.body_site.name,
        )
    elif command.limits is not None:
        person = limits_of_numbers(command.limits, engine.maxima, loaded.array.count)
    else:
        raise Refused("limits_missing", "open with a calibration or with limits")
    lease = Lease(command.lease, command.client, person, 0)
    lease.renew(now_ns)
    engine.begin_lease(lease)


def _mark(engine: Engine, command: SetMark, now_ns: int) -> Answer:
    engine.marker.mark("mark", -1, command.tag)
    return Answer(ref=command.ref, marked_ns=now_ns, sync=engine.board.sync())


def take_frame(engine: Engine, message: NewFrame, now_ns: int) -> None:
    """Plan a frame, and show it from the next scan on; or say why not."""
    frame = message.frame
    try:
        lease = check_holder(engine.lease, frame.lease)
        check_seq(lease, frame.seq)
        engine.states.need("ARMED")
        begun_ns = _age_from(frame.sent_ns, now_ns)
        expires_ns = begun_ns + frame.ttl_ms * 1_000_000
        if now_ns >= expires_ns:
            raise Refused(
                "expired",
                f"sent {(now_ns - begun_ns) // 1_000_000} ms ago, its ttl is {frame.ttl_ms} ms",
            )
        plan = engine.planner.plan(frame, engine.contact.largest_share(0))
    except Refused as refusal:
        _tell_refusal(engine, message, refusal, now_ns)
        return
    lease.last_seq = frame.seq
    lease.renew(now_ns)
    engine.scanner.show(plan, expires_ns, now_ns)
    if message.ref:
        engine.answer(
            Answer(
                ref=message.ref, rate_hz=plan.rate_hz, clamped=plan.clamped, thinned=plan.thinned
            )
        )


def _age_from(sent_ns: int | None, now_ns: int) -> int:
    """When the frame's time began to count. Raises: Refused (`bad_frame`)."""
    if sent_ns is None:
        return now_ns
    if sent_ns > now_ns + _AHEAD_NS:
        raise Refused(
            "bad_frame",
            f"sent_ns lies {(sent_ns - now_ns) // 1_000_000} ms ahead: it counts on the clock of"
            " now_ns in every reply (CLOCK_MONOTONIC)",
        )
    return min(sent_ns, now_ns)


def _tell_refusal(engine: Engine, message: NewFrame, refusal: Refused, now_ns: int) -> None:
    engine.reporter.counters["frames_refused"] += 1
    if message.ref:
        engine.answer(refused(message.ref, refusal))
        return
    engine.reporter.refused(
        RefusedReport(
            now_ns=now_ns,
            error=refusal.code,
            reason=refusal.reason,
            count=engine.reporter.counters["frames_refused"],
            seq=message.frame.seq,
            electrode=refusal.electrode,
            achievable_hz=refusal.achievable_hz,
        )
    )
