"""A client on another computer: everything over OpenSSH, on the loopback, as another account."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import WITHIN_S, command_rig, wait_for_end
from etd.files.calibration import load_calibration
from etd.files.resources import find
from ssh_rig import MEMBER, SshRig, missing, ssh_rig

WHY_NOT = missing()
IS_MISSING = pytest.mark.skipif(WHY_NOT is not None, reason=str(WHY_NOT))
pytestmark = [pytest.mark.slow, IS_MISSING]

#: What a program on a laptop does. It prints what it found as one JSON object.
EXPERIMENT = """
import json, time
from etd import Display
found = []
with Display(host="display") as display, display.kept():
    display.arm(open_to=0.6)
    for _ in range(2):
        time.sleep(1.2)  # without the keeper the lease would lapse
        found.append(display.present({27: 0.5}, seconds=0.2))
    print(json.dumps([
        # On a busy machine the fake fires less, and says so.
        [all("of about" in why for why in shown.why_not), shown.first_ns, shown.uncertainty_ns]
        for shown in found
    ]))
"""


@pytest.fixture
def rig() -> Iterator[SshRig]:
    with command_rig() as commands, ssh_rig(commands) as made:
        yield made


def python(rig: SshRig, script: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        env={**rig.environment, **environment},
        timeout=WITHIN_S,
        check=False,
    )


#: No lease lapses because the machine is busy, where nothing is about when it does.
PATIENT = ("--timeout-factor", "5")


def first_pulses_ns(trace: Path) -> list[int]:
    """Of electrode 27, each after a silence of 100 ms."""
    found = [
        int(match[1])
        for line in trace.read_text().splitlines()
        if '"electrode": 27,' in line and (match := re.search(r'"t_ns": (\d+)', line))
    ]
    return [at for before, at in zip([0, *found], found, strict=False) if at - before > 100_000_000]


def test_an_experiment_is_the_same_over_ssh_as_beside_the_daemon(rig: SshRig) -> None:
    trace = rig.commands.folder / "trace.jsonl"
    with rig.commands.daemon("--trace", str(trace), *PATIENT):
        rig.admit()
        ran = python(rig, EXPERIMENT)
    assert (ran.returncode, ran.stderr) == (0, "")
    shown = json.loads(ran.stdout)
    assert all(as_asked for as_asked, *_ in shown)
    begun_ns = first_pulses_ns(trace)
    for _, first_ns, uncertainty_ns in shown:
        assert any(abs(first_ns - at_ns) < 1_000_000 for at_ns in begun_ns)
        # Both computers' clocks are one here, which the client does not know; and a fake's lags.
        assert uncertainty_ns > 0


def test_the_clocks_offset_is_right_within_what_is_said(rig: SshRig) -> None:
    script = """
from etd import Display
from etd.client import clock
with Display(host="display") as display:
    display.arm()
    shown = display.present({27: 0.0, 5: 0.2}, seconds=0.05)
    off_ns = abs(shown.wall_offset_ns - clock.wall_offset_ns())
    assert off_ns <= shown.uncertainty_ns + 1_000_000, (off_ns, shown.uncertainty_ns)
