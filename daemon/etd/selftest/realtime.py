"""Stage 1: real-time scheduling, requested as the engine does, then verified.

Owns: what counts as obtained. Must not know: how a kernel grants it.
"""

from __future__ import annotations

from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd_hal.bench import Obtained

#: The timer slack of an ordinary thread.
_SLACK_NS = 50_000
#: All mapped memory is locked (MCL_CURRENT and MCL_FUTURE), except the pages of the kernel in every
#: process (vdso, vvar: some 30 kB), which it never locks and never swaps.
_UNLOCKED_KB = 1_024


def check(fixture: Fixture, log: CheckLog) -> None:
    """Checks what was refused, and what the kernel reports afterwards."""
    wanted = fixture.loaded.config.engine
    if wanted.priority == "none" and fixture.backend_name == "linux":
        log.skip(
            "realtime",
            "engine.priority is none in the configuration",
            "set a priority: otherwise pulses are late under load",
        )
        return
    priority = 1 if wanted.priority == "none" else wanted.priority
    core = wanted.scan_core
    refused = fixture.host.set_up_realtime(priority, core)
    found = fixture.host.obtained()
    absent = list(refused) or missing(found, priority, core)
    log.judge(
        "realtime",
        not absent,
        "; ".join(absent)
        or f"{found.policy} {found.priority} on core {_listed(found)},"
        f" {found.locked_kb / 1_024:.0f} MiB locked, timer slack {found.timer_slack_ns} ns",
        "scheduler, core, timer slack and locked memory",
        "run it as root or by systemd, or allow rtprio and memlock in limits.conf",
    )


def missing(found: Obtained, priority: int, core: int | None) -> list[str]:
    """What was not refused but is not in effect: a sentence each."""
    problems = []
    if found.policy != "SCHED_FIFO" or found.priority < priority:
        problems.append(f"the scheduler is {found.policy} {found.priority}, not FIFO {priority}")
    if core is not None and found.cores != (core,):
        problems.append(f"it runs on core {_listed(found)}, not on {core} alone")
    if found.locked_kb + _UNLOCKED_KB < found.mapped_kb:
        problems.append(f"of {found.mapped_kb} kB that are mapped {found.locked_kb} are locked")
    if found.timer_slack_ns >= _SLACK_NS:
        problems.append(f"the timer slack is {found.timer_slack_ns} ns")
    return problems


def _listed(found: Obtained) -> str:
    return ",".join(map(str, found.cores))
