"""What was fired of a presentation, from the accounts of its frames.

Owns: adding them up, and what was not as it was asked, in sentences. Must not know: sockets, the
course of a presentation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal, TypeAlias

from etd.client import clock
from etd.client.daemon_clock import DaemonClock
from etd.protocol.errors import Refused
from etd.protocol.outcome import Account, Clamp, Shortfall

#: `replaced`: by another frame of the program. `ended`: by `end()`. `late`: a renewal.
Cut: TypeAlias = Literal["replaced", "ended", "late"]

#: A scan that is late takes nothing from a pulse: the number of pulses tells what it took.
_LATE = ("overrun", "processor")
#: Fewer pulses than this part of what rate and time make are told.
_ENOUGH = 0.9


@dataclass(frozen=True)
class Presented:
    """What was fired. Times are of the daemon's board, in ns: CLOCK_MONOTONIC there, but for a
    fake's, whose clock stands still while its computer is busy. None: no pulse was fired.

    Per electrode: how many `pulses` were fired, the current that was asked for (`wanted_ua`), the
    lowest and the highest that was commanded to the source (`least_ua`, `most_ua`; with stabilizers
    they are theirs), and the mean that passed the skin (`delivered_ua`); 0 where nothing was fired.

    `as_asked`: each electrode that was asked for was fired as long as it was to be, and nothing was
    taken from any pulse. Otherwise `why_not` says in sentences what was, from `clamped`,
    `not_fired` and the number of pulses.
    """

    #: Of its frames, as in telemetry.
    seqs: tuple[int, ...]
    first_ns: int | None
    last_ns: int | None
    #: What this computer's CLOCK_REALTIME is ahead of these times, and within how much that is
    #: right: 0 with a real board on the daemon's own machine.
    wall_offset_ns: int
    uncertainty_ns: int
    rate_hz: float
    pulses: tuple[int, ...]
    wanted_ua: tuple[int, ...]
    least_ua: tuple[int, ...]
    most_ua: tuple[int, ...]
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


def presented_of(
    accounts: Sequence[Account],
    fields: dict[str, object],
    shown_s: float,
    cuts: Sequence[Cut],
    daemon_clock: DaemonClock,
) -> Presented:
    """`fields`: what was asked; `shown_s`: for how long it was shown. Raises: Refused (`expired`),
    if no frame of it was begun.
    """
    if not accounts:
        why = "another frame of the program took its place" if "replaced" in cuts else _NEVER_BEGUN
        raise Refused("expired", why)
    begun = [account.first_ns for account in accounts if account.first_ns is not None]
    ended = [account.last_ns for account in accounts if account.last_ns is not None]
    clamped = _weakest(accounts)
    not_fired = tuple(shortfall for account in accounts for shortfall in account.not_fired)
    pulses = tuple(map(sum, zip(*(account.pulses for account in accounts), strict=True)))
    lag_ns = 1_000 * accounts[-1].clock_lag_us
    least = zip(*(account.least_ua for account in accounts), strict=True)
    most = zip(*(account.most_ua for account in accounts), strict=True)
    told = [_clamp(clamp) for clamp in clamped]
    told += [_shortfall(found) for found in not_fired if found.reason not in _LATE]
    told += _missing(accounts, pulses, fields, shown_s)
    told += _cut_short(accounts, cuts, shown_s)
    return Presented(
        seqs=tuple(account.seq for account in accounts),
        first_ns=min(begun, default=None),
        last_ns=max(ended, default=None),
        wall_offset_ns=clock.wall_offset_ns() - daemon_clock.offset_ns + lag_ns,
        uncertainty_ns=daemon_clock.uncertainty_ns + lag_ns,
        rate_hz=min(account.rate_hz for account in accounts),
        pulses=pulses,
        wanted_ua=accounts[0].wanted_ua,
        least_ua=tuple(min(filter(None, column), default=0) for column in least),
        most_ua=tuple(map(max, most)),
        delivered_ua=_delivered_ua(accounts, pulses),
        clamped=clamped,
        not_fired=not_fired,
        why_not=tuple(told),
    )


_NEVER_BEGUN = (
    "its frame was over before a scan could begin: give it more time than planning takes, some"
    " milliseconds"
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


def _missing(
    accounts: Sequence[Account], pulses: Sequence[int], fields: dict[str, object], shown_s: float
) -> list[str]:
    """Electrodes without a pulse; and pulses that are missing from what was asked."""
    wanted = [electrode for electrode, ua in enumerate(accounts[0].wanted_ua) if ua]
    told = [
        f"electrode {electrode}: no pulse was fired"
        for electrode in wanted
        if not pulses[electrode]
    ]
    asked = fields.get("pulses")
    if isinstance(asked, int):
        short = [electrode for electrode in wanted if 0 < pulses[electrode] < asked]
        told += [f"electrode {one}: {pulses[one]} of {asked} pulses" for one in short]
        return told
    # Of electrodes with rates of their own the fastest are looked at: the scan has their rate.
    about = accounts[0].rate_hz * shown_s
    most = max((pulses[electrode] for electrode in wanted), default=0)
    if wanted and 0 < most < _ENOUGH * about - 1:
        told.append(
            f"{most} of about {about:.0f} pulses were fired: scans came late, or not at all"
        )
    return told


def _cut_short(accounts: Sequence[Account], cuts: Sequence[Cut], shown_s: float) -> list[str]:
    told = []
    if "replaced" in cuts:
        told.append(f"another frame of the program replaced it after {shown_s:.2g} s")
    if "ended" in cuts:
        told.append(f"it was ended after {shown_s:.2g} s")
    if "late" in cuts or any(account.ended == "expired" for account in accounts[:-1]):
        told.append("it was renewed too late: give it a longer ttl_ms")
    if any(account.ended == "silenced" for account in accounts):
        told.append("it was silenced")
    return told


def _clamp(clamp: Clamp) -> str:
    return (
        f"electrode {clamp.electrode}: {clamp.allowed_ua} of {clamp.wanted_ua} uA ({clamp.reason}"
        f" of electrode {clamp.limited_by})"
    )


def _shortfall(shortfall: Shortfall) -> str:
    where = "" if shortfall.electrode is None else f"electrode {shortfall.electrode}: "
    if shortfall.rate_hz is not None:
        return f"{where}slowed to {shortfall.rate_hz:.1f} Hz ({shortfall.reason})"
    return f"{where}{shortfall.pulses} pulses were not fired ({shortfall.reason})"
