"""Our services under the guest's systemd, as an operator has them: installed, configured, started.

Owns: setting them up, asking systemd and the journal, the people who use them, waiting.
Must not know: what is shown.
"""

from __future__ import annotations

import grp
import json
import os
import pwd
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from msgspec.structs import replace

from engine_nursery import passed_selftest
from etd.client import Display
from etd.files.configuration import LoadedConfig, load_config
from etd.protocol.errors import EtdError
from etd.protocol.messages import StateReport
from etd.selftest.report import Report, save
from etd.version import __version__
from etd_hal.boardfile import load_board
from etd_hal.linux.clock import LinuxClock
from guest_board import IS_VIRTUAL_TIME, TREE, WITHIN_S, unchecked_board

T = TypeVar("T")

BOARD = load_board(TREE / "config/boards/kajimoto-hv507.toml")
ENGINE, GATEWAY, TARGET = "etd-engine@main.service", "etd-gateway@main.service", "etd@main.target"
SOCKETS = Path("/run/etd/main")
#: The interpreter of what `make install` installs.
INSTALLED = "/opt/etd/venv/bin/python"
#: Written by the unit of OnFailure=.
TOLD = Path("/run/rig-told")
ADDRESS = f"ipc://{SOCKETS / 'control.sock'}"
CLOCK = LinuxClock()
#: Asking again costs a process, in this guest, and waiting nothing.
_PAUSE_NS = 200_000_000
MACHINE = TREE / "tests/kernel" / ("virtual-time.toml" if IS_VIRTUAL_TIME else "service-x86.toml")
#: May use the display; may store calibrations too; may not.
PERSON, OPERATOR, STRANGER = "person", "calibrator", "stranger"
CALIBRATIONS = Path("/var/lib/etd-calibrations")

SETTINGS = f"""
backend = "linux"
board = "./board.toml"
machine = "./{MACHINE.name}"
array = "grid-8x8"
body_site = "fingertip"
accept_absent_guards = {json.dumps(BOARD.absent_guards)}
operators = []

[engine]
core = 0
priority = 80
"""


def said_by(*command: str) -> str:
    """What a command that succeeds says."""
    ran = run(*command)
    assert ran.returncode == 0, f"{command}: {ran.stdout}{ran.stderr}"
    return ran.stdout


