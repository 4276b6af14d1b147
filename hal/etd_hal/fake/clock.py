"""The fake's time.

Owns: how the fake's clock moves, stepped and live. Must not know: what takes time (`pi4.py`).
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable
from itertools import count
from typing import Protocol

from etd_hal.ports import Clock

#: An arbitrary start well above zero, so that a forgotten "0 means never" shows.
START_NS = 1_000_000_000

#: A sleeper that wakes later than this has been stalled: the lag is given up.
_GIVE_UP_ASLEEP_NS = 10_000_000
#: The same for a thread that is awake. It is longer, so that a processor that was taken away for
#: a moment beside a message does not look like a message that took too long.
_GIVE_UP_AWAKE_NS = 100_000_000


class BoardClock(Protocol):
    """A Clock that the fake board can spend time on."""

    def now_ns(self) -> int: ...

    def sleep_until_ns(self, deadline_ns: int) -> None: ...

    def doze_until_ns(self, deadline_ns: int) -> None: ...

    def lag_ns(self) -> int:
        """How far it is behind the real clock."""
        ...

    def begin_call(self) -> int:
        """The time at which a port call starts."""
        ...

    def begin_message(self) -> int:
        """The same for an SPI message: the thread that plays messages is whom time follows."""
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

    def doze_until_ns(self, deadline_ns: int) -> None:
        """Nothing is late here."""
        self._move_to(deadline_ns)

    def lag_ns(self) -> int:
        """There is no real clock beside it."""
        return 0

    def spend(self, duration_ns: int) -> None:
        """Let time pass, as computing does."""
        self._move_to(self._now_ns + duration_ns)

    def at(self, t_ns: int, action: Callable[[], object]) -> None:
        """Run `action` when time comes to `t_ns`; actions of one time run in the order given."""
        heapq.heappush(self._actions, (t_ns, next(self._order), action))

    def begin_call(self) -> int:
        return self._now_ns

    def begin_message(self) -> int:
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


class LiveClock:
    """Fake time beside the real one: it never runs ahead of it, and may lag.

    Within a call time passes exactly as the cost model says, and the call then waits for the real
    clock. What computing and waking late cost shows as lag, not as a longer call; the next sleep
    takes it back. A lag beyond a bound is given up in one jump, and counted in `jumps`.

    Time follows the thread that plays SPI messages. Others read the same time, but their sleeps
    do not move it: a sensor's thread must not make a message look longer.
    """

    def __init__(self, real: Clock) -> None:
        self._real = real
        self._now_ns = real.now_ns()
        self._lock = threading.Lock()
        self._player: int | None = None
        self._asleep_until_ns: int | None = None
        self.jumps = 0

    def now_ns(self) -> int:
        """While a call waits for its end, the others see time go on; never ahead of the real."""
        with self._lock:
            self._catch_up()
            return min(self._now_ns, self._real.now_ns())

    def lag_ns(self) -> int:
        """How far this time is behind the real one."""
        with self._lock:
            return max(0, self._real.now_ns() - self._now_ns)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        if self._player is None or self._player == threading.get_ident():
            self._sleep_as_player(deadline_ns)
            return
        self._real.sleep_until_ns(deadline_ns)
        while (now_ns := self.now_ns()) < deadline_ns:
            self._real.sleep_until_ns(self._real.now_ns() + deadline_ns - now_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        """Time that is played lags behind: only the exact sleep catches up with it."""
        self.sleep_until_ns(deadline_ns)

    def begin_call(self) -> int:
        return self.now_ns()

    def begin_message(self) -> int:
        self._player = threading.get_ident()
        return self.now_ns()

    def end_call(self, end_ns: int) -> None:
        with self._lock:
            self._now_ns = max(self._now_ns, end_ns)
        self._real.sleep_until_ns(end_ns)

    def end_side_call(self, end_ns: int) -> None:
        self._real.sleep_until_ns(end_ns)

    def _sleep_as_player(self, deadline_ns: int) -> None:
        if deadline_ns <= self._now_ns:
            return
        self._asleep_until_ns = deadline_ns
        self._real.sleep_until_ns(deadline_ns)
        with self._lock:
            self._asleep_until_ns = None
            self._now_ns = max(self._now_ns, deadline_ns)
            self._give_up_lag(_GIVE_UP_ASLEEP_NS)

    def _catch_up(self) -> None:
        """While its player sleeps, time goes on as the real one does."""
        until_ns = self._asleep_until_ns
        if until_ns is not None:
            self._now_ns = max(self._now_ns, min(self._real.now_ns(), until_ns))
        self._give_up_lag(_GIVE_UP_AWAKE_NS)

    def _give_up_lag(self, bound_ns: int) -> None:
        real_ns = self._real.now_ns()
        if real_ns - self._now_ns > bound_ns:
            self._now_ns = real_ns
            self.jumps += 1
