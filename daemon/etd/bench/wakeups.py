"""By how much this machine wakes the thread late: idle, and beside a busy loop on every core.

Owns: the sleeps, and the busy loops beside them. Must not know: what lateness is good for.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import msgspec

from etd.bench.stages import Stage, summed
from etd_hal.ports import Clock
from etd_hal.wakeups import WakeUps

#: As long as a rest and more; the loop sleeps between a rest and a tick of 1 ms.
_SLEEP_NS = 500_000
#: One that takes the whole of a core, and ends with this process.
_BUSY = """
import os, sys
parent = os.getppid()
os.sched_setaffinity(0, {int(sys.argv[1])})
while os.getppid() == parent:
    sum(range(100_000))
"""


class Wakeups(msgspec.Struct, frozen=True):
    """By how much a sleep ends late. `spun_us`: what of each sleep would be spun after these;
    `beyond`: how many of them came later than what was to be spun then.
    """

    idle: Stage
    busy: Stage
    worst_us: float
    spun_us: float
    beyond: int


def measure_wakeups(clock: Clock, seconds: float, cores: Iterable[int]) -> Wakeups:
    """For half of so many seconds idle, and for the other half beside a busy loop on each core."""
    idle_ns = _lateness(clock, seconds / 2)
    with _busy_loops(cores):
        busy_ns = _lateness(clock, seconds / 2)
    all_ns, noted = [*idle_ns, *busy_ns], WakeUps()
    for late_ns in all_ns:
        noted.note(late_ns)
    idle, busy = summed("idle", idle_ns), summed("busy", busy_ns)
    return Wakeups(idle, busy, max(all_ns) / 1_000, noted.spin_ns / 1_000, noted.late)


def _lateness(clock: Clock, seconds: float) -> list[int]:
    late_ns: list[int] = []
    end_ns = clock.now_ns() + int(seconds * 1e9)
    while not late_ns or clock.now_ns() < end_ns:
        deadline_ns = clock.now_ns() + _SLEEP_NS
        clock.doze_until_ns(deadline_ns)
        late_ns.append(clock.now_ns() - deadline_ns)
    return late_ns


@contextmanager
def _busy_loops(cores: Iterable[int]) -> Iterator[None]:
    """Ordinary processes: the children of a real-time thread do not inherit its priority."""
    loops = [subprocess.Popen([sys.executable, "-P", "-c", _BUSY, str(core)]) for core in cores]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
