"""Presenting a stimulus: what it waits for, the frames that make it, and what was fired.

Owns: the course of a presentation, the wait for an edge of the trigger included. Must not know:
sockets, threads, whether the caller blocks or awaits, what becomes of accounts (`presented.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from etd.client import values
from etd.client.course import Course, Ended, Now, Pause, falling_silent
from etd.client.options import at_once_fields, silent_fields, ttl_ms_of
from etd.client.presented import Cut, CutShort, Presented, presented_of
from etd.client.session import Session
from etd.protocol.errors import EtdError, Refused
from etd.protocol.messages import FrameReply, StateReport
from etd.protocol.outcome import Account

#: What goes on beside a program that may hang ends after so long.
MOST_BEGUN_S = 30.0
#: A presentation that waits for the trigger waits so long, unless it is told otherwise.
WAIT_S = 10.0
#: A frame lives no longer.
_LONGEST_TTL_MS = 1_000
#: A presentation that is longer than a frame is renewed so often within a ttl.
_RENEWALS = 3
#: Of its ttl a frame has at least so much left when an edge begins it, even if renewals are late.
_LEFT_OF_TTL = 0.6
#: The engine itself ends a short one with its edge: it is silenced so long after that.
_AFTER_S = 0.02
#: Contact polls of all electrodes take less than this; where they do not help, it is waited once.
_LOOK_S = 0.05
_LOOKS = 4
#: The engine keeps 256 accounts of a lease: the oldest are asked for before that.
_OUTSTANDING = 128


@dataclass
class _Showing:
    """A presentation under way. `after`: the newest frame of the program that is older."""

    session: Session
    fields: dict[str, object]
    now_ns: Now
    after: int | None
    #: Frames without an account yet, and the accounts so far, in their order.
    seqs: list[int] = field(default_factory=list)
    accounts: list[Account] = field(default_factory=list)
    begun_ns: int = 0
    #: Under which they are sent; None before the first one.
    lease: str | None = None
    cuts: list[Cut] = field(default_factory=list)
    #: The frame that waits for the trigger.
    waits: int | None = None
    #: Of the session, when it began.
    disarms: int = 0
    #: The program waits for it, and shows nothing beside it.
    is_alone: bool = False

    def __post_init__(self) -> None:
        self.disarms = self.session.numbers.disarms
        self.is_alone = self.after is None

    @property
    def is_newest(self) -> bool:
        """Whether what is shown is its own: silence for it leaves what the program showed since."""
        return self.is_alone or self.session.numbers.newest_of is self

    @property
    def overtaken(self) -> Cut:
        """By what its next frame is not the next one any more."""
        return "replaced" if self.session.numbers.disarms == self.disarms else "disarmed"

    def frame(self, fields: dict[str, object]) -> Course[FrameReply]:
        """The next of its frames. Raises: Refused (`old_seq`) once the program has sent another;
        `no_lease`, `halted`, once the lease of the first one has ended.
        """
        stamped = {**fields, "sent_ns": self.now_ns()}
        try:
            reply: FrameReply = yield self.session.frame(stamped, self.after, self.lease, self)
        except Refused as refusal:
            if refusal.code != "old_seq" and self.after is not None:
                self.after += 1  # a number is used up by a refused frame, too
            raise
        self.after, self.lease = reply.seq, self.session.lease
        return reply

    def end(self) -> Course[Cut]:
        """Silent as far as the daemon answers, and unless the program has sent another frame."""
        try:
            yield from self.frame(silent_fields(self.fields, self.now_ns()))
        except Refused as refusal:
            return self.overtaken if refusal.code == "old_seq" else "ended"
        except EtdError:
            pass  # the frame expires by itself
        return "ended"

    def collect(self, most_left: int) -> Course[None]:
        """The accounts of the oldest frames, until so many are left."""
        if self.waits is not None and not most_left:
            # An edge may have begun it without being told yet.
            self.seqs.insert(0, self.waits)
            self.waits = None
        while len(self.seqs) > most_left:
            account = yield from _account_of(self.session, self.seqs.pop(0), self.lease)
            if account is not None:
                self.accounts.append(account)

    def lasted_s(self, at_most_s: float) -> float:
        """For how long it has been shown."""
        return min(at_most_s, (self.now_ns() - self.begun_ns) / 1e9) if self.begun_ns else 0.0

    def presented(self, shown_s: float) -> Presented:
        """Raises: Refused (`expired`), if nothing of it was begun."""
        daemon_clock = self.session.daemon_clock
        return presented_of(self.accounts, self.fields, shown_s, self.cuts, daemon_clock)


def presenting(
    session: Session,
    fields: dict[str, object],
    seconds: float,
    now_ns: Now,
    after: int | None = None,
    wait_s: float = WAIT_S,
) -> Course[Presented]:
    """Waits for what it needs to know of the returns, shows the frame once for `seconds`, and
    collects what was fired. `after` None: it is the newest that the program shows. With
    `on_trigger` among the fields it is shown from the next edge on, which may take `wait_s`.
    """
    shown_s = values.above_zero_s("seconds", seconds)
    longest_s = values.up_to_s("wait_s", wait_s, MOST_BEGUN_S)
    waits, fields = bool(fields.get("on_trigger")), at_once_fields(fields)
    asked = _waiting(fields, shown_s) if waits else _asked(fields, shown_s)
    showing = _Showing(session, fields, now_ns, after)
    try:
        yield from _looking(showing)
        if waits:
            yield from _triggered(showing, asked, shown_s, longest_s)
        else:
            showing.begun_ns = now_ns()
            yield from _shown(showing, asked, showing.begun_ns + int(shown_s * 1e9))
    except Refused as refusal:
        if refusal.code != "old_seq":
            yield from _raise_cut_short(showing, refusal, shown_s)
        showing.cuts.append(showing.overtaken)
    except Ended:
        showing.cuts.append((yield from showing.end()))
    except EtdError:
        raise
    except BaseException:
        if showing.is_newest:
            yield from falling_silent(session, fields, now_ns)
        raise
    lasted_s = showing.lasted_s(shown_s)
    try:
        yield from showing.collect(0)
    except Refused as refusal:
        yield from _raise_cut_short(showing, refusal, shown_s)
    return showing.presented(lasted_s)


def _asked(fields: dict[str, object], shown_s: float) -> dict[str, object]:
    """The frame that is shown. Raises: Refused (`bad_frame`)."""
    whole_ms = math.ceil(shown_s * 1_000)
    if "pulses" in fields and whole_ms > _LONGEST_TTL_MS:
        raise Refused(
            "bad_frame",
            f"seconds={shown_s:g} with pulses: a frame of so many pulses is not renewed, and lives"
            " for a second at most",
        )
    ttl_ms = ttl_ms_of(fields, min(_LONGEST_TTL_MS, whole_ms))
    return {**fields, "ttl_ms": whole_ms if "pulses" in fields else ttl_ms, "account": True}


def _waiting(fields: dict[str, object], shown_s: float) -> dict[str, object]:
    """The frame that waits for the trigger. Where the ttl leaves enough, the engine ends it.
    Raises: Refused (`bad_frame`).
    """
    whole_ms, ttl_ms = math.ceil(shown_s * 1_000), ttl_ms_of(fields, _LONGEST_TTL_MS)
    asked = {**fields, "ttl_ms": ttl_ms, "account": True, "on_trigger": True}
    if whole_ms <= _LEFT_OF_TTL * ttl_ms:
        return {**asked, "lasts_ms": whole_ms}
    if "pulses" in fields:
        raise Refused(
            "bad_frame",
            f"seconds={shown_s:g} with pulses and on_trigger: a frame of so many pulses is not"
            f" renewed once it has begun; give at most {_LEFT_OF_TTL * ttl_ms / 1_000:g} s",
        )
    return asked


def _triggered(
    showing: _Showing, asked: dict[str, object], shown_s: float, wait_s: float
) -> Course[None]:
    """Waits for the edge, then shows the rest; silent in the end."""
    edge_ns = yield from _edge(showing, asked, wait_s)
    if edge_ns is None:
        showing.cuts.append("no edge")
        yield from showing.frame(silent_fields(showing.fields, showing.now_ns()))
        return
    status: StateReport = yield showing.session.status()
    # By the clock here: the edge was stamped by the board's.
    here_ns = edge_ns + 1_000 * status.clock_lag_us - showing.session.daemon_clock.offset_ns
    showing.begun_ns, end_ns = here_ns, here_ns + int(shown_s * 1e9)
    if "lasts_ms" in asked:
        yield Pause(max(0.0, (end_ns - showing.now_ns()) / 1e9) + _AFTER_S)
        yield from showing.frame(silent_fields(showing.fields, showing.now_ns()))
    else:
        yield from _shown(showing, at_once_fields(asked), end_ns)


def _edge(showing: _Showing, asked: dict[str, object], wait_s: float) -> Course[int | None]:
    """The edge that has begun the frame; None: none came in time."""
    until_ns = showing.now_ns() + int(wait_s * 1e9)
    reply = yield from showing.frame(asked)
    showing.waits = reply.seq
    while (left_s := (until_ns - showing.now_ns()) / 1e9) > 0:
        yield Pause(min(left_s, ttl_ms_of(asked, _LONGEST_TTL_MS) / 1_000 / _RENEWALS))
        try:
            reply = yield from showing.frame({**asked, "renews": showing.waits})
        except Refused as refusal:
            if refusal.code != "expired":
                raise
            # This renewal came too late; the next one may not.
            continue
        if reply.trigger_ns is not None:
            showing.seqs.append(showing.waits)
            showing.waits = None
            return reply.trigger_ns
        showing.waits = reply.seq
    return None


def _shown(showing: _Showing, asked: dict[str, object], end_ns: int) -> Course[None]:
    """Renewed within its ttl, and silent in the end."""
    ttl_ms = ttl_ms_of(asked, _LONGEST_TTL_MS)
    while (left_s := (end_ns - showing.now_ns()) / 1e9) > 0:
        try:
            reply = yield from showing.frame(asked)
        except Refused as refusal:
            if refusal.code != "expired":
                raise
            # It came too late; the next one may not.
            showing.cuts.append("late")
        else:
            showing.seqs.append(reply.seq)
        yield from showing.collect(_OUTSTANDING)
        is_last = left_s * 1_000 <= ttl_ms
        yield Pause(left_s if is_last else ttl_ms / 1_000 / _RENEWALS)
    yield from showing.frame(silent_fields(showing.fields, showing.now_ns()))


def _looking(showing: _Showing) -> Course[None]:
    """After a silence it is not known what the returns carry, which weakens a pulse. Contact polls
    tell, in a silent frame.
    """
    session, allowed_ua = showing.session, -1
    lenient = {**showing.fields, "strict": False}
    for _ in range(_LOOKS):
        asked = {**lenient, "sent_ns": showing.now_ns()}
        reply = yield session.preview(asked, showing.lease)
        weak = [clamp for clamp in reply.clamped if clamp.reason == "return_cap"]
        now_ua = sum(clamp.allowed_ua for clamp in weak)
        if not weak or now_ua == allowed_ua:
            return
        allowed_ua = now_ua
        yield from showing.frame(silent_fields(showing.fields, showing.now_ns()))
        yield Pause(_LOOK_S)


def _raise_cut_short(showing: _Showing, refusal: Refused, shown_s: float) -> Course[None]:
    """A halt, say: the daemon still has the accounts. What stands is ended first. Raises: CutShort;
    the refusal itself, where nothing was fired, or nothing is known of it.
    """
    lasted_s = showing.lasted_s(shown_s)
    if showing.seqs and showing.is_newest:
        yield from falling_silent(showing.session, showing.fields, showing.now_ns)
    try:
        yield from showing.collect(0)
    except EtdError:
        pass  # what is known is told; the refusal is the news
    if not showing.accounts:
        raise refusal
    showing.cuts.append("refused")
    raise CutShort(refusal, showing.presented(lasted_s)) from None


def _account_of(session: Session, seq: int, lease: str | None) -> Course[Account | None]:
    """None: the frame was replaced before it began."""
    try:
        account: Account = yield session.account(seq, lease)
    except Refused as refusal:
        if refusal.code != "not_found":
            raise
        return None
    return account
