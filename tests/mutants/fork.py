"""A function in a process of its own, and what it tells meanwhile.

Owns: forking, what a fork may use (memory; no terminal), and when one that says nothing is given
up. Must not know: tests, mistakes.

What is measured is the processor's time. A fork that takes none and waits for nothing that could
come is ended too: it waits for itself. A busy machine ends none, because a fork that wants the
processor is not one that waits.
"""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

Tell = Callable[[dict[str, Any]], None]

#: Beyond what the process had when it was forked.
_MORE_BYTES = 2 << 30
#: So often a fork that has not ended is looked at, and so many looks without work end it.
_LOOK_MS = 1_000
_LOOKS = 20
#: How it ended, where it was not by itself; and what it ends with if `work` raises.
STALLED, BROKEN = -1000, 70


def telling(work: Callable[[Tell], None], log: Path) -> Iterator[dict[str, Any]]:
    """What `work` tells, in a fork, as it comes. Raises: RuntimeError if it ends badly."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        _quietly(log)
        _work(work, writing)
    os.close(writing)
    try:
        with open(reading, encoding="utf-8") as told:
            for line in told:
                yield json.loads(line)
    except BaseException:
        _end(pid)
        os.waitpid(pid, 0)
        raise
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if status:
        raise RuntimeError(f"a process ended with status {status}: see {log}")


def _work(work: Callable[[Tell], None], writing: int) -> NoReturn:
    def tell(told: dict[str, Any]) -> None:
        os.write(writing, json.dumps(told).encode() + b"\n")

    status = 1
    try:
        work(tell)
        status = 0
    except BaseException:  # noqa: BLE001 - it ends here, whatever it is
        _say_why()
    finally:
        os._exit(status)


def _say_why() -> None:
    """To the log, whatever stands in for the standard error here."""
    os.write(2, traceback.format_exc().encode())


def _quietly(log: Path) -> None:
    """What tests print goes to the log."""
    os.setsid()
    sys.stdout.flush()
    sys.stderr.flush()
    fd = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(fd, 1)
    os.dup2(fd, 2)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)


def ending(work: Callable[[], int], looks: int = _LOOKS) -> int:
    """The exit status of `work` in a fork; BROKEN if it raises; negative: the
    signal that ended it, or STALLED, after so many looks at which it had done nothing.
    """
    pid = os.fork()
    if pid == 0:
        os.setsid()
        _bound()
        status = BROKEN
        try:
            status = work()
        except BaseException:  # noqa: BLE001 - likewise
            _say_why()
        finally:
            os._exit(status)
    try:
        return _ended(pid, looks)
    except BaseException:
        _end(pid)
        os.waitpid(pid, 0)
        raise


def _bound() -> None:
    with open("/proc/self/statm", encoding="ascii") as file:
        now = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + _MORE_BYTES, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _ended(pid: int, most_looks: int) -> int:
    poll = select.poll()
    pidfd = os.pidfd_open(pid)
    poll.register(pidfd, select.POLLIN)
    looks, before = 0, ""
    try:
        while not poll.poll(_LOOK_MS):
            state, taken = _processor(pid)
            looks = looks + 1 if state == "S" and taken == before else 0
            before = taken
            if looks == most_looks:
                _end(pid)
                os.waitpid(pid, 0)
                return STALLED
    finally:
        os.close(pidfd)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    # What it has started does not outlive it.
    _end(pid)
    return status


def _processor(pid: int) -> tuple[str, str]:
    """Its state, and the time that it has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return fields[0], " ".join(fields[11:15])


def _end(pid: int) -> None:
    for kill in (os.killpg, os.kill):
        try:
            kill(pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            pass
