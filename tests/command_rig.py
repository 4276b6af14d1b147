"""The `etd` command as a process of its own, with a runtime folder that nobody else uses.

Owns: starting it, waiting for a line of it, and that none is left. Must not know: verbs.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etd.client import clock

#: What comes at all comes within a second on an idle machine; a busy one is waited for.
WITHIN_S = 120.0


@dataclass(frozen=True, slots=True)
class Said:
    """How a command ended."""

    status: int
    out: str
    err: str

    @property
    def answer(self) -> dict[str, Any]:
        """Standard output as one JSON object."""
        answer = json.loads(self.out)
        assert isinstance(answer, dict)
        return answer


class Command:
    """A command under way."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        self._unread = {"stdout": b"", "stderr": b""}

    def line(self, stream: str = "stdout") -> str:
        """The next line; fails if none comes. "" at the end."""
        pipe = getattr(self.process, stream)
        while b"\n" not in self._unread[stream]:
            assert is_ready(pipe.fileno()), f"no line on {stream} within {WITHIN_S} s"
            data = os.read(pipe.fileno(), 65_536)
            if not data:
                return ""
            self._unread[stream] += data
        line, _, self._unread[stream] = self._unread[stream].partition(b"\n")
        return line.decode()

    def line_with(self, text: str, stream: str = "stderr") -> str:
        """The next line that has `text` in it."""
        while True:
            line = self.line(stream)
            assert line, f"{text!r} was not said"
            if text in line:
                return line

    def children(self) -> dict[str, int]:
        """The process ids of its parts, by name."""
        pid = self.process.pid
        listed = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        found = {}
        for child in map(int, listed):
            words = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
            if "--part" in words:
                found[words[words.index("--part") + 1]] = child
        return found

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def ended(self) -> Said:
        """Wait for its end."""
        out, err = self.process.communicate(timeout=WITHIN_S)
        said = [self._unread["stdout"] + out, self._unread["stderr"] + err]
        return Said(self.process.returncode, *(data.decode() for data in said))


class CommandRig:
    """Commands that share one runtime folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = {
            **os.environ,
            "XDG_RUNTIME_DIR": str(folder / "run"),
            "XDG_STATE_HOME": str(folder / "state"),
            "TMPDIR": str(folder),
        }
        (folder / "run").mkdir()
        #: The working folder of what is started, below `folder`.
        self.subfolder = ""
        #: What starts each command, with its arguments: `setpriv`, say.
        self.before: tuple[str, ...] = ()
        self._started: list[subprocess.Popen[bytes]] = []

    def start(self, *arguments: str, stdin: int = subprocess.DEVNULL) -> Command:
        process = subprocess.Popen(
            [*self.before, sys.executable, "-m", "etd", *arguments],
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            env=self.environment,
            cwd=self._working(),
        )
        self._started.append(process)
        return Command(process)

    def _working(self) -> Path:
        working = self.folder / self.subfolder
        working.mkdir(exist_ok=True)
        return working

    def run(self, *arguments: str) -> Said:
        return self.start(*arguments).ended()

    @contextmanager
    def daemon(self, *arguments: str) -> Iterator[Command]:
        """`etd run` on the fake, ready; ended at the end."""
        command = self.start("run", "--board", "fake", *arguments)
        assert "is ready" in command.line()
        yield command
        if command.process.poll() is None:
            command.signal(signal.SIGTERM)
            said = command.ended()
            assert said.status == 0, said.err

    def close(self) -> None:
        for process in self._started:
            if process.poll() is None:
                process.kill()
            process.communicate(timeout=WITHIN_S)


@contextmanager
def command_rig() -> Iterator[CommandRig]:
    """In a folder with a short name: a Unix socket's path has at most 107 bytes."""
    with tempfile.TemporaryDirectory(prefix="etd-") as name:
        rig = CommandRig(Path(name))
        try:
            yield rig
        finally:
            rig.close()


def is_ready(descriptor: int, within_s: float = WITHIN_S) -> bool:
    """Whether there is something to read, or an end, by then. Not by `select`: that takes none from
    1024 on, and rigs of the tests before may hold as many until they are collected.
    """
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(within_s * 1e3))


def wait_for_end(pids: list[int]) -> None:
    """Return when all these processes are gone; fails if they do not go."""
    deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
    for pid in pids:
        try:
            handle = os.pidfd_open(pid)
        except ProcessLookupError:
            continue
        try:
            left_s = max(0.0, (deadline_ns - clock.now_ns()) / 1e9)
            assert is_ready(handle, left_s), f"process {pid} lives on"
        finally:
            os.close(handle)
