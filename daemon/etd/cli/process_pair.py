"""Engine and gateway as two child processes.

Owns: starting them, waiting until they are ready, which of them ended, and that both end when this
process does, however it ends. Must not know: configurations, what the two do.

A part reports that it is ready with a datagram to NOTIFY_SOCKET, as it does to systemd. Its
standard input is a pipe that is never written: when this process ends, even by `kill -9`, the pipe
closes, and the part ends itself.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Self

import zmq

from etd.client import clock
from etd.client.telemetry import Telemetry
from etd.files.paths import TELEMETRY, address_of, sibling_address
from etd.protocol.errors import NO_TIME, DaemonGone, PartEnded

PARTS = ("engine", "gateway")
#: A program of ours. `-P`: no module is looked for in the folder that it happens to be started in,
#: where others may have put theirs (`/tmp`).
ETD = (sys.executable, "-P", "-m", "etd")
#: From start to ready; an engine takes a second or two on a small machine.
READY_WITHIN_S = 20.0
#: From the signal to the end; the engine makes the board safe meanwhile.
_END_WITHIN_S = 5.0
#: Between a part's sockets closing and its end as a process.
_DYING_S = 1.0


class Part:
    """One child process. `arguments` are those of `etd run`, without `--part`; its output goes to
    this process's standard error, or into `log`.
    """

    def __init__(
        self, name: str, arguments: Sequence[str], folder: Path, log: IO[str] | None
    ) -> None:
        self.name = name
        self.is_ready = False
        self._had_to_be_killed = False
        _take_away_left(folder, name)
        # Of this process alone: another one may start on the same folder, and find it taken.
        self._ready_path = folder / f"{name}-{os.getpid()}.ready"
        self._ready_path.unlink(missing_ok=True)
        self.ready_socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.ready_socket.bind(str(self._ready_path))
        environment = {
            key: value for key, value in os.environ.items() if not key.startswith("WATCHDOG_")
        }
        # A process group of their own: Ctrl-C must reach this process only, which then ends both.
        self.process = subprocess.Popen(
            [*ETD, "run", "--part", name, "--lifeline", *arguments],
            stdin=subprocess.PIPE,
            stdout=log or sys.__stderr__,
            stderr=log,
            env={**environment, "NOTIFY_SOCKET": str(self._ready_path)},
            process_group=0,
        )
        self.pidfd = os.pidfd_open(self.process.pid)

    def hear(self) -> None:
        """A datagram has come."""
        self.is_ready |= b"READY=1" in self.ready_socket.recv(4096)

    def error(self) -> PartEnded:
        code = self.process.wait()
        if self._had_to_be_killed:
            return PartEnded(self.name, f"killed: it did not end within {_END_WITHIN_S:g} s", 1)
        if code < 0:
            return PartEnded(self.name, f"killed by {signal.Signals(-code).name}", 1)
        return PartEnded(self.name, f"exit status {code}", code or 1)

    def end(self) -> None:
        """Ask it to end, wait, and kill it if it does not. Idempotent."""
        try:
            self.process.wait(_END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._had_to_be_killed = True
            self.process.kill()
            self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()
        if self.pidfd >= 0:
            os.close(self.pidfd)
            self.pidfd = -1
        self.ready_socket.close()
        self._ready_path.unlink(missing_ok=True)


def _take_away_left(folder: Path, name: str) -> None:
    """By processes that were killed."""
    for left in folder.glob(f"{name}-*.ready"):
        pid = left.stem.rpartition("-")[2]
        if not Path("/proc", pid).exists():
            left.unlink(missing_ok=True)


class ProcessPair:
    """In a `with`: both run; at its end both have ended. `not_ended_well` says how."""

    def __init__(self, arguments: Sequence[str], folder: Path, log: IO[str] | None = None) -> None:
        self.address = address_of(folder)
        self._arguments = arguments
        self._folder = folder
        self._log = log
        self._parts: list[Part] = []

    def __enter__(self) -> Self:
        try:
            for name in PARTS:
                self._parts.append(Part(name, self._arguments, self._folder, self._log))
        except BaseException:
            self.end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def wait_until_ready(self, within_s: float = READY_WITHIN_S) -> None:
        """Return when a client that connects finds an engine. Raises: PartEnded, DaemonGone."""
        deadline_ns = clock.now_ns() + int(within_s * 1e9)
        while not all(part.is_ready for part in self._parts):
            left_s = _left_s(deadline_ns)
            if left_s <= 0:
                what = f"the daemon was not ready within {within_s:g} s"
                raise DaemonGone(self.address, what, NO_TIME)
            self._look(left_s)
            self.check()
        self._wait_for_link(deadline_ns)

    def wait(self, seconds: float | None, wakeup: socket.socket) -> None:
        """Until `seconds` are over (None: never), or `wakeup` can be read. Raises: PartEnded."""
        deadline_ns = None if seconds is None else clock.now_ns() + int(seconds * 1e9)
        while True:
            left_s = None if deadline_ns is None else _left_s(deadline_ns)
            if left_s is not None and left_s <= 0:
                return
            is_woken = self._look(left_s, wakeup)
            self.check()
            if is_woken:
                return

    def check_dying(self) -> None:
        """As `check`, after a client found a part gone: its process may not have ended yet."""
        self._look(_DYING_S)
        self.check()

    def check(self) -> None:
        """Raises: PartEnded if one of the two has ended."""
        for part in self._parts:
            if part.process.poll() is not None:
                raise part.error()

    def not_ended_well(self) -> tuple[PartEnded, ...]:
        """The parts that ended by a signal or with a status other than 0; the engine first."""
        return tuple(part.error() for part in self._parts if part.process.poll())

    def end(self) -> None:
        """Both are asked at once, then waited for. Idempotent."""
        for part in self._parts:
            if part.process.poll() is None:
                with contextlib.suppress(ProcessLookupError):
                    part.process.terminate()
        for part in self._parts:
            part.end()

    def _look(self, timeout_s: float | None, wakeup: socket.socket | None = None) -> bool:
        """Wait for a datagram, the end of a part, or `wakeup`; True for `wakeup`."""
        with selectors.DefaultSelector() as selector:
            for part in self._parts:
                selector.register(part.pidfd, selectors.EVENT_READ)
                selector.register(part.ready_socket, selectors.EVENT_READ, part)
            if wakeup is not None:
                selector.register(wakeup, selectors.EVENT_READ, wakeup)
            found = [key.data for key, _ in selector.select(timeout_s)]
        for entry in found:
            if isinstance(entry, Part):
                entry.hear()
        return wakeup is not None and wakeup in found

    def _wait_for_link(self, deadline_ns: int) -> None:
        """By telemetry: a request would be refused until the gateway has its engine."""
        telemetry = sibling_address(self.address, TELEMETRY)
        with zmq.Context() as context, Telemetry(context, telemetry, ("state",)) as reports:
            while (item := reports.receive(max(0.0, _left_s(deadline_ns)))) is not None:
                if getattr(item[1], "engine", None) == "there":
                    return
                self.check()
        raise DaemonGone(self.address, "the gateway could not connect to its engine", NO_TIME)


def _left_s(deadline_ns: int) -> float:
    return (deadline_ns - clock.now_ns()) / 1e9
