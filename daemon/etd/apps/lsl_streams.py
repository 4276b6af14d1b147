"""The daemon's telemetry as samples of two streams: events, and contact by electrode.

Owns: what becomes a sample, and its time stamp. Must not know: the Lab Streaming Layer itself (an
`Outlet` takes the samples), the terminal, where the reports come from.

A sample is stamped with when it happened, not with when it was told: a frame with its first pulse.
Stamps are seconds of this computer's CLOCK_MONOTONIC, which is liblsl's own clock on Linux
(`std::chrono::steady_clock`, src/common.cpp of liblsl).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Protocol

import msgspec

from etd.client.daemon_clock import DaemonClock
from etd.protocol.messages import (
    Contact,
    ContactState,
    Halt,
    Marked,
    Scan,
    Shown,
    StateReport,
)

#: Frames that were told already, so that each is one event: more than come between two reports.
_REMEMBERED = 1_024
_TOUCHED: dict[ContactState, float] = {"open": 0.0, "soft": 1.0, "closed": 1.0, "shorted": 1.0}


class Outlet(Protocol):
    """One stream."""

    def push(self, sample: Sequence[str | float], stamp_s: float) -> None:
        """Hand a sample to the stream's listeners. Never blocks."""
        ...


class Streams:
    """See the module. The caller, which talks to the daemon, keeps `daemon_clock` up to date."""

    def __init__(self, daemon_clock: DaemonClock, events: Outlet, contact: Outlet) -> None:
        self._daemon_clock = daemon_clock
        self._events = events
        self._contact = contact
        #: How far the board's clock is behind its machine's; a fake's alone is.
        self._lag_us = 0
        self._state = ""
        #: (seq, when it was begun): a new lease numbers its frames anew.
        self._told: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)
        #: Of the newest frame with a pulse: seq and tag.
        self._newest: tuple[int, int | None] | None = None
        #: How many were pushed.
        self.events = 0

    def hear(self, report: object) -> None:
        """Any telemetry report."""
        match report:
            case StateReport():
                self._lag_us = report.clock_lag_us
                if report.state != self._state:
                    self._state = report.state
                    self._event(f"state/{report.state}", report.now_ns, {})
            case Scan():
                for shown in report.shown:
                    self._frame(shown)
                self._fired_contact(report)
            case Contact():
                touched = [math.nan if one is None else float(one) for one in report.contact]
                self._contact.push(touched, self.stamp_s(report.t_ns))
            case Marked():
                facts = {"marked_ns": report.marked_ns, "sync": report.sync}
                self._event(_named("mark", report.tag), report.marked_ns, facts)
            case Halt():
                self._event(f"halt/{report.source}", report.t_ns, {"cause": report.cause})

    def stamp_s(self, board_ns: int) -> float:
        """A time of the board, on this computer's CLOCK_MONOTONIC."""
        here_ns = board_ns + 1_000 * self._lag_us - self._daemon_clock.offset_ns
        whole_s, rest_ns = divmod(here_ns, 1_000_000_000)
        return whole_s + rest_ns / 1e9

    def _frame(self, shown: Shown) -> None:
        """Once its first pulse is known; a silent frame is no event. One that renews the frame
        before it, as longer presentations do, has a name of its own.
        """
        key = shown.seq, shown.begun_ns
        if shown.first_ns is None or key in self._told:
            return
        self._told.append(key)
        is_renewal = self._newest is not None and self._newest == (shown.replaces, shown.tag)
        self._newest = shown.seq, shown.tag
        facts = {"seq": shown.seq, "first_ns": shown.first_ns}
        if shown.trigger_ns is not None:
            facts["trigger_ns"] = shown.trigger_ns
        name = _named("renewed" if is_renewal else "frame", shown.tag)
        self._event(name, shown.first_ns, facts)

    def _fired_contact(self, scan: Scan) -> None:
        """Of the electrodes that were fired; the others are not known by it."""
        if any(state is not None for state in scan.fired.contact):
            touched = [
                math.nan if state is None else _TOUCHED.get(state, math.nan)
                for state in scan.fired.contact
            ]
            self._contact.push(touched, self.stamp_s(scan.now_ns))

    def _event(self, name: str, board_ns: int, facts: Mapping[str, object]) -> None:
        """Two channels: the name, which experiments select by, and all else as a JSON object."""
        clock = self._daemon_clock
        within = {"clock_lag_us": self._lag_us, "within_ns": clock.uncertainty_ns}
        told = msgspec.json.encode({**facts, **within}).decode()
        self._events.push([name, told], self.stamp_s(board_ns))
        self.events += 1


def _named(what: str, tag: object) -> str:
    return what if tag is None else f"{what}/{tag}"
