"""The fake's time.

Owns: how the fake's clock moves, stepped and live. Must not know: how long a call takes
(`machines.py`), and computing (`processor.py`).
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable
from itertools import count
from typing import Protocol

from etd_hal.fake.processor import Call, Processor
from etd_hal.ports import SPIN_NS, Clock, Wait, WakingClock
from etd_hal.wakeups import NotingClock, WakeUps

#: An arbitrary start well above zero, so that a forgotten "0 means never" shows.
START_NS = 1_000_000_000

#: A lag up to this is made up for by shorter waits; a longer one stays.
_MADE_UP_NS = 10_000_000


class BoardClock(NotingClock, Protocol):
    """A clock that the fake board can spend time on."""

    @property
    def host(self) -> Clock:
        """The clock of the machine that the fake runs on."""
        ...

    def begin_call(self, call: Call) -> int:
        """The time at which a port call starts: when what was computed before it is over."""
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


class Waking:
    """When a sleep ends on a machine that wakes late: the part before its end is spun as on a real
    one (`wakeups.py`). None: sleeps end exactly, and nothing is known of this machine.
    """

    def __init__(self, late_ns: Callable[[], int] | None) -> None:
        """`late_ns` is called for each sleep."""
        self._late_ns = late_ns
        self.wakeups = WakeUps()

    def end_ns(self, now_ns: int, deadline_ns: int) -> int:
        wake_ns = deadline_ns - self.wakeups.spin_ns
        if self._late_ns is None or wake_ns <= now_ns:
            return deadline_ns
        late_ns = self._late_ns()
        self.wakeups.note(late_ns)
        return max(deadline_ns, wake_ns + late_ns)


class SteppedClock:
    """Time that passes only by being spent or slept: for scripts in one thread.

    `at` puts an action on the way: it runs when time comes to it, also in the middle of a call
    that takes long (a stalled SPI message), as another thread would.

    With a `processor` computing takes time too; otherwise it takes none. With `wake_late_ns` each
    sleep wakes so late.
    """

    def __init__(
        self,
        start_ns: int = START_NS,
        processor: Processor | None = None,
        wake_late_ns: Callable[[], int] | None = None,
    ) -> None:
        self._now_ns = start_ns
        self._processor = processor
        self._waking = Waking(wake_late_ns)
        self.wakeups = self._waking.wakeups
        #: An action is under way: it runs beside the thread that computes.
        self._is_beside = False
        self._actions: list[tuple[int, int, Callable[[], object]]] = []
        self._order = count()

    def now_ns(self) -> int:
        if self._processor is not None:
            self.compute("now")
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.compute("sleep")
        self._move_to(self._waking.end_ns(self._now_ns, deadline_ns))

    def doze_until_ns(self, deadline_ns: int) -> None:
        """Nothing is late here."""
        self.compute("doze")
        self._move_to(deadline_ns)

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        """Nothing comes between two actions: only there is it looked for, and not at the end."""
        self.compute("doze")
        while self._now_ns < deadline_ns and not wait(0.0):
            due_ns = self._actions[0][0] if self._actions else deadline_ns
            self._move_to(min(deadline_ns, max(self._now_ns, due_ns)))

    @property
    def host(self) -> Clock:
        """The same: there is no other time. Reading it is a call of its own to a processor."""
        return self if self._processor is None else _HostClock(self, self)

    def compute(self, call: Call) -> None:
        """What the processor has done until `call` takes its time."""
        if self._processor is not None and not self._is_beside:
            self._move_to(self._now_ns + self._processor.cost_ns(call))
            self._processor.resume()

    def spend(self, duration_ns: int) -> None:
        """Let time pass, as computing does."""
        self._move_to(self._now_ns + duration_ns)

    def at(self, t_ns: int, action: Callable[[], object]) -> None:
        """Run `action` when time comes to `t_ns`; actions of one time run in the order given."""
        heapq.heappush(self._actions, (t_ns, next(self._order), action))

    def begin_call(self, call: Call) -> int:
        self.compute(call)
        return self._now_ns

    def begin_message(self) -> int:
        return self.begin_call("message")

    def end_call(self, end_ns: int) -> None:
        self._move_to(end_ns)

    def end_side_call(self, end_ns: int) -> None:
        self._move_to(end_ns)

    def _move_to(self, t_ns: int) -> None:
        while self._actions and self._actions[0][0] <= t_ns:
            due_ns, _, action = heapq.heappop(self._actions)
            self._now_ns = max(self._now_ns, due_ns)
            was_beside, self._is_beside = self._is_beside, True
            action()
            self._is_beside = was_beside
        if self._now_ns < t_ns:
            self._now_ns = t_ns


class LiveClock:
    """Fake time beside the real one: it never runs ahead of it, and may lag.

    Only what is modelled moves it: a call by what it costs, a sleep to its deadline. Either then
    waits for the real clock, so that both pass alike on an idle machine. What the machine takes
    besides (computing, waking late, being stopped) is lag, and no part of any call, rest or sleep.
    A short lag is made up for by the next waits, which are shorter; a longer one stays, and time
    goes on from where it is. So a machine that is held up makes the fake late, and never faulty:
    this time does not jump.

    Time follows the thread that plays SPI messages. Others read the same time, but their sleeps
    do not move it: a sensor's thread must not make a message look longer.

    With a `processor` what that thread computes moves time as well; with `wake_late_ns` its sleeps
    wake so late.
    """

    def __init__(
        self,
        real: WakingClock,
        processor: Processor | None = None,
        wake_late_ns: Callable[[], int] | None = None,
    ) -> None:
        self._real = real
        self._processor = processor
        self._waking = Waking(wake_late_ns)
        self.wakeups = self._waking.wakeups
        self._now_ns = real.now_ns()
        #: The lag that stays.
        self._behind_ns = 0
        self._lock = threading.Lock()
        self._player: int | None = None
        self._asleep_until_ns: int | None = None

    @property
    def host(self) -> Clock:
        return self._real if self._processor is None else _HostClock(self, self._real)

    def compute(self, call: Call) -> None:
        """What the processor has done until `call` takes its time."""
        if self._processor is None or self._player != threading.get_ident():
            return
        with self._lock:
            self._now_ns += self._processor.cost_ns(call)
        self._real.sleep_until_ns(self._now_ns + self._behind_ns)
        self._keep_lag()
        self._processor.resume()

    def now_ns(self) -> int:
        """While a call waits for its end, the others see time go on; never ahead of the real."""
        self.compute("now")
        return self._reading_ns()

    def _reading_ns(self) -> int:
        with self._lock:
            paced_ns = self._real.now_ns() - self._behind_ns
            until_ns = self._asleep_until_ns
            if until_ns is not None:
                # While its player sleeps, time goes on as the real one does.
                self._now_ns = max(self._now_ns, min(paced_ns, until_ns))
            return min(self._now_ns, paced_ns)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        if self._is_player():
            self.compute("sleep")
            self._sleep_as_player(self._waking.end_ns(self._now_ns, deadline_ns))
            return
        while (left_ns := deadline_ns - self.now_ns()) > 0:
            self._real.sleep_until_ns(self._real.now_ns() + left_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        """Time that is played lags behind: only the exact sleep catches up with it."""
        self.sleep_until_ns(deadline_ns)

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        """A process that is woken goes on at the time to which the machine's clock has come."""
        if not self._is_player():
            self.sleep_until_ns(deadline_ns)
            return
        self.compute("sleep")
        if deadline_ns <= self._now_ns:
            return
        self._asleep_until_ns = deadline_ns
        exact_from_ns = deadline_ns + self._behind_ns - SPIN_NS
        self._real.doze_until_woken(exact_from_ns, wait)
        is_woken = self._real.now_ns() < exact_from_ns
        self._reading_ns()
        self._asleep_until_ns = None
        if is_woken:
            self._keep_lag()
            self._resume()
        else:
            self._sleep_as_player(deadline_ns)

    def begin_call(self, call: Call) -> int:
        self.compute(call)
        return self._reading_ns()

    def begin_message(self) -> int:
        if self._player != threading.get_ident():
            self._player = threading.get_ident()
            self._resume()
        return self.begin_call("message")

    def end_call(self, end_ns: int) -> None:
        with self._lock:
            self._now_ns = max(self._now_ns, end_ns)
        self._real.sleep_until_ns(end_ns + self._behind_ns)
        if self._is_player():
            self._keep_lag()
            self._resume()

    def end_side_call(self, end_ns: int) -> None:
        self._real.sleep_until_ns(end_ns + self._behind_ns)

    def _is_player(self) -> bool:
        return self._player is None or self._player == threading.get_ident()

    def _sleep_as_player(self, deadline_ns: int) -> None:
        if deadline_ns <= self._now_ns:
            return
        self._asleep_until_ns = deadline_ns
        self._real.sleep_until_ns(deadline_ns + self._behind_ns)
        with self._lock:
            self._asleep_until_ns = None
            self._now_ns = max(self._now_ns, deadline_ns)
        self._keep_lag()
        self._resume()

    def _resume(self) -> None:
        if self._processor is not None:
            self._processor.resume()

    def _keep_lag(self) -> None:
        """Of a lag that is too long to be made up for nothing is."""
        with self._lock:
            lag_ns = self._real.now_ns() - self._behind_ns - self._now_ns
            if lag_ns > _MADE_UP_NS:
                self._behind_ns += lag_ns


class _HostClock:
    """The machine's clock, which a program reads between two calls of the board."""

    def __init__(self, board: SteppedClock | LiveClock, real: Clock) -> None:
        self._board = board
        self._real = real

    def now_ns(self) -> int:
        self._board.compute("host")
        return self._real.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._real.sleep_until_ns(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self._real.doze_until_ns(deadline_ns)
