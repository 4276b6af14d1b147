"""The pulses of a record beside those of its replay: the same, another, missing, or one more.

Owns: which pulse belongs to which, and what counts as the same. Must not know: engines, records.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import msgspec

from etd.protocol.pulse_row import PulseRow

#: The same pulse of both is at most so far apart: no electrode has two within that.
_APART_NS = 4_000_000
_POLLS_APART_NS = 250_000_000
#: Differences that are told, of all that are counted.
_TOLD = 20


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """One of the two is None where a pulse has no partner."""

    recorded: PulseRow | None
    replayed: PulseRow | None

    def __str__(self) -> str:
        if self.recorded is None and self.replayed is not None:
            return f"{_short(self.replayed)}: in the replay only"
        if self.replayed is None and self.recorded is not None:
            return f"{_short(self.recorded)}: in the record only"
        return f"{_short(self.recorded)} in the record, {_short(self.replayed)} in the replay"


class Comparison(msgspec.Struct, kw_only=True):
    """How many pulses were the same, and the first of the others. `latest_us`: by how much a pulse
    of the replay began at another time at most.

    Contact polls are counted apart: which of two scans polls an electrode is decided by
    microseconds, since it is due after a whole number of scans. `polls_alone` have no partner
    within `_POLLS_APART_NS`; what polls lead to shows in the pulses.

    `lost`: fired, and not in the record, so nothing is known of them. `refused`: what the engine of
    the replay did not accept, or why it halted, a sentence each. With either it is not the same.
    """

    polls: int = 0
    polls_alone: int = 0
    same: int = 0
    other: int = 0
    missing: int = 0
    more: int = 0
    latest_us: float = 0.0
    differences: list[Difference] = []
    lost: int = 0
    refused: tuple[str, ...] = ()

    @property
    def is_same(self) -> bool:
        return not (self.other or self.missing or self.more or self.lost or self.refused)


class Comparer:
    """Tell it the pulses of both, each in their order; `done` at the end."""

    def __init__(self, step_ua: float) -> None:
        """`step_ua`: of the DAC. Currents a step apart are the same."""
        self._step_ua = step_ua
        self._recorded: deque[PulseRow] = deque()
        self._replayed: deque[PulseRow] = deque()
        self._polls = _Polls()
        self.result = Comparison()

    def recorded(self, row: PulseRow) -> None:
        if row.purpose == "poll":
            self._polls.add(row, is_recorded=True)
            return
        self._recorded.append(row)
        self._match()

    def replayed(self, row: PulseRow) -> None:
        if row.purpose == "poll":
            self._polls.add(row, is_recorded=False)
            return
        self._replayed.append(row)
        self._match()

    def lost(self, pulses: int) -> None:
        """The record lacks so many."""
        self.result.lost += pulses

    def done(self, refused: Sequence[str] = ()) -> Comparison:
        self.result.refused = tuple(refused)
        self.result.polls, self.result.polls_alone = self._polls.pairs, self._polls.alone
        for row in self._recorded:
            self._differ(row, None)
        for row in self._replayed:
            self._differ(None, row)
        return self.result

    def _match(self) -> None:
        """In the order of time: the earlier of two that do not belong together has no partner."""
        while self._recorded and self._replayed:
            ours, theirs = self._recorded[0], self._replayed[0]
            if _key(ours) == _key(theirs) and abs(ours.t_ns - theirs.t_ns) <= _APART_NS:
                self._judge(self._recorded.popleft(), self._replayed.popleft())
            elif ours.t_ns <= theirs.t_ns:
                self._differ(self._recorded.popleft(), None)
            else:
                self._differ(None, self._replayed.popleft())

    def _judge(self, ours: PulseRow, theirs: PulseRow) -> None:
        self.result.latest_us = max(self.result.latest_us, abs(ours.t_ns - theirs.t_ns) / 1_000)
        pairs = (
            (ours.current_ua, theirs.current_ua),
            (ours.prepulse_ua, theirs.prepulse_ua),
        )
        is_same = ours.wanted_ua == theirs.wanted_ua and all(
            abs(one - other) <= self._step_ua + 1 for one, other in pairs
        )
        if is_same and abs(ours.width_us - theirs.width_us) <= 1.0:
            self.result.same += 1
        else:
            self._differ(ours, theirs)

    def _differ(self, ours: PulseRow | None, theirs: PulseRow | None) -> None:
        """A pulse that was withheld in one and not due in the other is none in both."""
        if not (ours and ours.current_ua) and not (theirs and theirs.current_ua):
            return
        if ours is None:
            self.result.more += 1
        elif theirs is None:
            self.result.missing += 1
        else:
            self.result.other += 1
        if len(self.result.differences) < _TOLD:
            self.result.differences.append(Difference(recorded=ours, replayed=theirs))


class _Polls:
    """Of each electrode those of one side that wait for the other's."""

    def __init__(self) -> None:
        self.pairs = 0
        self._alone = 0
        self._waiting: dict[int, tuple[bool, deque[int]]] = {}

    @property
    def alone(self) -> int:
        return self._alone + sum(len(times) for _, times in self._waiting.values())

    def add(self, row: PulseRow, *, is_recorded: bool) -> None:
        if not row.current_ua:
            return
        whose, times = self._waiting.setdefault(row.electrode, (is_recorded, deque()))
        while times and row.t_ns - times[0] > _POLLS_APART_NS:
            times.popleft()
            self._alone += 1
        if times and whose is not is_recorded:
            times.popleft()
            self.pairs += 1
            return
        self._waiting[row.electrode] = (is_recorded, times)
        times.append(row.t_ns)


def _key(row: PulseRow) -> tuple[object, ...]:
    return row.purpose, row.electrode, row.seq, row.polarity


def _short(row: PulseRow | None) -> str:
    if row is None:
        return "nothing"
    frame = "" if row.seq is None else f" of frame {row.seq}"
    return (
        f"{row.purpose}{frame} at electrode {row.electrode}, {row.current_ua} uA for"
        f" {row.width_us:g} us"
    )
