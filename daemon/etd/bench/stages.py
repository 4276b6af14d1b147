"""The stages of a pulse, told apart by the calls that the engine makes between them.

Owns: which call ends which stage, and the time of each stage in each pulse. Must not know: what is
done in a stage: the engine is not told that it is measured.

| stage | from | to |
|---|---|---|
| look and limit | the poll's look at the clock | the wait for the rest |
| connect | the end of that wait | the call that connects |
| book and send | that call | the message |
| correct and check | the end of the message | the call that discharges |
| store and report | that call | the next poll's look at the clock |

Times are of the processor, for this thread alone, and each reading of that clock is taken out
again. A probe before its pulse is part of the pulse: its message ends one stage and begins another,
as the pulse's own does.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from itertools import pairwise

import msgspec

from etd_hal.unwired import Mark

STAGES = (
    "look and limit",
    "connect",
    "book and send",
    "correct and check",
    "store and report",
)
_LIMIT, _CONNECT, _SEND, _CHECK, _STORE = range(len(STAGES))
_READINGS = 201
#: Which call ends a stage, and the stage that follows.
_ENDS: dict[int, tuple[Mark | str, int]] = {
    _LIMIT: ("rest", _CONNECT),
    _CONNECT: ("set", _SEND),
    _CHECK: ("set", _STORE),
    _STORE: ("look", _LIMIT),
}


class Stage(msgspec.Struct, frozen=True):
    """Of all measured pulses, in us."""

    name: str
    median_us: float
    p99_us: float


class StageMeter:
    """See the module. Its methods are called by the ports and the host's clock."""

    def __init__(self, processor_ns: Callable[[], int]) -> None:
        self._now_ns = processor_ns
        self._reading_ns = _cost_of(processor_ns)
        self._stage = _STORE
        self._since_ns = 0
        self._pulse = [0] * len(STAGES)
        #: By pulse, the time of each stage in ns.
        self.pulses: list[list[int]] = []

    def mark(self, mark: Mark, value: int) -> None:
        """A call of a port. A message at code 0 is part of the stage that it falls into."""
        if mark == "message" and value:
            self._pass_to(_SEND)
        elif mark == "ended":
            # What a message takes is the port's own time, and not the engine's.
            self._since_ns = self._now_ns()
            if value:
                self._stage = _CHECK
        else:
            self._end_with(mark)

    def look(self) -> None:
        """The poll looks at the host's clock."""
        self._end_with("look")

    def _end_with(self, call: str) -> None:
        ending = _ENDS.get(self._stage)
        if ending is not None and ending[0] == call:
            self._pass_to(ending[1])
            if call == "look":
                self.pulses.append(self._pulse)
                self._pulse = [0] * len(STAGES)

    def _pass_to(self, stage: int) -> None:
        now_ns = self._now_ns()
        self._pulse[self._stage] += max(0, now_ns - self._since_ns - self._reading_ns)
        self._stage, self._since_ns = stage, now_ns


def _cost_of(processor_ns: Callable[[], int]) -> int:
    """What one reading of the clock takes."""
    readings = [processor_ns() for _ in range(_READINGS)]
    return int(statistics.median(after - before for before, after in pairwise(readings)))


def stages_of(pulses: Sequence[Sequence[int]]) -> tuple[Stage, ...]:
    return tuple(
        summed(name, [pulse[place] for pulse in pulses]) for place, name in enumerate(STAGES)
    )


def summed(name: str, times_ns: Sequence[int]) -> Stage:
    """Median and 99th percentile of some times."""
    ordered = sorted(times_ns)
    p99_ns = ordered[math.ceil(0.99 * (len(ordered) - 1))]
    return Stage(name, statistics.median(ordered) / 1_000, p99_ns / 1_000)
