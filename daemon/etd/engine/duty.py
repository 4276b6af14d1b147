"""Never so busy that the kernel throttles the scan thread.

Owns: the busy time of the loop in every 100 ms, and when it must pause. Must not know: what keeps
it busy. Time comes in.

A real-time thread that never sleeps is taken off the core by the kernel's throttle, at worst in
the middle of a message: 54 ms with the DAC on were measured. So the loop keeps itself below 80 %.
"""

from __future__ import annotations

from etd.engine.plan import BUSY_PART
from etd_hal.ports import SPIN_NS

WINDOW_NS = 100_000_000


class Duty:
    """Counts what is not slept."""

    def __init__(self, now_ns: int) -> None:
        self._begun_ns = now_ns
        self._slept_ns = 0
        self.busy_percent = 0.0

    def slept(self, from_ns: int, until_ns: int) -> None:
        """A sleep was asked for; its last SPIN_NS were spun."""
        self._slept_ns += max(0, until_ns - from_ns - SPIN_NS)

    def pause_until_ns(self, now_ns: int) -> int | None:
        """When this window's share is used up: the time to sleep to. None: go on."""
        elapsed_ns = now_ns - self._begun_ns
        if elapsed_ns >= WINDOW_NS:
            self.busy_percent = 100.0 * max(0, elapsed_ns - self._slept_ns) / elapsed_ns
            self._begun_ns = now_ns
            self._slept_ns = 0
            return None
        if elapsed_ns - self._slept_ns < BUSY_PART * WINDOW_NS:
            return None
        return self._begun_ns + WINDOW_NS
