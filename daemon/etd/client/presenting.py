"""Presenting a stimulus: what it waits for, the frames that make it, and what was fired.

Owns: the course of a presentation, and what it returns. Must not know: sockets, threads, whether
the caller blocks or awaits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from etd.client import clock, values
from etd.client.course import CUT_SHORT, Course, Now, Pause, falling_silent
from etd.client.daemon_clock import DaemonClock
from etd.client.options import FrameOptions, silent_fields
from etd.client.session import Session
from etd.protocol.errors import Refused
from etd.protocol.messages import FrameReply
from etd.protocol.outcome import Account, Clamp, Shortfall

#: What goes on beside a program that may hang ends after so long.
MOST_BEGUN_S = 30.0
#: A frame lives no longer.
_LONGEST_TTL_MS = 1_000
#: A presentation that is longer than a frame is renewed so often within a ttl.
_RENEWALS = 3
#: Contact polls of all electrodes take less than this; where they do not help, it is waited once.
_LOOK_S = 0.05
#: A scan that is late takes nothing from a pulse; where that goes on, the rate is lowered and told.
_LATE = ("overrun", "processor")
_LOOKS = 4


@dataclass(frozen=True)
class Presented:
    """What was fired. Times are on the daemon's CLOCK_MONOTONIC, in ns; None: no pulse was fired.

    Per electrode: how many `pulses` were fired, the current that was asked for (`wanted_ua`), the
    lowest that was commanded to the source (`commanded_ua`: with stabilizers it is theirs), and the
    mean that passed the skin (`delivered_ua`); 0 where nothing was fired.

    `as_asked`: each electrode that was asked for was fired, and nothing was taken from any pulse.
    Otherwise `why_not` says in sentences what was, from `clamped` and `not_fired`. A scan that was
    late stands in `not_fired` only.
    """

    #: Of its frames, as in telemetry.
    seqs: tuple[int, ...]
    first_ns: int | None
    last_ns: int | None
    #: What this computer's CLOCK_REALTIME is ahead of the daemon's CLOCK_MONOTONIC, and within how
    #: much that is right: 0 on the daemon's own machine.
    wall_offset_ns: int
    uncertainty_ns: int
    rate_hz: float
    pulses: tuple[int, ...]
    wanted_ua: tuple[int, ...]
    commanded_ua: tuple[int, ...]
    delivered_ua: tuple[int, ...]
    clamped: tuple[Clamp, ...]
    not_fired: tuple[Shortfall, ...]
    why_not: tuple[str, ...]

    @property
    def as_asked(self) -> bool:
        """Whether nothing was less than it was asked for."""
        return not self.why_not

    @property
    def first_at(self) -> datetime | None:
        """The wall time of the first pulse, with the offset of the local time zone."""
        if self.first_ns is None:
            return None
        return datetime.fromtimestamp((self.first_ns + self.wall_offset_ns) / 1e9).astimezone()


def presenting(
    session: Session,
    fields: dict[str, object],
    options: FrameOptions,
    seconds: float,
    now_ns: Now,
) -> Course[Presented]:
    """Waits for what it needs to know of the returns, shows the frame once for `seconds`, and
    collects what was fired.
    """
    shown_s = values.above_zero_s("seconds", seconds)
    yield from _looking(session, fields, now_ns)
    ttl_ms = options.get("ttl_ms") or min(_LONGEST_TTL_MS, math.ceil(shown_s * 1_000))
    asked = {**fields, "ttl_ms": ttl_ms, "account": True}
    end_ns = now_ns() + int(shown_s * 1e9)
    replies: list[FrameReply] = []
    try:
        while (left_s := (end_ns - now_ns()) / 1e9) > 0:
            renewed = {**asked, "sent_ns": now_ns()}
            after = replies[-1].seq if replies else None
            replies.append((yield session.frame(renewed, after)))
            is_last = left_s * 1_000 <= ttl_ms
            yield Pause(left_s if is_last else ttl_ms / 1_000 / _RENEWALS)
        yield session.frame(silent_fields(fields, now_ns()), replies[-1].seq)
    except Refused as refusal:
        if refusal.code != "old_seq":
            raise
        # The program shows something else now.
    except CUT_SHORT:
        yield from falling_silent(session, fields, now_ns)
        raise
    accounts: list[Account] = []
    for reply in replies:
        account = yield from _account_of(session, reply.seq)
        if account is not None:
            accounts.append(account)
    return _presented(accounts, len(replies), session.daemon_clock)


def _looking(session: Session, fields: dict[str, object], now_ns: Now) -> Course[None]:
    """After a silence it is not known what the returns carry, which weakens a pulse. Contact polls
    tell, in a silent frame.
    """
    allowed_ua = -1
    for _ in range(_LOOKS):
        reply = yield session.frame({**fields, "preview": True, "sent_ns": now_ns()})
        weak = [clamp for clamp in reply.clamped if clamp.reason == "return_cap"]
        now_ua = sum(clamp.allowed_ua for clamp in weak)
        if not weak or now_ua == allowed_ua:
            return
        allowed_ua = now_ua
        yield session.frame(silent_fields(fields, now_ns()))
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


def _presented(accounts: Sequence[Account], frames: int, daemon_clock: DaemonClock) -> Presented:
    if not accounts:
        raise Refused("expired", "none of its frames was begun: another one took its place")
    begun = [account.first_ns for account in accounts if account.first_ns is not None]
    ended = [account.last_ns for account in accounts if account.last_ns is not None]
    columns = zip(*(account.least_ua for account in accounts), strict=True)
    clamped = _weakest(accounts)
    not_fired = tuple(shortfall for account in accounts for shortfall in account.not_fired)
    pulses = tuple(map(sum, zip(*(account.pulses for account in accounts), strict=True)))
    wanted_ua = accounts[0].wanted_ua
    return Presented(
        seqs=tuple(account.seq for account in accounts),
        first_ns=min(begun, default=None),
        last_ns=max(ended, default=None),
        wall_offset_ns=clock.wall_offset_ns() - daemon_clock.offset_ns,
        uncertainty_ns=daemon_clock.uncertainty_ns,
        rate_hz=min(account.rate_hz for account in accounts),
        pulses=pulses,
        wanted_ua=wanted_ua,
        commanded_ua=tuple(min(filter(None, column), default=0) for column in columns),
        delivered_ua=_delivered_ua(accounts, pulses),
        clamped=clamped,
        not_fired=not_fired,
        why_not=tuple(_why_not(accounts, frames, pulses, clamped, not_fired)),
    )


def _weakest(accounts: Sequence[Account]) -> tuple[Clamp, ...]:
    """Of each electrode and reason the clamp that left the least."""
    found: dict[tuple[int, str], Clamp] = {}
    for account in accounts:
        for clamp in account.clamped:
            key = clamp.electrode, clamp.reason
            if key not in found or clamp.allowed_ua < found[key].allowed_ua:
                found[key] = clamp
    return tuple(found.values())


def _delivered_ua(accounts: Sequence[Account], pulses: Sequence[int]) -> tuple[int, ...]:
    """The mean over all pulses."""
    sums = [0] * len(pulses)
    for account in accounts:
        for electrode, delivered_ua in enumerate(account.delivered_ua):
            sums[electrode] += delivered_ua * account.pulses[electrode]
    return tuple(round(all_ua / max(1, count)) for all_ua, count in zip(sums, pulses, strict=True))


def _why_not(
    accounts: Sequence[Account],
    frames: int,
    pulses: Sequence[int],
    clamped: Sequence[Clamp],
    not_fired: Sequence[Shortfall],
) -> list[str]:
    """What was not as it was asked, in sentences."""
    told = [
        f"electrode {clamp.electrode}: {clamp.allowed_ua} of {clamp.wanted_ua} uA ({clamp.reason}"
        f" of electrode {clamp.limited_by})"
        for clamp in clamped
    ]
    told += [_shortfall(found) for found in not_fired if found.reason not in _LATE]
    for electrode, wanted_ua in enumerate(accounts[0].wanted_ua):
        if wanted_ua and not pulses[electrode]:
            told.append(f"electrode {electrode}: no pulse was fired")
    if len(accounts) < frames or any(account.ended == "expired" for account in accounts[:-1]):
        told.append("it was renewed too late: give it a longer ttl_ms")
    if any(account.ended == "silenced" for account in accounts):
        told.append("it was silenced")
    return told


def _shortfall(shortfall: Shortfall) -> str:
    where = "" if shortfall.electrode is None else f"electrode {shortfall.electrode}: "
    if shortfall.rate_hz is not None:
        return f"{where}slowed to {shortfall.rate_hz:.1f} Hz ({shortfall.reason})"
    return f"{where}{shortfall.pulses} pulses were not fired ({shortfall.reason})"