"""
    with rig.commands.daemon(*PATIENT):
        rig.admit()
        ran = python(rig, script)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_a_client_without_unix_sockets_goes_over_the_loopback(rig: SshRig) -> None:
    trace = rig.commands.folder / "trace.jsonl"
    with rig.commands.daemon("--trace", str(trace), *PATIENT):
        rig.admit()
        script = EXPERIMENT + "    assert display.address.startswith('tcp://127.0.0.1:')\n"
        script = script.replace("range(2)", "range(1)")
        ran = python(rig, "import socket; del socket.AF_UNIX\n" + script)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert all(as_asked for as_asked, *_ in json.loads(ran.stdout))
    assert first_pulses_ns(trace)


def test_commands_go_there_too(rig: SshRig) -> None:
    with rig.commands.daemon():
        rig.admit()
        status = rig.commands.run("status", "--host", "display", "--json")
        assert status.answer["status"]["state"] == "SAFE"
        rig.commands.environment = {**rig.environment, "ETD_HOST": "display"}
        stopped = rig.commands.run("stop", "--json")
        assert (stopped.status, stopped.answer["daemons"][0]["address"]) == (0, "display")
        rig.commands.environment = rig.environment
        assert "HALTED" in rig.commands.run("status").out


def test_a_calibration_is_stored_and_deleted_by_a_process_there(rig: SshRig) -> None:
    file = rig.commands.folder / "mine.toml"
    file.write_bytes(find("calibrations", "fake-fingertip").read_bytes())
    stored = rig.calibrations / "P01.toml"
    with rig.commands.daemon():
        rig.admit()
        taken = rig.commands.run(
            "calibration", "import", str(file), "--as", "P01", "--host", "display"
        )
        assert (taken.status, taken.err) == (0, "")
        assert (stored.stat().st_uid, stored.stat().st_mode & 0o777) == (MEMBER[1], 0o644)
        assert load_calibration(stored) == load_calibration(file)
        script = """
from etd import Display, Refused
with Display(host="display") as display:
    made = display.calibration("fake-fingertip")
    display.check_may_store()
    display.set_calibration("P02", made)
    display.set_calibration("--help", made)
    display.delete_calibration("P01")
    display.delete_calibration("--help")
    for act in (
        lambda: display.set_calibration("fake-fingertip", made),
        lambda: display.delete_calibration("P01"),
        lambda: display.delete_calibration("-x\\n"),
    ):
        try:
            act()
        except Refused as refusal:
            print(refusal.code)
    print(*(name for name in display.calibrations() if name.startswith("P")))
"""
        ran = python(rig, script)
        expected = "bad_calibration\nnot_found\nbad_message\nP02\n"
        assert (ran.returncode, ran.stderr, ran.stdout) == (0, "", expected)
        rig.calibrations.chmod(0o2755)
        early = rig.commands.run(
            *("calibrate", "P03", "--max-current-ua", "1000", "--host", "display", "--json")
        )
        assert (early.status, early.answer["error"]) == (1, "not_permitted")
        refused = rig.commands.run("calibration", "delete", "P02", "--host", "display", "--json")
        assert (refused.status, refused.answer["error"]) == (1, "not_permitted")
        assert "adduser NAME etd-operators" in refused.answer["reason"]


# --- what goes wrong ------------------------------------------------------------------------------


def said_by(ran: subprocess.CompletedProcess[str]) -> str:
    assert ran.returncode == 1
    return ran.stderr.strip().splitlines()[-1]


def connect(host: str) -> str:
    return f"from etd import Display\nDisplay(host={host!r})"


def test_an_account_in_no_group_gets_a_sentence(rig: SshRig) -> None:
    with rig.commands.daemon():
        rig.admit()
        said = said_by(python(rig, connect("stranger")))
    assert "this account may not use the daemon's socket at stranger:/run/etd/main" in said
    assert "group" in said


def test_without_a_daemon_or_without_a_host_it_is_said_at_once(rig: SshRig) -> None:
    assert "there is no socket at display:/run/etd/main" in said_by(python(rig, connect("display")))
    nobody = said_by(python(rig, connect("nobody-there")))
    assert "ssh could not connect" in nobody
    assert "Connection refused" in nobody
    assert "give a host" in said_by(python(rig, connect("-oProxyCommand=true")))


def test_what_ssh_said_last_is_told_though_it_has_ended(rig: SshRig) -> None:
    folder = rig.folder / "late"
    folder.mkdir()
    (folder / "ssh").write_text("#!/bin/sh\n(sleep 0.2; echo it was late >&2) & exit 255\n")
    (folder / "ssh").chmod(0o755)
    path = f"{folder}:{rig.environment['PATH']}"
    assert "it was late" in said_by(python(rig, connect("nobody-there"), PATH=path))


def test_a_connection_that_ends_is_told_and_the_lease_lapses(rig: SshRig) -> None:
    script = """
