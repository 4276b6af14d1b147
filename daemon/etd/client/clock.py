"""The client's clock: the same CLOCK_MONOTONIC that the daemon counts on.

Owns: the one place of the client that reads a clock or sleeps. Must not know: anything else.
(The daemon takes its clock through a port; a client also runs where there is no such port.)
"""

from __future__ import annotations

import time

#: CLOCK_MONOTONIC, in nanoseconds.
now_ns = time.monotonic_ns


def wall_offset_ns() -> int:
    """What CLOCK_REALTIME is ahead of CLOCK_MONOTONIC."""
    return time.time_ns() - now_ns()


def sleep_s(seconds: float) -> None:
    """Sleep; nothing if `seconds` is not above 0."""
    if seconds > 0:
        time.sleep(seconds)


class ClientClock:
    """The same as a port (`etd_hal.ports.Clock`), for what takes its time from one."""

    def now_ns(self) -> int:
        return now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        sleep_s((deadline_ns - now_ns()) / 1e9)

    doze_until_ns = sleep_until_ns
