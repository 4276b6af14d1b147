"""The commands of the gateway, and the answer to each.

Owns: the meaning of every command and frame of the link. Must not know: sockets, ZeroMQ, how a
pulse is made. A command that is refused changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence

import msgspec

from etd.engine.opening import check_felt, taken
from etd.engine.supervisor import Supervisor
from etd.protocol.calibration import Calibration
from etd.protocol.carried import CarriedOver
from etd.protocol.errors import BoardFault, BusError, GuardRefusal, Refused, halted
from etd.protocol.exponent import check_exponent, no_exponent
from etd.protocol.felt import FeltDone
from etd.protocol.frame import check_shape
from etd.protocol.link import (
    MOST_ACCOUNTS,
    Alive,
    Answer,
    ArmBoard,
    AskAccount,
    ClearHalt,
    CloseLease,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    NewFrame,
    OpenLease,
    RecordBegins,
    RecordPulses,
    SayFelt,
    SetMark,
    StopNow,
    ToEngine,
)
from etd.protocol.messages import Marked
from etd.safety.lease import Lease, calibrations_of, check_holder, check_seq
from etd.safety.limits import limits_of_calibrations, limits_of_numbers

#: A client on this machine reads the same clock; more than this ahead is not that clock.
_AHEAD_NS = 100_000_000


def execute(core: Supervisor, command: ToEngine, host_ns: int) -> None:
    """Carry out one command and answer it, unless its answer comes later (open, arm, measure).
    `host_ns`: on the machine's clock, which the lease counts on.
    """
    _answer(core, command.ref, lambda: _answer_to(core, command, host_ns))


def go_on_opening(core: Supervisor, host_ns: int) -> None:
    """The lease whose calibrations are being read: begun once they are."""
    command = core.opening.pending
    if command is not None:
        _answer(core, command.ref, lambda: _opened(core, command, host_ns))


def _answer(core: Supervisor, ref: int, made: Callable[[], Answer | None]) -> None:
    try:
        answer = made()
    except Refused as refusal:
        answer = Answer.refusing(ref, refusal)
    except (BusError, BoardFault, GuardRefusal) as fault:
        core.halt("fault", type(fault).__name__, str(fault))
        answer = Answer(ref=ref, error="halted", reason=str(fault))
    if answer is not None and ref:
        core.send(answer)


def _answer_to(core: Supervisor, command: ToEngine, host_ns: int) -> Answer | None:
    """Raises: Refused."""
    match command:
        case Alive():
            return None
        case StopNow(client=who, uid=uid):
            problems = core.halt("stop", who, "asked to stop")
            core.states.askers.asked(uid)
            if problems:
                raise Refused("halted", f"HALTED, but the board is not safe: {'; '.join(problems)}")
        case OpenLease():
            return _open(core, command, host_ns)
        case KeepLease(lease=token):
            _holder(core, token).renew(host_ns)
        case CloseLease(lease=token):
            _holder(core, token)
            core.end_lease("closed")
        case DisarmBoard(lease=token):
            _holder(core, token)
            core.make_safe("disarmed")
            core.soft_start.restart()
        case ArmBoard() if core.states.state == "ARMED":
            return Answer(ref=command.ref, calibrations=calibrations_of(core.lease))
        case ArmBoard():
            core.begin_power_up("arm", command.ref)
            return None
        case MeasureContact(lease=token):
            _holder(core, token)
            core.begin_power_up("measure", command.ref)
            return None
        case ClearHalt(uid=uid, is_operator=is_operator):
            core.states.askers.check(uid, is_operator=is_operator)
            core.clear()
        case SetMark(lease=token):
            _holder(core, token)
            return _mark(core, command)
        case SayFelt():
            return Answer(ref=command.ref, felt=_hear(core, command))
        case AskAccount(lease=token):
            # Also when it has ended: what a stop cut short is asked for after it.
            if token != core.reporter.accounts.lease:
                _holder(core, token)
            awaited = core.reporter.accounts.awaited
            if len(awaited) >= MOST_ACCOUNTS:
                raise Refused(
                    "busy", f"{MOST_ACCOUNTS} accounts are waited for: ask again when one has come"
                )
            awaited.append((command.ref, command.seq))
            return None
        case RecordPulses(is_on=is_on):
            # What has gathered comes before the answer: a record that ends has it.
            now_ns = core.clock.now_ns()
            core.reporter.scan_report(now_ns, core.soft_start.ceiling_ua, is_due=True)
            core.pulse_log.turn(is_on)
            if is_on:
                core.gateway_link.send(RecordBegins(carried=_carried(core, now_ns, host_ns)))
    return Answer(ref=command.ref)


def _carried(core: Supervisor, now_ns: int, host_ns: int) -> CarriedOver:
    """What a replay has to begin with. It changes nothing."""
    session, schedule = core.sessions.standing(host_ns), core.active.schedule
    return CarriedOver(
        t_ns=now_ns,
        state=core.states.state,
        soft_start=core.soft_start.saved(),
        contacts=core.contact.saved() if core.states.state == "ARMED" else None,
        power_up=None if core.power_up is None else core.power_up.goal,
        has_session=session is not None,
        calibration=None if session is None else session.subject.calibration,
        others=() if session is None else session.subject.others,
        shown_seq=None if schedule is None else schedule.plan.frame.seq,
        next_scan_ns=None if schedule is None else schedule.next_ns,
        recent_pulses=core.ledger.recent_pulses(now_ns),
        source_checked_ns=core.source_check.checked_ns,
    )


def _holder(core: Supervisor, token: str) -> Lease:
    """The standing lease, if `token` belongs to it. No lease outlives a halt, so the halt is the
    reason that is told. Raises: Refused (`halted`, the lease's).
    """
    core.states.check_not_halted()
    return check_holder(core.lease, token)


def _open(core: Supervisor, command: OpenLease, host_ns: int) -> Answer | None:
    """None while its calibrations are read: then the answer comes of `go_on_opening`."""
    _check_may_open(core)
    if not command.calibrations:
        return _begin_lease(core, command, (), host_ns)
    core.opening.begin(command, core.gateway_link.peer, host_ns)
    return _opened(core, command, host_ns)


def _opened(core: Supervisor, command: OpenLease, host_ns: int) -> Answer | None:
    calibrations = core.opening.calibrations(host_ns)
    if calibrations is None:
        return None
    # All may have changed while they were read.
    _check_may_open(core)
    return _begin_lease(core, command, calibrations, host_ns)


def _check_may_open(core: Supervisor) -> None:
    if core.lease is not None:
        raise Refused("other_lease", f"the lease is held by {core.lease.client!r}")
    core.states.need("SAFE")


def _begin_lease(
    core: Supervisor, command: OpenLease, calibrations: Sequence[Calibration], host_ns: int
) -> Answer:
    loaded = core.loaded
    check_felt(calibrations, core.backend)
    if calibrations:
        person = limits_of_calibrations(
            calibrations,
            core.maxima,
            loaded.array.name,
            loaded.array.count,
            loaded.body_site.name,
        )
    elif command.limits is not None:
        person = limits_of_numbers(command.limits, core.maxima, loaded.array.count)
    else:
        raise Refused("limits_missing", "open with a calibration or with limits")
    if loaded.body_site.stabilize.power_law is not None:
        board, leak_ohm = loaded.board.name, loaded.board.source.leak_ohm
        if not calibrations:
            raise no_exponent()
        for wanted, made in zip(command.calibrations, calibrations, strict=True):
            of = f"calibration {wanted.name!r} ({made.polarity})"
            check_exponent(made.exponent, board, leak_ohm, made.date, of)
    told = taken(command, calibrations)
    lease = Lease(command.lease, command.client, person, core.timeouts.lease_ns, told)
    lease.renew(host_ns)
    core.begin_lease(lease)
    return Answer(ref=command.ref, calibrations=told)


def _hear(core: Supervisor, said: SayFelt) -> FeltDone:
    """Who holds the lease may say all, anybody else only that it is too strong: so may whose lease
    has ended, whose word must not be lost for that.
    """
    core.states.check_not_halted()
    is_holder = core.lease is not None and core.lease.token == said.lease
    if said.answer == "too_strong" and not is_holder:
        said = msgspec.structs.replace(said, lease=None)
    if said.lease is not None:
        _holder(core, said.lease)
    elif said.answer != "too_strong":
        if core.lease is None:
            raise Refused("no_lease", "no lease stands, so nothing is felt: open one, then arm")
        raise Refused(
            "other_lease",
            f"the lease is held by {core.lease.client!r}: only its holder can say"
            f" {said.answer!r}, anybody can say 'too_strong'",
        )
    core.states.need("ARMED")
    now_ns = core.clock.now_ns()
    done = core.feeling.hear(said, now_ns)
    core.report_state(now_ns)
    return done


def hear_button(core: Supervisor) -> None:
    """The wearer pressed: too strong, all of it. Where nothing can be felt it says nothing."""
    if core.states.state == "ARMED":
        now_ns = core.clock.now_ns()
        core.feeling.hear(SayFelt(ref=0, answer="too_strong"), now_ns)
        core.report_state(now_ns)


def _mark(core: Supervisor, command: SetMark) -> Answer:
    """A mark has a time of the board's clock, like all that happens on the board."""
    now_ns = core.clock.now_ns()
    core.marker.mark("mark", -1, command.tag)
    sync = core.board.sync()
    core.reporter.marked(Marked(marked_ns=now_ns, tag=command.tag, sync=sync))
    return Answer(ref=command.ref, marked_ns=now_ns, sync=sync)


def answer_accounts(core: Supervisor) -> None:
    """To those who ask for the account of a frame that is over."""
    accounts = core.reporter.accounts
    asked, accounts.awaited = accounts.awaited, []
    for ref, seq in asked:
        account = accounts.of(seq)
        if account is not None:
            lag_us = core.lag_ns() // 1_000
            told = msgspec.structs.replace(account, clock_lag_us=lag_us)
            core.send(Answer(ref=ref, account=told))
        elif core.active.stands(seq):
            accounts.awaited.append((ref, seq))
        else:
            core.send(Answer.refusing(ref, _why_no_account(core, seq)))


def _why_no_account(core: Supervisor, seq: int) -> Refused:
    halt = core.states.halt
    if halt is not None:
        return halted(halt.cause, halt.source, halt.detail)
    if core.lease is None:
        return Refused("no_lease", f"the lease has ended, and nothing is known of frame {seq}")
    why = f"there is no account of frame {seq}: it was sent without, or was never begun"
    return Refused("not_found", why)


def take_frame(
    core: Supervisor, message: NewFrame, host_ns: int, came_host_ns: int
) -> Generator[None, None, None]:
    """Plan a frame in steps and show it from the next scan on, or refuse it. Between two steps all
    may change except the frames.

    The frame's age counts on the machine's clock, which shows `host_ns` now. `came_host_ns` is the
    earliest time at which it may have come; the age of a frame without `sent_ns` counts from there.
    """
    frame = message.frame
    try:
        lease = _holder(core, frame.lease)
        check_seq(lease, frame.seq)
        core.states.need("ARMED")
        check_shape(frame, core.loaded.array.count)
        begun_host_ns = _age_from(frame.sent_ns, host_ns, came_host_ns)
        ttl_ns = core.timeouts.ttl_ns(frame.ttl_ms)
        if host_ns >= begun_host_ns + ttl_ns:
            how = "sent" if frame.sent_ns is not None else "not seen in a stall, perhaps sent"
            raise Refused(
                "expired",
                f"{how} {(host_ns - begun_host_ns) // 1_000_000} ms ago, its ttl is"
                f" {ttl_ns // 1_000_000} ms",
            )
        if frame.preview and not message.ref:
            raise Refused("bad_frame", "a preview is its answer: a streamed frame has none")
        # Its client lives, whether all that it asks can be shown or not.
        lease.renew(host_ns)
        if frame.on_trigger and core.loaded.board.trigger == "absent":
            raise Refused(
                "board_cannot",
                f"the board {core.loaded.board.name} names no trigger, so a frame cannot wait for"
                " one: give its line in the board file (docs/hardware.md)",
            )
        plan = yield from core.planner.steps(frame, core.outlook())
        _check_still_held(core, lease)
    except Refused as refusal:
        _report_refusal(core, message, refusal)
        return
    trigger_ns = core.active.triggered_ns(frame)
    if not frame.preview:
        lease.last_seq = frame.seq
        if trigger_ns is None:
            core.active.show(plan, begun_host_ns + ttl_ns)
    if message.ref:
        core.send(
            Answer(
                ref=message.ref,
                rate_hz=plan.rate_hz,
                calibrated_hz=plan.calibrated_hz,
                clamped=plan.clamped,
                slowed=plan.slowed,
                trigger_ns=trigger_ns,
            )
        )


def _check_still_held(core: Supervisor, lease: Lease) -> None:
    """Checked after planning, since commands are executed meanwhile. Raises: Refused."""
    core.states.check_not_halted()
    if core.lease is not lease:
        raise Refused("no_lease", "the lease ended while its frame was planned: open one")
    core.states.need("ARMED")


def _age_from(sent_ns: int | None, host_ns: int, came_host_ns: int) -> int:
    """When the frame's time began to count. Raises: Refused (`bad_frame`)."""
    if sent_ns is None:
        return came_host_ns
    if sent_ns > host_ns + _AHEAD_NS:
        raise Refused(
            "bad_frame",
            f"sent_ns lies {(sent_ns - host_ns) // 1_000_000} ms ahead: it counts on the clock of"
            " now_ns in every reply (CLOCK_MONOTONIC)",
        )
    return min(sent_ns, host_ns)


def _report_refusal(core: Supervisor, message: NewFrame, refusal: Refused) -> None:
    if message.ref:
        core.reporter.counters["frames_refused"] += 1
        core.send(Answer.refusing(message.ref, refusal))
    else:
        core.reporter.refused(message.frame, refusal, core.clock.now_ns())
