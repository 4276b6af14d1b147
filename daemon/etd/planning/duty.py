"""The shortest period of a scan in which the processor sleeps enough.

Owns: what of any 100 ms may be busy, and the period that follows. Must not know: what keeps it
busy, schedules, clocks; how one knows what the kernel does.
"""

from __future__ import annotations

#: The loop may be busy for at most this part of any window; see `engine/cpu_budget.py`.
MAX_BUSY_FRACTION = 0.8
#: The same where the kernel never takes it off its core, and nothing else needs that core. The rest
#: is for the kernel's own threads of that core, which otherwise would never run: deferred frees,
#: timers, work that others queued there and wait for.
ALONE_BUSY_FRACTION = 0.98
WINDOW_US = 100_000.0
#: A plan stays this far below the brake, which looks before each pulse and pauses for a millisecond
#: at least, and each pause puts the next scan off. At the very limit every scan would be paused.
BELOW_BRAKE = 0.015

#: Between two polls where nothing is due; see `engine/idle_wait.py`.
TICK_US = 1_000.0


def busy_fraction(is_left_alone: bool) -> float:
    """Of any window, on a core that the kernel is known to leave alone, or on another."""
    return ALONE_BUSY_FRACTION if is_left_alone else MAX_BUSY_FRACTION


def told_of(fraction: float, core: str) -> str:
    """A sentence for people: what the scan may take of the time, as the kernel treats its core."""
    what_to_do = "" if fraction > MAX_BUSY_FRACTION else "; more: docs/install.md, a core alone"
    return f"the scan takes at most {100 * fraction:.0f} % of any 100 ms ({core}{what_to_do})"


def shortest_period_us(
    slots_us: float, slept_us: float, idle_us: float, busy_fraction: float
) -> float:
    """Of scans that last `slots_us` and sleep `slept_us` of that. Between two scans a poll computes
    for `idle_us` each tick. Where the loop sleeps does not matter: a pause within a scan is as good
    as a wait after it.
    """
    # A poll that took longer than a tick was held up: no plan is impossible because of it.
    awake = min(0.5, idle_us / (idle_us + TICK_US))
    missing_us = (1.0 - busy_fraction) * slots_us - slept_us
    return slots_us + max(0.0, missing_us) / (busy_fraction - awake)
