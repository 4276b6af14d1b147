"""Real-time settings of the scan thread, in the kernel and in Python.

Owns: requesting them, and a sentence for each that was not granted. Must not know: what the thread
does.

Settings already granted by systemd are not requested again.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from etd_hal.bench import Obtained

_PR_SET_PDEATHSIG = 1
_PR_SET_TIMERSLACK = 29
_PR_GET_TIMERSLACK = 30
_TIMER_SLACK_NS = 1
_POLICIES = {
    os.SCHED_OTHER: "SCHED_OTHER",
    os.SCHED_FIFO: "SCHED_FIFO",
    os.SCHED_RR: "SCHED_RR",
    os.SCHED_BATCH: "SCHED_BATCH",
    os.SCHED_IDLE: "SCHED_IDLE",
}
_MCL_CURRENT = 1
_MCL_FUTURE = 2
#: Lock pages when they are touched: locking all that is mapped takes five times the memory.
_MCL_ONFAULT = 4
#: A busy thread releases the interpreter after this, instead of 5 ms.
_SWITCH_INTERVAL_S = 0.000_5


def set_up(priority: int, core: int | None) -> tuple[str, ...]:
    """Make the *calling thread* real-time, and the process fit for it.

    SCHED_FIFO at `priority`, on `core` alone (None: any), least timer slack; for the process:
    memory locked as it is touched, objects of the start frozen and the collector off.
    Returns a sentence for each thing that was not granted, with what would grant it.
    """
    refusals = (
        scheduling(priority),
        _affinity(core),
        _timer_slack(),
        _memory(),
    )
    _quiet_interpreter()
    return tuple(sentence for sentence in refusals if sentence)


def set_up_beside(priority: int | None, scan_core: int | None) -> tuple[str, ...]:
    """For a process beside the scan: on every core but `scan_core`, its memory locked; SCHED_FIFO
    at `priority`, or an ordinary process (None).

    Returns a sentence for each thing that was not granted, with what would grant it.
    """
    refusals = (
        None if priority is None else scheduling(priority),
        _off_core(scan_core),
        None if priority is None else _memory(),
    )
    return tuple(sentence for sentence in refusals if sentence)


def obtained() -> Obtained:
    """The settings of the calling thread and its process, as the kernel reports them."""
    # Here: a process beside the scan does without what this imports.
    from etd_hal.bench import Obtained

    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    with open("/proc/self/status", encoding="ascii") as file:
        status = file.read()
    return Obtained(
        policy=_POLICIES.get(policy, f"scheduling policy {policy}"),
        priority=os.sched_getparam(0).sched_priority,
        cores=tuple(sorted(os.sched_getaffinity(0))),
        locked_kb=_kb(status, "VmLck"),
        mapped_kb=_kb(status, "VmSize"),
        timer_slack_ns=_call("prctl", _PR_GET_TIMERSLACK, 0, 0, 0, 0),
    )


def _kb(status: str, name: str) -> int:
    (found,) = (line.split()[1] for line in status.splitlines() if line.startswith(f"{name}:"))
    return int(found)


def scheduling(priority: int) -> str | None:
    """SCHED_FIFO for the calling thread; a sentence if it was not granted."""
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    if policy == os.SCHED_FIFO and os.sched_getparam(0).sched_priority >= priority:
        return None
    # Threads and processes begun from here start as ordinary ones, and ask for themselves.
    wanted = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    return _asked(
        f"real-time scheduling (SCHED_FIFO {priority})",
        lambda: os.sched_setscheduler(0, wanted, os.sched_param(priority)),
        "start it by systemd, or allow rtprio in limits.conf; pulses will be late under load",
    )


def perish_with(parent: int) -> None:
    """The calling process is killed when its parent ends. Raises: OSError; ProcessLookupError if
    it has ended already.
    """
    _call("prctl", _PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        raise ProcessLookupError(parent, "the parent has ended")


def ordinary() -> None:
    """On every core, at no priority: for a child of a real-time thread."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.sched_setaffinity(0, range(os.cpu_count() or 1))


def _affinity(core: int | None) -> str | None:
    if core is None:
        return None
    return _asked(
        f"core {core} for the scan thread",
        lambda: os.sched_setaffinity(0, {core}),
        "name a core that this machine has and this service may use, or any",
    )


def _off_core(scan_core: int | None) -> str | None:
    if scan_core is None:
        return None
    return _asked(
        f"a core other than the scan's ({scan_core})",
        lambda: os.sched_setaffinity(0, os.sched_getaffinity(0) - {scan_core}),
        "it shares the scan's core: the machine has no other, or this service may not use one",
    )


def _timer_slack() -> str | None:
    return _asked(
        "least timer slack",
        lambda: _call("prctl", _PR_SET_TIMERSLACK, _TIMER_SLACK_NS, 0, 0, 0),
        "sleeps end up to 50 us later",
    )


def _memory() -> str | None:
    return _asked(
        "locked memory",
        lambda: _call("mlockall", _MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT),
        "raise LimitMEMLOCK (or memlock in limits.conf): a page that was swapped out costs"
        " milliseconds",
    )


def _quiet_interpreter() -> None:
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(_SWITCH_INTERVAL_S)


def _asked(what: str, ask: Callable[[], object], advice: str) -> str | None:
    try:
        ask()
    except OSError as error:
        return f"{what} was not granted ({error.strerror}): {advice}"
    return None


def _call(function: str, *arguments: int) -> int:
    """A function of the C library that answers a number, or -1 and errno. Raises: OSError."""
    library = ctypes.CDLL(None, use_errno=True)
    answer: int = library[function](*map(ctypes.c_ulong, arguments))
    if answer < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return answer
