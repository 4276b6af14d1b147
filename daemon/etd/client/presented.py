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

#: `replaced`: by another frame of the program. `disarmed`: by the program. `ended`: by `end()`.
#: `late`: a renewal. `refused`: by a halt, say. `no edge`: the wait for the trigger was over.
Cut: TypeAlias = Literal["replaced", "disarmed", "ended", "late", "refused", "no edge"]

#: A scan that is late takes nothing from a pulse: the number of pulses tells what it took.
_LATE = ("overrun", "processor")
#: Fewer pulses than this part of what rate and time make are told.
_ENOUGH = 0.98
#: Less than this would be told as 1.00 times what was asked.
_RAISED = 1.005


@dataclass(frozen=True)
class Presented:
    """What was fired. Times are of the daemon's board, in ns: CLOCK_MONOTONIC there, but for a
    fake's, whose clock stands still while its computer is busy. None: no pulse was fired.

    Per electrode: how many `pulses` were fired, the current that was asked for (`wanted_ua`), the
    lowest and the highest that was commanded to the source (`least_ua`, `most_ua`; with stabilizers
    they are theirs), and the mean that passed the skin (`delivered_ua`); 0 where nothing was fired.

    `as_asked`: each electrode that was asked for was fired as long as it was to be, and nothing was
    taken from any pulse. Otherwise `why_not` says in sentences what was, from `clamped`,
    `not_fired` and the number of pulses. Laws, and answers where the body site lets them, may
    raise: `as_asked` is True then, `most_ua` is above `wanted_ua`, and the printed line says so.
    """

    #: Of its frames, as in telemetry.
    seqs: tuple[int, ...]
    first_ns: int | None
    last_ns: int | None
    #: The edge of the trigger that began it, by the kernel's stamp; None: it waited for none.
    trigger_ns: int | None
    #: What this computer's CLOCK_REALTIME is ahead of these times, and within how much that is
    #: right: 0 with a real board on the daemon's own machine.
    wall_offset_ns: int
    uncertainty_ns: int
    rate_hz: float
    #: The rate that its levels were calibrated at, where a lower one was asked for: they may be
    #: felt less, or not at all.
    calibrated_hz: float | None
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
        """Whether nothing was less than it was asked for; it may have been more."""
        return not self.why_not

    def __str__(self) -> str:
        """One line: what was fired, and what was not as it was asked."""
        felt = [electrode for electrode, count in enumerate(self.pulses) if count]
        told = "; ".join([*(self.why_not or ["as asked"]), *self._raised()])
        if not felt:
            return f"nothing was fired: {told}"
        where = f"electrode {felt[0]}" if len(felt) == 1 else f"{len(felt)} electrodes"
        least_ua, most_ua = min(self.least_ua[one] for one in felt), max(self.most_ua)
        current = f"{most_ua}" if least_ua == most_ua else f"{least_ua} to {most_ua}"
        return f"{sum(self.pulses)} pulses at {where}, {current} uA, {self.rate_hz:.1f} Hz: {told}"

    def _raised(self) -> list[str]:
        """How far the one that was raised most was: no source makes more of a current by itself."""
        both = zip(self.most_ua, self.wanted_ua, strict=True)
        times = max((most_ua / wanted_ua for most_ua, wanted_ua in both if wanted_ua), default=1.0)
        is_told = times >= _RAISED
        return [f"raised up to {times:.2f} times by a law or an answer"] if is_told else []

    @property
    def latency_ns(self) -> int | None:
        """From the edge of the trigger to the first pulse."""
        if self.first_ns is None or self.trigger_ns is None:
            return None
        return self.first_ns - self.trigger_ns

    @property
    def first_at(self) -> datetime | None:
        """The wall time of the first pulse, with the offset of the local time zone."""
        if self.first_ns is None:
            return None
        return datetime.fromtimestamp((self.first_ns + self.wall_offset_ns) / 1e9).astimezone()


class CutShort(Refused):
    """A presentation was refused while it was shown: by a halt, with the end of its lease, or for
    the net charge of an electrode (`over_maximum`).
    Fields: those of `Refused`, and `presented`: what was fired until then.
    """

    def __init__(self, refusal: Refused, presented: Presented) -> None:
        self.presented = presented
        most = max(presented.pulses, default=0)
        reason = f"{refusal.reason}; it was cut short after {most} pulses (see its .presented)"
        super().__init__(
            refusal.code, reason, refusal.electrode, refusal.achievable_hz, refusal.bound_by
        )


def presented_of(
    accounts: Sequence[Account],
    fields: dict[str, object],
    shown_s: float,
    cuts: Sequence[Cut],
    daemon_clock: DaemonClock,
) -> Presented:
    """`fields`: what was asked; `shown_s`: for how long it was shown, as far as the client knows.
    Raises: Refused (`expired`), if no frame of it was begun.
    """
    if not accounts:
        why = (_NEVER[cut] for cut in cuts if cut in _NEVER)
        raise Refused("expired", next(why, _NEVER_BEGUN))
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
    lasted_s = _lasted_s(accounts, cuts, shown_s)
    told += _missing(accounts, pulses, fields, lasted_s)
    told += _cut_short(accounts, cuts, lasted_s)
    return Presented(
        seqs=tuple(account.seq for account in accounts),
        first_ns=min(begun, default=None),
        last_ns=max(ended, default=None),
        trigger_ns=accounts[0].trigger_ns,
        wall_offset_ns=clock.wall_offset_ns() - daemon_clock.offset_ns + lag_ns,
        uncertainty_ns=daemon_clock.uncertainty_ns + lag_ns,
        rate_hz=min(account.rate_hz for account in accounts),
        calibrated_hz=accounts[0].calibrated_hz,
        pulses=pulses,
        wanted_ua=accounts[0].wanted_ua,
        least_ua=tuple(min(filter(None, column), default=0) for column in least),
        most_ua=tuple(map(max, most)),
        delivered_ua=_delivered_ua(accounts, pulses),
        clamped=clamped,
        not_fired=not_fired,
        why_not=tuple(told),
    )