def run(*command: str, user: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, as root or as somebody, with that user's groups."""
    return subprocess.run(
        as_user(user, command),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=WITHIN_S,
        check=False,
        cwd="/",
        env=PLAIN,
    )


def as_user(user: str | None, command: tuple[str, ...]) -> list[str]:
    if user is None:
        return list(command)
    return ["setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups", *command]


#: What an operator's shell has: nothing of the working tree.
PLAIN = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C"}


def set_up() -> None:
    """What remains to be done after `make install` (docs/install.md), and people to do it with."""
    said_by("make", "-s", "-C", str(TREE), "activate")
    for name, groups in (
        (PERSON, ("-G", "etd-users")),
        (OPERATOR, ("-G", "etd-users,etd-operators")),
        (STRANGER, ()),
    ):
        said_by("useradd", "--no-create-home", *groups, name)
    settings = Path("/etc/etd/main.toml")
    settings.write_text(SETTINGS)
    # Beside it, as an operator's own files: a service does not see every folder.
    shutil.copy(MACHINE, settings.parent)
    unchecked_board(settings.parent / "board.toml")
    save(_passed(load_config(settings)), Path("/var/lib/etd/main.selftest.json"))


def _passed(loaded: LoadedConfig) -> Report:
    """By the installed program, which may be compiled; these tests are not."""
    report = passed_selftest(loaded)
    runs = said_by(INSTALLED, "-c", "from etd_hal import compiled; print(compiled.runs())").strip()
    subject = replace(report.subject, program=f"etd {__version__}, {runs}")
    return replace(report, subject=subject)


def stop() -> None:
    """Returns when both have ended: systemd does not wait for what is only a part of a target."""
    said_by("systemctl", "stop", TARGET, ENGINE, GATEWAY)


def start() -> None:
    """Returns when both services have said that they are ready."""
    said_by("systemctl", "reset-failed")
    assert run("systemctl", "start", TARGET, ENGINE, GATEWAY).returncode == 0, journal("")
    wait_for_state("SAFE")


def shown(unit: str, *names: str) -> dict[str, str]:
    """Properties of a unit."""
    told = said_by("systemctl", "show", unit, *(f"--property={name}" for name in names))
    return dict(line.partition("=")[::2] for line in told.splitlines())


def main_pid(unit: str) -> int:
    return int(shown(unit, "MainPID")["MainPID"])


def restarts() -> int:
    return int(shown(ENGINE, "NRestarts")["NRestarts"])


def started_again(after: int) -> int | None:
    """Wait for what becomes of an engine that has ended, which was process `after`.

    The process id of the next one; None if systemd does not start it any more.
    """

    def decided() -> tuple[str, int] | None:
        told = shown(ENGINE, "ActiveState", "MainPID")
        state, pid = told["ActiveState"], int(told["MainPID"])
        return (state, pid) if state == "failed" or pid not in (0, after) else None

    state, pid = wait(decided, "a start, or none any more")
    return None if state == "failed" else pid


@dataclass(frozen=True)
class Entry:
    """One line of the journal about a service: by itself, by `etd safe`, or by systemd."""

    pid: int
    text: str


def _journalctl(*arguments: str) -> str:
    """All that has been said so far: what still lies in the journal's sockets is written first."""
    said_by("journalctl", "--sync")
    return said_by("journalctl", "--no-pager", *arguments)


def cursor(unit: str = ENGINE) -> str:
    """The last of a service's entries: `--after-cursor` counts within what is asked for."""
    told = _journalctl("--lines=1", "--show-cursor", f"--unit={unit}")
    found = re.search(r"-- cursor: (\S+)", told)
    return found[1] if found else ""


def journal(since: str, unit: str = ENGINE) -> list[Entry]:
    """A service's entries after a cursor."""
    after = (f"--after-cursor={since}",) if since else ()
    told = _journalctl("--output=json", f"--unit={unit}", *after)
    entries = [json.loads(line) for line in told.splitlines()]
    return [Entry(int(entry["_PID"]), str(entry["MESSAGE"])) for entry in entries]


def safe_pids(of: list[Entry]) -> list[int]:
    """Of each `etd safe` that said that it was."""
    return [entry.pid for entry in of if entry.text.startswith("safe (linux): ")]


def wait(ask: Callable[[], T | None], what: str, within_s: float = WITHIN_S) -> T:
    """The first answer that is one."""
    deadline_ns = CLOCK.now_ns() + int(within_s * 1e9)
    while CLOCK.now_ns() < deadline_ns:
        answer = ask()
        if answer is not None and answer is not False:
            return answer
        CLOCK.sleep_until_ns(CLOCK.now_ns() + _PAUSE_NS)
    raise AssertionError(f"never: {what}; the journal: {journal('')[-20:]}")


def status() -> StateReport | None:
    """What the gateway says; None if it does not."""
    try:
        with Display(address=ADDRESS) as display:
            return display.status()
    except EtdError:
        return None


def wait_for_state(state: str) -> StateReport:
    def there() -> StateReport | None:
        told = status()
        return told if told and (told.engine, told.state) == ("there", state) else None

    return wait(there, f"an engine that is there and {state}")


def clear_crash() -> None:
    """As an operator does after an engine that was killed with the supply on."""
    halt = wait_for_state("HALTED").halt
    assert halt is not None
    assert halt.source == "crash", halt
    assert "killed" in halt.detail
    said_by("etd", "clear")
    wait_for_state("SAFE")


def play(pattern: Path, levels: dict[int, float]) -> subprocess.CompletedProcess[str]:
    """A person plays these electrodes' levels of 1000 uA for a second (docs/bring-up.md)."""
    level = [levels.get(electrode, 0.0) for electrode in range(64)]
    frames = [{"duration_ms": 1_000, "level": level, "rate_hz": 20}]
    pattern.write_text(json.dumps({"etd_pattern": 1, "electrodes": 64, "frames": frames}))
    command = ("etd", "play", str(pattern), "--current-ua", "1000", "--width-us", "100", "--arm")
    return run(*command, "--allow-slower", user=PERSON)


@contextmanager
def showing(currents_ua: list[int]) -> Iterator[Display]:
    """For a second at most; for the first two tenths the opening lets nothing through."""
    with Display(address=ADDRESS, max_current_ua=1_000, width_us=100) as display:
        display.arm()
        display.show_current(currents_ua, ttl_ms=1_000, rate_hz=5, allow_slower=True)
        yield display


def owner_of(path: Path) -> str:
    """Owner, group and mode, as in `ls`: "root gpio 660"."""
    return said_by("stat", "--format=%U %G %a", str(path)).strip()


def process_facts(pid: int) -> dict[str, str]:
    """What the kernel says of a process."""
    told = Path(f"/proc/{pid}/status").read_text()
    return {key: value.strip() for key, _, value in map(_parted, told.splitlines())}


def children_of(pid: int) -> list[int]:
    """The processes that it has started, in the order of their numbers."""
    pids = sorted(int(path.name) for path in Path("/proc").iterdir() if path.name.isdecimal())
    return [child for child in pids if process_facts(child)["PPid"] == str(pid)]


def opened_by(pid: int) -> list[str]:
    """What a process has open, as the kernel names it."""
    return [os.readlink(path) for path in Path(f"/proc/{pid}/fd").iterdir()]


def _parted(line: str) -> tuple[str, str, str]:
    return line.partition(":")


def groups_of(pid: int) -> set[str]:
    """The names of the groups that a process is in, its first one included."""
    facts = process_facts(pid)
    ids = {*facts["Groups"].split(), facts["Gid"].split()[0]}
    return {grp.getgrgid(int(text)).gr_name for text in ids}


def user_of(pid: int) -> str:
    return pwd.getpwuid(os.stat(f"/proc/{pid}").st_uid).pw_name
