"""What the log says of the state: each change of it, with its cause, and whose it was.

Owns: the sentence of a change, and which changes have a line of their own whatever clients do.
Must not know: how many of the others have one (`summed_up.py`), how a line is written.

Any client can stop and clear in a loop. So a halt by something else, a fault or a stop line, counts
with those of the same cause alone; and so do the armings of a user, which are not a second each on
a board without a supply to switch: one that lasts has its line in any case.

The engine reports a change before it answers who asked for it: that line waits for the answer.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Final, Literal

from etd.gateway.lease import StandingLease
from etd.gateway.summed_up import SummedUp
from etd.protocol.messages import Halt, StateReport
from etd.protocol.who import user_of, who

#: What a client asks for that leads to ARMED, or out of HALTED.
Act = Literal["arm", "clear"]
#: An arming that lasts so long has its line, and so has its end: they cannot be many.
LASTING_NS: Final = 1_000_000_000


@dataclass(slots=True)
class _Arming:
    """The board is armed, with this lease. `by`: who asked for it; `is_told`: the log says so."""

    lease: StandingLease | None
    begun_ns: int
    by: str = ""
    is_told: bool = False

    @property
    def line(self) -> str:
        lease = self.lease
        of = "" if lease is None else f": the lease of {who(lease.client, lease.uid)}"
        return f"ARMED{_by(self.by)}{of}"


class StateLog:
    def __init__(self, log: logging.Logger) -> None:
        self._changes = SummedUp(log, "changes of state", "HALTED")
        self._armings = SummedUp(log, "beginnings and ends of ARMED", "HALTED")
        self._halts = SummedUp(log, "halts")
        self._now: tuple[str, Halt | None] = "", None
        self._arming: _Arming | None = None
        #: The act that has led to the state, while it is not answered.
        self._awaited: Act | None = None

    def heard(self, report: StateReport, lease: StandingLease | None) -> bool:
        """Whether the state has changed. `lease`: the one that stands, as far as is known."""
        self._go_on()
        before, self._now = self._now, (report.state, report.halt)
        arming = self._arming
        if arming is not None and report.now_ns - arming.begun_ns >= LASTING_NS:
            self._tell_arming(arming)
        if self._now == before:
            return False
        if report.state == "ARMED":
            self._arming, self._awaited = _Arming(lease, report.now_ns), "arm"
        elif before[0] == "HALTED" and report.halt is None:
            self._awaited = "clear"
        else:
            self._tell(report, lease)
        return True

    def done(self, act: Act, user: str) -> None:
        """It was answered, which is right after the report of what it has changed, if it has."""
        if act == self._awaited:
            self._go_on(user)

    def engine_lost(self) -> None:
        """What a new engine reports is a change."""
        self.close()
        self._now, self._arming = ("", None), None

    def close(self) -> None:
        """Nothing is to come."""
        self._go_on()
        if self._arming is not None:
            self._tell_arming(self._arming)

    def sum_up(self) -> None:
        """What had no line of its own."""
        for each in (self._armings, self._changes, self._halts):
            each.sum_up()

    def _go_on(self, user: str = "") -> None:
        """The act that was waited for was this user's; "": it is not known whose."""
        (awaited, self._awaited), arming = (self._awaited, None), self._arming
        if awaited == "clear":
            line = f"{self._now[0]}: the halt was cleared{_by(user)}"
            self._changes.tell(user, logging.INFO, line)
        elif awaited == "arm" and arming is not None:
            arming.by = user
            if self._armings.has_room(_user_of(arming.lease)):
                self._tell_arming(arming)

    def _tell_arming(self, arming: _Arming, *, always: bool = True) -> None:
        """Once."""
        if not arming.is_told:
            user = _user_of(arming.lease)
            arming.is_told = self._armings.tell(user, logging.INFO, arming.line, always=always)

    def _tell(self, report: StateReport, lease: StandingLease | None) -> None:
        """A change that needs no act of a client, or names the client itself."""
        halt, (arming, self._arming) = report.halt, (self._arming, None)
        cause = "" if halt is None or halt.cause == "stop" else f"{halt.cause} ({halt.source})"
        if arming is not None:
            self._tell_arming(arming, always=bool(cause) and self._halts.has_room(cause))
        if cause:
            lines, whose = self._halts, cause
        elif arming is not None:
            lines, whose = self._armings, _user_of(arming.lease)
        else:
            lines = self._changes
            whose = _user_of(lease) if halt is None else user_of(halt.source)
        is_told = arming is not None and arming.is_told
        lines.tell(whose, *_sentence(report), always=is_told)


def _user_of(lease: StandingLease | None) -> str:
    return "" if lease is None else f"user {lease.uid}"


def _by(user: str) -> str:
    return f" by {user}" if user else ""


def _sentence(report: StateReport) -> tuple[int, str]:
    """With its level."""
    halt = report.halt
    if halt is not None:
        return logging.ERROR, f"HALTED by {halt.cause} ({halt.source}): {halt.detail}"
    if report.state == "SAFE" and report.last_disarm:
        return logging.INFO, f"SAFE: {report.last_disarm}"
    return logging.INFO, report.state
