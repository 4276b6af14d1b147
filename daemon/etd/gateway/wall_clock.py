"""The wall's time beside CLOCK_MONOTONIC, for records.

Owns: reading both together. Must not know: what is timed. Nothing is ever timed by the wall.
"""

from __future__ import annotations

import time


def read_clocks() -> tuple[int, int, int]:
    """CLOCK_MONOTONIC and the wall's time (ns since 1970, UTC), and how far they may be apart."""
    before_ns = time.monotonic_ns()
    wall_ns = time.time_ns()
    after_ns = time.monotonic_ns()
    return (before_ns + after_ns) // 2, wall_ns, after_ns - before_ns
