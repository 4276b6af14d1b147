"""Never so busy that the kernel throttles the scan thread.

Owns: the busy time of the loop in any 100 ms, and when it must pause. Must not know: what keeps
it busy.

A real-time thread that never sleeps is taken off the core by the kernel's throttle, at worst in
the middle of a message: 54 ms with the DAC on were measured. So the loop keeps itself below 80 %.
"""

from __future__ import annotations

from collections import deque

from etd.planning.scan_rate import MAX_BUSY_FRACTION
from etd_hal.ports import SPIN_NS, Clock

WINDOW_NS = 100_000_000
#: Of any window, at least so much is slept.
_SLEEP_NS = round((1.0 - MAX_BUSY_FRACTION) * WINDOW_NS)
#: A shorter one would be spun for the most part, and never catch up.
_SHORTEST_PAUSE_NS = 1_000_000


class CpuBudget:
    """The Clock that the scan thread uses, counting what it sleeps.

    Of each sleep the last SPIN_NS are spun and count as busy.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.now_ns = clock.now_ns
        # (end, length) of each sleep in the window; before the start it slept.
        self._sleeps: deque[tuple[int, int]] = deque([(clock.now_ns(), WINDOW_NS)])
        self._slept_ns = WINDOW_NS

    def sleep_until_ns(self, deadline_ns: int) -> None:
        slept_ns = deadline_ns - self._clock.now_ns() - SPIN_NS
        self._clock.sleep_until_ns(deadline_ns)
        if slept_ns > 0:
            self._sleeps.append((deadline_ns - SPIN_NS, slept_ns))
            self._slept_ns += slept_ns
            self._drop_old(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        """All of it counts as slept."""
        slept_ns = deadline_ns - self._clock.now_ns()
        self._clock.doze_until_ns(deadline_ns)
        if slept_ns > 0:
            self._sleeps.append((deadline_ns, slept_ns))
            self._slept_ns += slept_ns
            self._drop_old(deadline_ns)

    @property
    def busy_percent(self) -> float:
        """Of the 100 ms before the last look."""
        return 100.0 * max(0, WINDOW_NS - self._slept_ns) / WINDOW_NS

    def pause_until_ns(self, now_ns: int) -> int | None:
        """When too little of the last 100 ms was slept: the time to sleep to, and then to ask
        again, because older sleep leaves the window meanwhile. None: go on.
        """
        self._drop_old(now_ns)
        missing_ns = _SLEEP_NS - self._slept_ns
        if missing_ns <= 0:
            return None
        return now_ns + max(missing_ns, _SHORTEST_PAUSE_NS) + SPIN_NS

    def _drop_old(self, now_ns: int) -> None:
        sleeps, oldest_ns = self._sleeps, now_ns - WINDOW_NS
        # A sleep that reaches into the window counts with the part that lies in it.
        while sleeps and sleeps[0][0] - sleeps[0][1] < oldest_ns:
            end_ns, length_ns = sleeps.popleft()
            self._slept_ns -= length_ns
            if end_ns > oldest_ns:
                sleeps.appendleft((end_ns, end_ns - oldest_ns))
                self._slept_ns += end_ns - oldest_ns
                return
