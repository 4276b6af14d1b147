"""A process beside the one that drives a board: started with it, ended with it.

Owns: how it is started, what it inherits, its first word, and how it learns of its end. Must not
know: what it does.

It is a program of its own and no fork: it inherits no open device, no socket and no lock but the
file descriptors that are named. The one thing between both is a socket. The process says on it
what it was not granted; it hears on it when it is needed; and when the other end is closed, by
whatever end of the driving process, its work is over.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence

from etd_hal.confinement import close_memory
from etd_hal.errors import BusError

_UP_WITHIN_S = 20.0
_ENDS_WITHIN_S = 2.0
_MAX_BYTES = 65_536
#: Said by the process, before what it was not granted.
_UP = "up"
#: Said to it.
NEEDED, NOT_NEEDED = b"1", b"0"
#: What ends the driving process, or asks it to end, comes to the whole group or service: this
#: process outlives it.
_NOT_ITS_END = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGABRT)


class SideProcess:
    """See the module. It comes up by itself; `refusals` waits for that."""

    def __init__(
        self, name: str, module: str, arguments: Sequence[object], fds: Sequence[int] = ()
    ) -> None:
        """Calls `main(socket, *arguments)` of `module`; the arguments are read back from their
        `repr`. It inherits `fds`, by the same numbers.
        """
        self._name = name
        mine, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        program = (
            f"import sys; sys.path[:] = {sys.path!r}; from {module} import main;"
            f" main({its.fileno()}, *{tuple(arguments)!r})"
        )
        with its:
            self._process = subprocess.Popen(
                # No module is looked for in the folder that it happens to be started in.
                [sys.executable, "-P", "-c", program],
                stdin=subprocess.DEVNULL,
                pass_fds=(its.fileno(), *fds),
                process_group=0,
            )
        self._socket = mine
        self.pid = self._process.pid
        self._refusals: tuple[str, ...] | None = None

    @property
    def refusals(self) -> tuple[str, ...]:
        """What was not granted, a sentence each. Raises: BusError (`gone`: it did not come up)."""
        if self._refusals is None:
            self._refusals = self._first_word()
        return self._refusals

    def _first_word(self) -> tuple[str, ...]:
        self._socket.settimeout(_UP_WITHIN_S)
        try:
            said = self._socket.recv(_MAX_BYTES).decode().splitlines()
        except OSError:
            said = []
        if said[:1] != [_UP]:
            self.end()
            raise BusError("gone", self._name, "beginning", "it ended, or does not come up")
        self._socket.setblocking(False)
        return tuple(f"{self._name}: {sentence}" for sentence in said[1:])

    def watch(self, is_needed: bool) -> None:
        """Never waits: a process that does not read any more shows elsewhere."""
        try:
            self._socket.send(NEEDED if is_needed else NOT_NEEDED)
        except OSError:
            pass

    def end(self) -> None:
        """Idempotent. Waits until it is over, for so long."""
        self._socket.close()
        try:
            self._process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def begin(fd: int, refusals: Sequence[str | None]) -> socket.socket:
    """In the process itself: say that it is up, and what it was not granted. Raises:
    NotConfined.
    """
    close_memory()
    for number in _NOT_ITS_END:
        signal.signal(number, signal.SIG_IGN)
    connection = socket.socket(fileno=fd)
    connection.send("\n".join((_UP, *(said for said in refusals if said))).encode())
    return connection


def finish() -> None:
    """In the process itself: over at once. What it holds is released by the kernel."""
    os._exit(0)