_NEVER: dict[Cut, str] = {
    "replaced": "another frame of the program took its place",
    "disarmed": "the program disarmed before its first scan began",
    "ended": "it was ended before its first scan began",
    "no edge": (
        "no edge of the trigger came while it waited: check the wire, or give a longer wait_s"
    ),
}
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
    accounts: Sequence[Account],
    pulses: Sequence[int],
    fields: dict[str, object],
    lasted_s: float | None,
) -> list[str]:
    """Electrodes without a pulse; and pulses that are missing from what was asked."""
    wanted = [electrode for electrode, ua in enumerate(accounts[0].wanted_ua) if ua]
    told = [
        f"electrode {electrode}: no pulse was fired"
        for electrode in wanted
        if not pulses[electrode]
    ]
    fired, asked = [one for one in wanted if pulses[one]], fields.get("pulses")
    if isinstance(asked, int):
        short = [one for one in fired if pulses[one] < asked]
        return told + [f"electrode {one}: {pulses[one]} of {asked} pulses" for one in short]
    if fired and lasted_s:
        told += _fewer(pulses, fired, _shares(fields, wanted), accounts[0].rate_hz * lasted_s)
    return told


def _shares(fields: dict[str, object], wanted: Sequence[int]) -> dict[int, float]:
    """Of the scan's rate, which the fastest electrodes have."""
    rates_hz = fields.get("rate_hz")
    if not isinstance(rates_hz, list):
        return dict.fromkeys(wanted, 1.0)
    fastest_hz = max(rates_hz[electrode] for electrode in wanted)
    return {electrode: rates_hz[electrode] / fastest_hz for electrode in wanted}


def _fewer(
    pulses: Sequence[int], fired: Sequence[int], shares: dict[int, float], scans: float
) -> list[str]:
    """What scans that came late took from all electrodes; and electrodes that got fewer pulses than
    these scans had for them.
    """
    told, fastest = [], max(fired, key=lambda electrode: (shares[electrode], pulses[electrode]))
    most = pulses[fastest]
    # At either end a scan may be cut.
    if most < min(_ENOUGH * scans - 1, scans - 2):
        told.append(
            f"{most} of about {scans:.0f} pulses were fired: scans came late, or not at all"
        )
    reached = most / (shares[fastest] * scans)
    # In bursts an electrode gets several pulses in a scan.
    burst = max(1, round(reached))
    for electrode in fired:
        about = shares[electrode] * scans * burst
        # A scan may be cut at either end; a slow electrode waits for its turn after that.
        spare = burst if shares[electrode] == 1.0 else 2 * burst
        if pulses[electrode] < _ENOUGH * about * min(1.0, reached / burst) - spare:
            told.append(f"electrode {electrode}: {pulses[electrode]} of about {about:.0f} pulses")
    return told


def _lasted_s(accounts: Sequence[Account], cuts: Sequence[Cut], shown_s: float) -> float | None:
    """For how long it was shown. What has cut it short is noticed later: the engine tells when its
    last frame was over. None: it does not.
    """
    if not {"replaced", "disarmed", "ended", "refused"}.intersection(cuts):
        return shown_s
    over_ns = accounts[-1].ended_ns
    return None if over_ns is None else min(shown_s, (over_ns - accounts[0].begun_ns) / 1e9)


def _cut_short(
    accounts: Sequence[Account], cuts: Sequence[Cut], lasted_s: float | None
) -> list[str]:
    after = "" if lasted_s is None else f" after {lasted_s:.2g} s"
    told = []
    if "replaced" in cuts:
        told.append(f"another frame of the program replaced it{after}")
    if "disarmed" in cuts:
        told.append(f"the program disarmed{after}")
    if "ended" in cuts:
        told.append(f"it was ended{after}")
    if "no edge" in cuts:
        told.append("its edge came as the wait was over: it was silenced at once")
    if "late" in cuts or any(account.ended == "expired" for account in accounts[:-1]):
        told.append("it was renewed too late: give it a longer ttl_ms")
    if "refused" in cuts:
        told.append(f"it was cut short{after}")
    elif any(account.ended == "silenced" for account in accounts):
        told.append("it was silenced")
    return told


def _clamp(clamp: Clamp) -> str:
    return (
        f"electrode {clamp.electrode}: {clamp.allowed_ua} of {clamp.wanted_ua} uA ({clamp.reason}"
        f" of electrode {clamp.limited_by})"
    )


def _shortfall(shortfall: Shortfall) -> str:
    where = "" if shortfall.electrode is None else f"electrode {shortfall.electrode}: "
    if shortfall.reason == "balanced":
        return (
            f"{where}all pulses had both phases, since those of one would leave too much direct"
            " current (balance of the body site)"
        )
    if shortfall.rate_hz is not None:
        return f"{where}slowed to {shortfall.rate_hz:.1f} Hz ({shortfall.reason})"
    if shortfall.lasts_ms is not None:
        hz = shortfall.lasting_hz
        slower = "" if hz is None else f", at {hz:.1f} Hz for ever"
        return f"{where}its net charge lets the frame last {shortfall.lasts_ms} ms{slower}"
    return f"{where}{shortfall.pulses} pulses were not fired ({shortfall.reason})"
