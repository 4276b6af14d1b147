"""Presenting a stimulus: what it waits for, the frames that make it, and what was fired.

Owns: the course of a presentation. Must not know: sockets, threads, whether the caller blocks or
awaits, what is made of the accounts (`presented.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from etd.client import values
from etd.client.course import Course, Ended, Now, Pause, falling_silent
from etd.client.options import silent_fields, ttl_ms_of
from etd.client.presented import Cut, Presented, presented_of
from etd.client.session import Session
from etd.protocol.errors import EtdError, Refused
from etd.protocol.messages import FrameReply
from etd.protocol.outcome import Account

#: What goes on beside a program that may hang ends after so long.
MOST_BEGUN_S = 30.0
#: A frame lives no longer.
_LONGEST_TTL_MS = 1_000
#: A presentation that is longer than a frame is renewed so often within a ttl.
_RENEWALS = 3
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
    cuts: list[Cut] = field(default_factory=list)

    def frame(self, fields: dict[str, object]) -> Course[FrameReply]:
        """The next of its frames. Raises: Refused (`old_seq`) once the program has sent another."""
        stamped = {**fields, "sent_ns": self.now_ns()}
        try:
            reply: FrameReply = yield self.session.frame(stamped, self.after)
        except Refused as refusal:
            if refusal.code != "old_seq" and self.after is not None:
                self.after += 1  # a number is used up by a refused frame, too
            raise
        self.after = reply.seq
        return reply

    def collect(self, most_left: int) -> Course[None]:
        """The accounts of the oldest frames, until so many are left."""
        while len(self.seqs) > most_left:
            account = yield from _account_of(self.session, self.seqs.pop(0))
            if account is not None:
                self.accounts.append(account)


def presenting(
    session: Session,
    fields: dict[str, object],
    seconds: float,
    now_ns: Now,
    after: int | None = None,
) -> Course[Presented]:
    """Waits for what it needs to know of the returns, shows the frame once for `seconds`, and
    collects what was fired. `after` None: it is the newest that the program shows.
    """
    shown_s = values.above_zero_s("seconds", seconds)
    asked = _asked(fields, shown_s)
    showing = _Showing(session, fields, now_ns, after)
    try:
        yield from _looking(showing)
        yield from _shown(showing, asked, shown_s)
    except Refused as refusal:
        if refusal.code != "old_seq":
            raise
        showing.cuts.append("replaced")
    except Ended:
        yield from falling_silent(session, fields, now_ns)
        showing.cuts.append("ended")
    except EtdError:
        raise
    except BaseException:
        yield from falling_silent(session, fields, now_ns)
        raise
    lasted_s = (now_ns() - showing.begun_ns) / 1e9 if showing.begun_ns else 0.0
    yield from showing.collect(0)
    return presented_of(
        showing.accounts, fields, min(shown_s, lasted_s), showing.cuts, session.daemon_clock
    )


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


def _shown(showing: _Showing, asked: dict[str, object], shown_s: float) -> Course[None]:
    """Renewed within its ttl, and silent in the end."""
    ttl_ms = ttl_ms_of(asked, _LONGEST_TTL_MS)
    showing.begun_ns = showing.now_ns()
    end_ns = showing.begun_ns + int(shown_s * 1e9)
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
        reply = yield session.preview({**lenient, "sent_ns": showing.now_ns()})
        weak = [clamp for clamp in reply.clamped if clamp.reason == "return_cap"]
        now_ua = sum(clamp.allowed_ua for clamp in weak)
        if not weak or now_ua == allowed_ua:
            return
        allowed_ua = now_ua
        yield from showing.frame(silent_fields(showing.fields, showing.now_ns()))
        yield Pause(_LOOK_S)


def _account_of(session: Session, seq: int) -> Course[Account | None]:
    """None: the frame was replaced before it began."""
    try:
        account: Account = yield session.account(seq)
    except Refused as refusal:
        if refusal.code != "not_found":
            raise
        return None
    return account
