"""What the log says of the state: each change of it, with its cause, and with whose lease.

Owns: the sentence of a change, and which changes have a line of their own whatever clients do.
Must not know: how many of the others have one (`summed_up.py`), how a line is written.

Any client can stop and clear in a loop. So a halt by something else, a fault or a stop line, counts
with those of the same cause alone; and so do the armings of a user, which are not a second each on
a board without a supply to switch: one that lasts has its line in any case.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Final

from etd.gateway.lease import StandingLease
from etd.gateway.summed_up import SummedUp
from etd.protocol.messages import Halt, StateReport
from etd.protocol.who import user_of, who

#: An arming that lasts so long has its line, and so has its end: they cannot be many.
LASTING_NS: Final = 1_000_000_000


@dataclass(slots=True)
class _Arming:
    """The board is armed. `is_told`: the log says so; `line`: what it says."""

    user: str
    begun_ns: int
    line: str
    is_told: bool = False


class StateLog:
    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._changes = SummedUp(log, "changes of state", "HALTED")
        self._armings = SummedUp(log, "beginnings and ends of ARMED", "HALTED")
        self._halts = SummedUp(log, "halts")
        self._now: tuple[str, Halt | None] = "", None
        self._arming: _Arming | None = None

    def heard(self, report: StateReport, lease: StandingLease | None) -> bool:
        """Whether the state has changed. `lease`: the one that stands, as far as is known."""
        before, self._now = self._now, (report.state, report.halt)
        arming = self._arming
        if arming is not None and report.now_ns - arming.begun_ns >= LASTING_NS:
            self._tell_arming(arming)
        if self._now == before:
            return False
        if report.state == "ARMED":
            self._arming = arming = _Arming(_user_of(lease), report.now_ns, _armed(lease))
            if self._armings.has_room(arming.user):
                self._tell_arming(arming)
        else:
            self._tell(report, lease, before[0])
        return True

    def engine_lost(self) -> None:
        """What a new engine reports is a change."""
        if self._arming is not None:
            self._tell_arming(self._arming)
        self._now, self._arming = ("", None), None

    def sum_up(self) -> None:
        """What had no line of its own."""
        for each in (self._armings, self._changes, self._halts):
            each.sum_up()

    def _tell_arming(self, arming: _Arming, *, always: bool = True) -> None:
        """Once."""
        if not arming.is_told:
            arming.is_told = self._armings.tell(
                arming.user, logging.INFO, arming.line, always=always
            )

    def _tell(self, report: StateReport, lease: StandingLease | None, before: str) -> None:
        """A change to another state than ARMED; `before`: the state that it ends."""
        halt, (arming, self._arming) = report.halt, (self._arming, None)
        cause = "" if halt is None or halt.cause == "stop" else f"{halt.cause} ({halt.source})"
        if arming is not None:
            self._tell_arming(arming, always=bool(cause) and self._halts.has_room(cause))
        if cause:
            lines, whose = self._halts, cause
        elif arming is not None:
            lines, whose = self._armings, arming.user
        else:
            lines = self._changes
            whose = _user_of(lease) if halt is None else user_of(halt.source)
        is_told = arming is not None and arming.is_told
        lines.tell(whose, *_sentence(report, before), always=is_told)


def _user_of(lease: StandingLease | None) -> str:
    return "" if lease is None else f"user {lease.uid}"


def _armed(lease: StandingLease | None) -> str:
    return "ARMED" if lease is None else f"ARMED: the lease of {who(lease.client, lease.uid)}"


def _sentence(report: StateReport, before: str) -> tuple[int, str]:
    """With its level."""
    halt = report.halt
    if halt is not None:
        return logging.ERROR, f"HALTED by {halt.cause} ({halt.source}): {halt.detail}"
    if before == "HALTED":
        return logging.INFO, f"{report.state}: the halt was cleared"
    if report.state == "SAFE" and report.last_disarm:
        return logging.INFO, f"SAFE: {report.last_disarm}"
    return logging.INFO, report.state
