"""Keeps the scan thread below the busy time at which the kernel throttles it.

Owns: the busy time of the loop in any 100 ms, and when it must pause. Must not know: what keeps
it busy; how one knows what the kernel does.

A real-time thread that never sleeps is taken off the core by the kernel's throttle, at worst in
the middle of a message: 54 ms with the DAC on were measured. So the loop keeps itself below 80 %,
unless the kernel leaves this core alone and says so (docs/decisions/0051).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from etd.planning.duty import MAX_BUSY_FRACTION, WINDOW_US, busy_fraction
from etd_hal.ports import Wait, WakingClock
from etd_hal.wakeups import WakeUps

WINDOW_NS = int(WINDOW_US * 1_000)
#: How often it looks at what the kernel does.
_LOOK_NS = 50_000_000
#: A shorter pause would mostly be spun, and would not catch up.
_SHORTEST_PAUSE_NS = 1_000_000


def _not_known(_now_ns: int) -> bool:
    return False


def _sleep_ns(busy_fraction: float) -> int:
    """The least sleep in any window."""
    return round((1.0 - busy_fraction) * WINDOW_NS)


class CpuBudget:
    """The WakingClock of the scan thread, which counts its sleep.

    What is spun at the end of each sleep counts as busy. `is_left_alone`: the kernel never takes
    the thread off its core now.
    """

    def __init__(
        self,
        clock: WakingClock,
        wakeups: WakeUps,
        is_left_alone: Callable[[int], bool] = _not_known,
    ) -> None:
        self._clock = clock
        self.wakeups = wakeups
        self._is_left_alone = is_left_alone
        self._next_look_ns = clock.now_ns()
        #: Of any window at most this part.
        self.busy_fraction = MAX_BUSY_FRACTION
        self._sleep_ns = _sleep_ns(MAX_BUSY_FRACTION)
        self.now_ns = clock.now_ns
        # (end, length) of each sleep in the window; before the start it slept.
        self._sleeps: deque[tuple[int, int]] = deque([(clock.now_ns(), WINDOW_NS)])
        self._slept_ns = WINDOW_NS
        #: All that was waited for so far, what was spun included.
        self.waited_ns = 0
        #: How often it dozed: where nothing is due, once after each poll.
        self.dozes = 0

    def sleep_until_ns(self, deadline_ns: int) -> None:
        spin_ns = self.wakeups.spin_ns
        slept_ns = deadline_ns - self._clock.now_ns() - spin_ns
        self._clock.sleep_until_ns(deadline_ns)
        self.waited_ns += max(0, slept_ns + spin_ns)
        if slept_ns > 0:
            self._sleeps.append((deadline_ns - spin_ns, slept_ns))
            self._slept_ns += slept_ns
            self._drop_old(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        """All of the doze counts as sleep."""
        begun_ns = self._clock.now_ns()
        self._clock.doze_until_ns(deadline_ns)
        self._count_doze(begun_ns, deadline_ns)

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        """As much of it as there was counts as sleep."""
        begun_ns = self._clock.now_ns()
        self._clock.doze_until_woken(deadline_ns, wait)
        self._count_doze(begun_ns, min(deadline_ns, self._clock.now_ns()))

    def _count_doze(self, begun_ns: int, ended_ns: int) -> None:
        slept_ns = ended_ns - begun_ns
        if slept_ns > 0:
            self.waited_ns += slept_ns
            self.dozes += 1
            self._sleeps.append((ended_ns, slept_ns))
            self._slept_ns += slept_ns
            self._drop_old(ended_ns)

    @property
    def busy_percent(self) -> float:
        """The busy part of the last 100 ms, as of the last sleep or call of `pause_until_ns`."""
        return 100.0 * max(0, WINDOW_NS - self._slept_ns) / WINDOW_NS

    def look(self, now_ns: int) -> None:
        """At what the kernel does now; called as often as one likes."""
        if now_ns >= self._next_look_ns:
            self._next_look_ns = now_ns + _LOOK_NS
            self.busy_fraction = busy_fraction(self._is_left_alone(now_ns))
            self._sleep_ns = _sleep_ns(self.busy_fraction)

    def pause_until_ns(self, now_ns: int) -> int | None:
        """The time to sleep to, when too little of the last 100 ms was slept; then call again,
        because older sleep leaves the window meanwhile. None: go on.
        """
        if now_ns >= self._next_look_ns:
            self.look(now_ns)
        self._drop_old(now_ns)
        missing_ns = self._sleep_ns - self._slept_ns
        if missing_ns <= 0:
            return None
        return now_ns + max(missing_ns, _SHORTEST_PAUSE_NS) + self.wakeups.spin_ns

    def _drop_old(self, now_ns: int) -> None:
        sleeps, oldest_ns = self._sleeps, now_ns - WINDOW_NS
        # A sleep that reaches into the window counts with its part inside.
        while sleeps and sleeps[0][0] - sleeps[0][1] < oldest_ns:
            end_ns, length_ns = sleeps.popleft()
            self._slept_ns -= length_ns
            if end_ns > oldest_ns:
                sleeps.appendleft((end_ns, end_ns - oldest_ns))
                self._slept_ns += end_ns - oldest_ns
                return
