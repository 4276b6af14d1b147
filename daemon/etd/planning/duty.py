"""The shortest period of a scan in which the processor sleeps enough.

Owns: what of any 100 ms may be busy, and the period that follows. Must not know: what keeps it
busy, schedules, clocks.
"""

from __future__ import annotations

#: The loop may be busy for at most this part of any window; see `engine/cpu_budget.py`.
MAX_BUSY_FRACTION = 0.8
WINDOW_US = 100_000.0

#: Between two polls where nothing is due; see `engine/sequencer.py`.
TICK_US = 1_000.0


def shortest_period_us(slots_us: float, slept_us: float, idle_us: float) -> float:
    """Of scans that last `slots_us` and sleep `slept_us` of that. Between two scans a poll computes
    for `idle_us` each tick. Where the loop sleeps does not matter: a pause within a scan is as good
    as a wait after it.
    """
    awake = min(0.5, idle_us / (idle_us + TICK_US))
    missing_us = (1.0 - MAX_BUSY_FRACTION) * slots_us - slept_us
    return slots_us + max(0.0, missing_us) / (MAX_BUSY_FRACTION - awake)
