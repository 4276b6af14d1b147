"""The shortest period of a scan in which the processor sleeps enough.

Owns: what of any 100 ms may be busy, and the period that follows. Must not know: what keeps it
busy, schedules, clocks.
"""

from __future__ import annotations

#: The loop may be busy for at most this part of any window; see `engine/cpu_budget.py`.
MAX_BUSY_FRACTION = 0.8
WINDOW_US = 100_000.0

_NEEDED_US = (1.0 - MAX_BUSY_FRACTION) * WINDOW_US

#: Between two polls where nothing is due; see `engine/sequencer.py`.
TICK_US = 1_000.0

#: Periods are tried so far apart.
_STEP = 1.004


def shortest_period_us(slots_us: float, slept_us: float, idle_us: float) -> float:
    """Of scans that last `slots_us` and sleep `slept_us` of that, evenly. Between two scans a poll
    computes for `idle_us` each tick.

    What counts is the window that begins with a scan: it holds the least sleep. A scan that lasts
    too long for that has to pause within, and then the mean counts.
    """
    awake = idle_us / (idle_us + TICK_US)
    in_wait, in_scan = 1.0 - awake, slept_us / slots_us
    if in_scan >= 1.0 - MAX_BUSY_FRACTION:
        return slots_us
    busy_us = slots_us - slept_us
    mean_us = slots_us + max(0.0, busy_us - MAX_BUSY_FRACTION * slots_us) / max(
        0.1, MAX_BUSY_FRACTION - awake
    )
    if _least_sleep_us(2 * WINDOW_US, slots_us, in_scan, in_wait) < _NEEDED_US:
        return mean_us
    period_us = mean_us
    while _least_sleep_us(period_us, slots_us, in_scan, in_wait) < _NEEDED_US:
        period_us *= _STEP
    return period_us


def _least_sleep_us(period_us: float, slots_us: float, in_scan: float, in_wait: float) -> float:
    """In a window that begins with a scan; `in_scan` and `in_wait` are the parts slept."""
    whole, rest_us = divmod(WINDOW_US, period_us)
    of_period_us = slots_us * in_scan + (period_us - slots_us) * in_wait
    of_rest_us = min(rest_us, slots_us) * in_scan + max(0.0, rest_us - slots_us) * in_wait
    return whole * of_period_us + of_rest_us
