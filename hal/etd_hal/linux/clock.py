"""CLOCK_MONOTONIC, and a sleep that is awake again before its deadline.

Owns: the only place that reads a clock. Must not know: what is waited for.
"""

from __future__ import annotations

import datetime
import time
from collections.abc import Callable

from etd_hal.ports import SPIN_NS


class LinuxClock:
    """The Clock port. The two arguments are the system's own; a test passes a pair that steps."""

    def __init__(
        self,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        sleep_s: Callable[[float], None] = time.sleep,
    ) -> None:
        self.now_ns = monotonic_ns
        self._sleep_s = sleep_s

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleep all but the last SPIN_NS, spin the rest.

        A spin alone would be exact, but a real-time thread that never sleeps is throttled by the
        kernel, with the DAC on; a sleep alone wakes up late by as much as the system likes.
        """
        remaining_ns = deadline_ns - self.now_ns()
        if remaining_ns > SPIN_NS:
            self._sleep_s((remaining_ns - SPIN_NS) / 1e9)
        while self.now_ns() < deadline_ns:
            pass


def wall_time() -> datetime.datetime:
    """The date and time of day, for reports; nothing is ever timed with it."""
    return datetime.datetime.now(datetime.UTC).replace(microsecond=0)
