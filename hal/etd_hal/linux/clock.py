"""CLOCK_MONOTONIC, processor time of the calling thread, and a sleep that ends at its deadline.

Owns: the only place that reads a clock. Must not know: what is waited for.
"""

from __future__ import annotations

import ctypes
import datetime
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from etd_hal.bench import Timekeeping
from etd_hal.ports import Wait
from etd_hal.wakeups import WakeUps

_READINGS = 1_000
#: What adjtimex answers where the kernel's clock follows no other; its buffer's size with room.
_TIME_ERROR = 5
_TIMEX_BYTES = 512


class LinuxClock:
    """The WakingClock port. Its arguments are the system's own; a test passes some that step."""

    def __init__(
        self,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        sleep_s: Callable[[float], None] = time.sleep,
    ) -> None:
        self.now_ns = monotonic_ns
        self._sleep_s = sleep_s
        self.wakeups = WakeUps()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleep all but as much of the end as wake-ups are late, spin the rest.

        A spin alone would be exact, but a real-time thread that never sleeps is throttled by the
        kernel, with the DAC on; a sleep alone wakes up late by as much as the system likes.
        """
        wake_ns = deadline_ns - self.wakeups.spin_ns
        remaining_ns = wake_ns - self.now_ns()
        if remaining_ns > 0:
            self._sleep_s(remaining_ns / 1e9)
            self.wakeups.note(self.now_ns() - wake_ns)
        while self.now_ns() < deadline_ns:
            pass

    def doze_until_ns(self, deadline_ns: int) -> None:
        """Sleep, and wake up as late as the system likes."""
        while (remaining_ns := deadline_ns - self.now_ns()) > 0:
            self._sleep_s(remaining_ns / 1e9)

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        while (remaining_ns := deadline_ns - self.now_ns()) > 0:
            if wait(remaining_ns / 1e9):
                return


def thread_time_ns() -> int:
    """What the calling thread has had of the processor."""
    return time.thread_time_ns()


def wall_time() -> datetime.datetime:
    """The date and time of day, for reports; nothing is ever timed with it."""
    return datetime.datetime.now(datetime.timezone.utc).replace(microsecond=0)


def timekeeping(source: str) -> Timekeeping:
    """Measures this machine's clocks; takes some milliseconds."""
    readings = [time.monotonic_ns() for _ in range(_READINGS)]
    installed_s = Path(__file__).stat().st_mtime
    return Timekeeping(
        source=source,
        resolution_ns=round(time.clock_getres(time.CLOCK_MONOTONIC) * 1e9),
        least_step_ns=min(after - before for before, after in pairwise(readings)),
        now=wall_time(),
        not_before=datetime.datetime.fromtimestamp(int(installed_s), datetime.timezone.utc),
        is_synchronized=_is_synchronized(),
    )


def _is_synchronized() -> bool | None:
    """Asking changes nothing: no mode is set. None where the kernel does not answer."""
    answer: int = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    return None if answer < 0 else answer != _TIME_ERROR
