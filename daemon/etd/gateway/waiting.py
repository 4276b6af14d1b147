"""Requests that wait for the engine's answer.

Owns: refs, their bound, and how long one may wait. Must not know: what was asked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from etd.errors import Refused
from etd.gateway.letters import Letter
from etd.link import Answer
from etd.protocol import Id, Success

#: More than these under way are refused.
MOST = 32
#: Stops have places of their own, so that they are answered when everything else is full.
MOST_STOPS = 32
#: Arming may take seconds; an engine that says nothing for this long does not answer at all.
LONGEST_NS = 15_000_000_000


@dataclass(frozen=True, slots=True)
class Waiting:
    """`done` makes the reply out of an answer without an error."""

    letter: Letter
    id: Id | None
    done: Callable[[Answer], Success]
    deadline_ns: int
    is_stop: bool = False


class WaitingRoom:
    """Numbered from 1; 0 would ask the engine for no answer."""

    def __init__(self) -> None:
        self._waiting: dict[int, Waiting] = {}
        self._last_ref = 0

    def next_ref(self, is_stop: bool = False) -> int:
        """A ref to send along. Raises: Refused (`busy`) if too many wait already."""
        same = sum(one.is_stop == is_stop for one in self._waiting.values())
        if same >= (MOST_STOPS if is_stop else MOST):
            raise Refused("busy", f"{same} requests wait for the engine already: send again")
        self._last_ref += 1
        return self._last_ref

    def add(self, ref: int, waiting: Waiting) -> None:
        """Once the command with this ref is on its way."""
        self._waiting[ref] = waiting

    def take(self, ref: int) -> Waiting | None:
        """Who asked, or None if nobody waits for this any more."""
        return self._waiting.pop(ref, None)

    def take_all(self) -> list[Waiting]:
        """Everybody: the engine is gone."""
        everybody = list(self._waiting.values())
        self._waiting.clear()
        return everybody

    def take_late(self, now_ns: int) -> list[Waiting]:
        """Those whose time is up."""
        late = [ref for ref, one in self._waiting.items() if one.deadline_ns <= now_ns]
        return [self._waiting.pop(ref) for ref in late]
