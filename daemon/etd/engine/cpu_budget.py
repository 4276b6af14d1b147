"""Keeps the scan thread below the busy time at which the kernel throttles it.

Owns: the busy time of the loop in any 100 ms, and when it must pause. Must not know: what keeps
it busy.

A real-time thread that never sleeps is taken off the core by the kernel's throttle, at worst in
the middle of a message: 54 ms with the DAC on were measured. So the loop keeps itself below 80 %.
"""

from __future__ import annotations

from collections import deque

from etd.planning.duty import MAX_BUSY_FRACTION, WINDOW_US
from etd_hal.ports import SPIN_NS, Clock

WINDOW_NS = int(WINDOW_US * 1_000)
#: The least sleep in any window.
_SLEEP_NS = round((1.0 - MAX_BUSY_FRACTION) * WINDOW_NS)
#: A shorter pause would mostly be spun, and would not catch up.
_SHORTEST_PAUSE_NS = 1_000_000


class CpuBudget:
    """The Clock of the scan thread, which counts its sleep.

    The last SPIN_NS of each sleep are spun and count as busy.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.now_ns = clock.now_ns
        # (end, length) of each sleep in the window; before the start it slept.
        self._sleeps: deque[tuple[int, int]] = deque([(clock.now_ns(), WINDOW_NS)])
        self._slept_ns = WINDOW_NS
        #: All that was waited for so far, what was spun included.
        self.waited_ns = 0

    def sleep_until_ns(self, deadline_ns: int) -> None:
        slept_ns = deadline_ns - self._clock.now_ns() - SPIN_NS
        self._clock.sleep_until_ns(deadline_ns)
        self.waited_ns += max(0, slept_ns + SPIN_NS)
        if slept_ns > 0:
            self._sleeps.append((deadline_ns - SPIN_NS, slept_ns))
            self._slept_ns += slept_ns
            self._drop_old(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        """All of the doze counts as sleep."""
        slept_ns = deadline_ns - self._clock.now_ns()
        self._clock.doze_until_ns(deadline_ns)
        if slept_ns > 0:
            self.waited_ns += slept_ns
            self._sleeps.append((deadline_ns, slept_ns))
            self._slept_ns += slept_ns
            self._drop_old(deadline_ns)

    @property
    def busy_percent(self) -> float:
        """The busy part of the last 100 ms, as of the last sleep or call of `pause_until_ns`."""
        return 100.0 * max(0, WINDOW_NS - self._slept_ns) / WINDOW_NS

    def pause_until_ns(self, now_ns: int) -> int | None:
        """The time to sleep to, when too little of the last 100 ms was slept; then call again,
        because older sleep leaves the window meanwhile. None: go on.
        """
        self._drop_old(now_ns)
        missing_ns = _SLEEP_NS - self._slept_ns
        if missing_ns <= 0:
            return None
        return now_ns + max(missing_ns, _SHORTEST_PAUSE_NS) + SPIN_NS

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
