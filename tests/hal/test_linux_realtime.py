"""What is asked of the kernel for the scan thread, in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys

_PROGRAM = """
import gc, json, os, resource, sys
from etd_hal.linux.realtime import set_up
if {unprivileged}:
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
        resource.setrlimit(limit, (0, 0))
    if os.getuid() == 0:
        os.setgid(65534)
        os.setuid(65534)
told = set_up(40, {core})
print(json.dumps({{
    "told": told,
    "again": set_up(40, {core}),
    "policy": os.sched_getscheduler(0),
    "cores": sorted(os.sched_getaffinity(0)),
    "gc": gc.isenabled(),
    "frozen": gc.get_freeze_count(),
    "slack_ns": int(open("/proc/self/timerslack_ns").read()),
}}))
"""


def asked(*, unprivileged: bool, core: int | None) -> dict[str, object]:
    program = _PROGRAM.format(unprivileged=unprivileged, core=core)
    environment = {"PYTHONPATH": ":".join(filter(None, sys.path))}
    ran = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=environment,
        check=True,
        timeout=600,
    )
    answer: dict[str, object] = json.loads(ran.stdout)
    return answer


def test_each_thing_that_is_not_granted_is_told_with_what_would_grant_it() -> None:
    answer = asked(unprivileged=True, core=4095)
    told = answer["told"]
    assert isinstance(told, list)
    assert any("SCHED_FIFO 40" in entry and "systemd" in entry for entry in told)
    assert any("core 4095" in entry for entry in told)
    assert any("LimitMEMLOCK" in entry for entry in told)
    assert answer["policy"] == 0


def test_the_interpreter_is_quiet_afterwards_whatever_the_kernel_said() -> None:
    answer = asked(unprivileged=True, core=None)
    assert answer["gc"] is False
    assert isinstance(answer["frozen"], int)
    assert answer["frozen"] > 1000


def test_no_core_asked_for_leaves_all_of_them() -> None:
    answer = asked(unprivileged=True, core=None)
    told = answer["told"]
    assert isinstance(told, list)
    assert not any("core" in entry for entry in told)


def test_a_core_that_is_there_is_the_only_one_afterwards() -> None:
    core = min(os.sched_getaffinity(0))
    assert asked(unprivileged=False, core=core)["cores"] == [core]


def test_timer_slack_is_the_least_there_is() -> None:
    answer = asked(unprivileged=True, core=None)
    assert answer["slack_ns"] == 1