import sys, time
from etd import DaemonGone, Display
display = Display(host="display")
display.arm()
print("armed", flush=True)
sys.stdin.readline()
begun = time.monotonic()
try:
    display.show([0.0] * display.electrodes)
except DaemonGone as gone:
    print(round(time.monotonic() - begun, 1), gone, flush=True)
"""
    with rig.commands.daemon() as daemon:
        rig.admit()
        with subprocess.Popen(
            [sys.executable, "-c", script],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=rig.environment,
            text=True,
        ) as program:
            assert program.stdin is not None
            assert program.stdout is not None
            assert program.stdout.readline() == "armed\n"
            (ssh,) = rig.ssh_processes()
            os.kill(ssh, signal.SIGKILL)
            wait_for_end([ssh])
            program.stdin.write("\n")
            program.stdin.flush()
            seconds, _, said = program.stdout.readline().partition(" ")
        assert float(seconds) < 1.5, "sooner than an answer is waited for"
        assert "the connection to display has ended" in said
        assert "lapsed" in daemon.line_with("SAFE: lapsed")


def test_a_program_that_is_killed_leaves_no_connection(rig: SshRig) -> None:
    script = """
import time
from etd import Display
display = Display(host="display")
print("there", flush=True)
time.sleep(600)
"""
    with rig.commands.daemon():
        rig.admit()
        with subprocess.Popen(
            [sys.executable, "-c", script], stdout=subprocess.PIPE, env=rig.environment, text=True
        ) as program:
            assert program.stdout is not None
            assert program.stdout.readline() == "there\n"
            (ssh,) = rig.ssh_processes()
            program.kill()
        wait_for_end([ssh])


def test_a_link_that_stalls_and_comes_back_shows_no_stale_frame(rig: SshRig) -> None:
    """ssh is stopped for 3 s while frames are streamed into it."""
    script = """
import sys, time
from etd import Display, EtdError
display = Display(host="display", timeout_s=0.5)
display.arm(open_to=0.6)
display.show({27: 0.5})
print(time.monotonic_ns(), flush=True)
sys.stdin.readline()
until = time.monotonic() + 3.5
while time.monotonic() < until:
    try:
        display.stream({27: 0.5}, ttl_ms=300)
    except EtdError:
        pass
    time.sleep(0.05)
"""
    trace = rig.commands.folder / "trace.jsonl"
    with rig.commands.daemon("--trace", str(trace)):
        rig.admit()
        with subprocess.Popen(
            [sys.executable, "-c", script],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=rig.environment,
            text=True,
        ) as program:
            assert program.stdin is not None
            assert program.stdout is not None
            stopped_ns = int(program.stdout.readline())
            (ssh,) = rig.ssh_processes()
            os.kill(ssh, signal.SIGSTOP)
            program.stdin.write("\n")
            program.stdin.flush()
            subprocess.run(["sleep", "3"], check=True)
            os.kill(ssh, signal.SIGCONT)
            program.wait(WITHIN_S)
    late = [
        int(match[1])
        for line in trace.read_text().splitlines()
        if '"electrode": 27,' in line and (match := re.search(r'"t_ns": (\d+)', line))
    ]
    # The last frame before the stop lives for 200 ms; what was streamed meanwhile is too old.
    assert late
    assert max(late) < stopped_ns + 1_000_000_000


def test_ctrl_c_ends_the_program_silent_over_the_same_connection(rig: SshRig) -> None:
    """The terminal sends it to all of its processes: ssh must outlive it."""
    script = """
from etd import Display
with Display(host="display") as display:
    display.arm(open_to=0.6)
    print("armed", flush=True)
    display.hold({27: 0.5}, seconds=60)
"""
    with rig.commands.daemon() as daemon:
        rig.admit()
        with subprocess.Popen(
            [sys.executable, "-c", script],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=rig.environment,
            text=True,
            start_new_session=True,
        ) as program:
            assert program.stdout is not None
            assert program.stdout.readline() == "armed\n"
            os.killpg(program.pid, signal.SIGINT)
            program.wait(WITHIN_S)
        assert "closed" in daemon.line_with("etd main: SAFE: ")
