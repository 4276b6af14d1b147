"""Never so busy that the kernel throttles the scan thread.

Owns: the busy time of the loop in every 100 ms, and when it must pause. Must not know: what keeps
it busy.

A real-time thread that never sleeps is taken off the core by the kernel's throttle, at worst in
the middle of a message: 54 ms with the DAC on were measured. So the loop keeps itself below 80 %.
"""

from __future__ import annotations

from etd.engine.plan import BUSY_PART
from etd_hal.ports import SPIN_NS, Clock

WINDOW_NS = 100_000_000


class BusyClock:
    """The Clock that the scan thread uses, counting what it does not sleep.

    Of each sleep the last SPIN_NS are spun and count as busy.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._begun_ns = clock.now_ns()
        self._slept_ns = 0
        self.busy_percent = 0.0

    def now_ns(self) -> int:
        return self._clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        begun_ns = self._clock.now_ns()
        self._slept_ns += max(0, deadline_ns - begun_ns - SPIN_NS)
        self._clock.sleep_until_ns(deadline_ns)

    def pause_until_ns(self, now_ns: int) -> int | None:
        """When this window's share is used up: the time to sleep to. None: go on."""
        elapsed_ns = now_ns - self._begun_ns
        busy_ns = elapsed_ns - self._slept_ns
        if elapsed_ns >= WINDOW_NS:
            self.busy_percent = 100.0 * max(0, busy_ns) / elapsed_ns
            self._begun_ns = now_ns
            self._slept_ns = 0
            return None
        return None if busy_ns < BUSY_PART * WINDOW_NS else self._begun_ns + WINDOW_NS
