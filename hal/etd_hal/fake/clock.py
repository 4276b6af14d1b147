"""The fake's time.

Owns: how the fake's clock moves, stepped and live. Must not know: what takes time (`pi4.py`).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import count
from typing import Protocol

#: An arbitrary start well above zero, so that a forgotten "0 means never" shows.
START_NS = 1_000_000_000


class BoardClock(Protocol):
    """A Clock that the fake board can spend time on."""

    def now_ns(self) -> int: ...

    def sleep_until_ns(self, deadline_ns: int) -> None: ...

    def begin_call(self) -> int:
        """The time at which a port call starts."""
        ...

    def end_call(self, end_ns: int) -> None:
        """Return when the call that lasts until `end_ns` is over."""
        ...

    def end_side_call(self, end_ns: int) -> None:
        """The same for a call that runs beside the others (I2C, from the sensor thread)."""
        ...


class SteppedClock:
    """Time that passes only by being spent or slept: for scripts in one thread.

    `at` puts an action on the way: it runs when time comes to it, also in the middle of a call
    that takes long (a stalled SPI message), as another thread would.
    """

    def __init__(self, start_ns: int = START_NS) -> None:
        self._now_ns = start_ns
        self._actions: list[tuple[int, int, Callable[[], object]]] = []
        self._order = count()

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._move_to(deadline_ns)

    def spend(self, duration_ns: int) -> None:
        """Let time pass, as computing does."""
        self._move_to(self._now_ns + duration_ns)

    def at(self, t_ns: int, action: Callable[[], object]) -> None:
        """Run `action` when time comes to `t_ns`; actions of one time run in the order given."""
        heapq.heappush(self._actions, (t_ns, next(self._order), action))

    def begin_call(self) -> int:
        return self._now_ns

    def end_call(self, end_ns: int) -> None:
        self._move_to(end_ns)

    def end_side_call(self, end_ns: int) -> None:
        self._move_to(end_ns)

    def _move_to(self, t_ns: int) -> None:
        while self._actions and self._actions[0][0] <= t_ns:
            due_ns, _, action = heapq.heappop(self._actions)
            self._now_ns = max(self._now_ns, due_ns)
            action()
        self._now_ns = max(self._now_ns, t_ns)
