"""A whole daemon on the guest's real buses: engine, gateway, and `etd safe` after them.

Owns: its configuration, its processes, waiting for what they say. Must not know: what is shown.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from etd.client import Display, clock
from etd.protocol.errors import EtdError, Refused
from etd.protocol.messages import StateReport
from etd_hal.fake import wire
from etd_hal.linux.clock import LinuxClock
from guest_board import LAST_PROCESSOR, TREE, WITHIN_S, Chips

_CLOCK = LinuxClock()
_PAUSE_NS = 20_000_000

CONFIG = """
backend = "linux"
board = "{board}"
machine = "{machine}"
array = "{array}"
body_site = "fingertip"
accept_absent_guards = [{accepted}]
operators = []

[engine]
core = 0
priority = 80
"""


@dataclass
class Daemon:
    """Engine and gateway in one folder."""

    folder: Path
    config: Path
    nursery: subprocess.Popen[str]
    gateway: subprocess.Popen[bytes]
    engine_pid: int = field(default=0)
    #: Of the last one that ended.
    last_engine_pid: int = field(default=0)

    @property
    def address(self) -> str:
        return f"ipc://{self.folder / 'control.sock'}"

    def start_engine(self) -> None:
        """Returns when it drives the board."""
        assert self.nursery.stdin is not None
        self.nursery.stdin.write("start\n")
        self.nursery.stdin.flush()
        said = self._said()
        assert said.startswith("ready "), f"the engine does not start: {said!r}"
        self.engine_pid = int(said.split()[1])

    def end_engine(self, number: signal.Signals) -> int:
        """Send a signal; when it was sent. Returns when the process is gone."""
        os.kill(self.engine_pid, number)
        sent_ns = clock.now_ns()
        assert self._said() == "ended"
        self.last_engine_pid, self.engine_pid = self.engine_pid, 0
        return sent_ns

    def _said(self) -> str:
        assert self.nursery.stdout is not None
        return self.nursery.stdout.readline().strip()

    def wait_until(self, **fields: object) -> StateReport:
        """The first state report in which these fields say so.

        Asked with pauses: where only sleeping moves time, asking again at once takes for ever.
        """
        deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
        said: object = None
        while clock.now_ns() < deadline_ns:
            try:
                with Display(address=self.address) as display:
                    said = report = display.status()
                if all(getattr(report, key) == value for key, value in fields.items()):
                    return report
            except EtdError as error:
                said = error
            _CLOCK.sleep_until_ns(clock.now_ns() + _PAUSE_NS)
        raise AssertionError(f"never {fields}: {said}")

    def clear_crash(self) -> None:
        """Wait for an engine, and clear what a kill of the one before it has left."""
        if self.wait_until(engine="there").state == "HALTED":
            with Display(address=self.address) as display:
                display.clear()
        self.wait_until(engine="there", state="SAFE")

    def make_safe(self) -> subprocess.CompletedProcess[str]:
        """`etd safe`, as the unit's ExecStopPost= runs it."""
        return subprocess.run(
            [sys.executable, "-m", "etd", "safe", "--config", str(self.config)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=WITHIN_S,
            check=False,
        )


def arm(display: Display, chips: Chips) -> None:
    """The wearer's stop is pressed and released first, as in every session."""
    with pytest.raises(Refused, match="wearer's stop has not been tested"):
        display.arm()
    for level in (0, 1):
        chips.knock(wire.Press("wearer_stop", level))
        _CLOCK.sleep_until_ns(clock.now_ns() + 10 * _PAUSE_NS)
    if display.status().state == "HALTED":
        display.clear()
    display.arm()


def write_config(
    path: Path, board: str, machine: Path, accepted: tuple[str, ...], array: str = "grid-8x8"
) -> None:
    quoted = ", ".join(f'"{name}"' for name in accepted)
    path.write_text(CONFIG.format(board=board, machine=machine, array=array, accepted=quoted))


@contextmanager
def running_daemon(
    board: str,
    machine: Path,
    accepted: tuple[str, ...],
    tested: Path | None = None,
    array: str = "grid-8x8",
) -> Iterator[Daemon]:
    """A gateway, and engines on request (`start_engine`); all ended at the end.

    `tested` is the report of a self-test; without one the board counts as having passed.
    """
    with ExitStack() as stack:
        # A Unix socket's path has at most 107 bytes: not in pytest's folder.
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="etd")))
        config = folder / "etd.toml"
        write_config(config, board, machine, accepted, array)
        if tested is not None:
            shutil.copy(tested, folder / "selftest.json")
        nursery = subprocess.Popen(
            [
                *(sys.executable, str(TREE / "tests/kernel/engine_nursery.py")),
                *(str(config), str(folder)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        stack.callback(_end, nursery)
        gateway = subprocess.Popen(
            [
                *(sys.executable, "-m", "etd", "run", "--part", "gateway"),
                *("--config", str(config), "--folder", str(folder)),
            ],
            stdin=subprocess.DEVNULL,
        )
        stack.callback(_end, gateway)
        os.sched_setaffinity(gateway.pid, LAST_PROCESSOR)
        running = Daemon(folder, config, nursery, gateway)
        # What it reads while it starts comes as interrupts, which would spread the calibration.
        _wait_for(folder / "control.sock")
        try:
            yield running
        finally:
            if running.engine_pid:
                running.end_engine(signal.SIGTERM)


def _wait_for(socket: Path) -> None:
    deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
    while not socket.exists():
        assert clock.now_ns() < deadline_ns, f"{socket.name} does not come"
        _CLOCK.sleep_until_ns(clock.now_ns() + _PAUSE_NS)


def _end(process: subprocess.Popen[str] | subprocess.Popen[bytes]) -> None:
    if process.stdin is not None:
        process.stdin.close()
    else:
        process.terminate()
    try:
        process.wait(WITHIN_S)
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()
