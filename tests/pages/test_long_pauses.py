"""The experiment with pauses of twenty seconds: fired as asked, and silent when it is killed."""

from __future__ import annotations

import csv
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from command_rig import WITHIN_S, CommandRig, command_rig
from etd.client import Display, clock
from etd.protocol.messages import Scan
from etd.record.lines import End, LeaseBegun, Line, Pulses, Scans, State
from etd.record.reader import RecordReader

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "two_intervals.py"
TRIALS, PAUSE_S = 2, 20.0
LOOK_UA = 300
#: No lease lapses because the machine is busy: a frame's ttl is ten times as long, too.
PATIENT = ("--timeout-factor", "10")
#: A frame of `present` lives for as long as was asked, 300 ms in the example.
TTL_NS = 10 * 300_000_000
#: Between the reading of a clock here and the engine's look at it.
SLACK_NS = 200_000_000


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@contextmanager
def experiment(rig: CommandRig, pause_s: float) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, EXAMPLE, str(TRIALS), str(pause_s)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=rig.environment,
        cwd=rig.folder,
        text=True,
    ) as program:
        yield program


def fired_ns(trace: Path) -> list[int]:
    """What is stronger than a look at the contact, by the wires."""
    found = re.findall(r'"from_ns": (\d+).*"asked_ua": (\d+)', trace.read_text())
    return [int(from_ns) for from_ns, asked_ua in found if int(asked_ua) > LOOK_UA]


def recorded(rig: CommandRig) -> list[Line]:
    (path,) = (rig.folder / "state").rglob("records/*.jsonl")
    return list(RecordReader(path))


def test_trials_twenty_seconds_apart_are_fired_as_asked_and_begin_when_it_is_said(
    rig: CommandRig,
) -> None:
    trace = rig.folder / "trace.jsonl"
    with rig.daemon("--trace", str(trace), *PATIENT), experiment(rig, PAUSE_S) as program:
        said = program.communicate(timeout=WITHIN_S + 2 * TRIALS * PAUSE_S)
        assert (program.returncode, said[1]) == (0, "")
    at_ns = fired_ns(trace)
    with (rig.folder / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == TRIALS
    lines = recorded(rig)
    begun = [shown.first_ns for line in lines if isinstance(line, Scans) for shown in line.shown]
    for row in rows:
        for name in ("first_ns", "second_ns"):
            onset_ns = int(row[name])
            assert onset_ns in begun
            # A message begins some microseconds before its pulse; and it is the first one.
            near = [t_ns - onset_ns for t_ns in at_ns if abs(t_ns - onset_ns) < PAUSE_S / 2 * 1e9]
            assert 0 <= min(near) < 200_000
    last_cut_ns = max(
        row.t_ns
        for line in lines
        if isinstance(line, Pulses)
        for row in line.rows
        if row.purpose == "stimulus" and row.limited is not None
    )
    assert last_cut_ns < int(rows[0]["first_ns"])
    assert len([line for line in lines if isinstance(line, LeaseBegun)]) == 1
    states = [line.report.state for line in lines if isinstance(line, State)]
    armed = states.index("ARMED")
    assert "ARMED" not in states[:armed]
    assert set(states[armed:]) <= {"ARMED", "SAFE"}, "it was armed once"


def wait_until(address: str, *, is_within: bool) -> int:
    """Until the first trial is felt, or is over. Returns how late the fake's clock is, in ns."""
    silent_s = 0.5
    last_ns = 0
    with Display(address=address) as display, display.telemetry("scan") as reports:
        for _, report in reports:
            assert isinstance(report, Scan)
            at_ns = [shown.first_ns for shown in report.shown if shown.first_ns is not None]
            is_first = bool(last_ns and at_ns and max(at_ns) - last_ns > silent_s * 1e9)
            last_ns = max([last_ns, *at_ns])
            if is_first:
                break
        if not is_within:
            clock.sleep_s(silent_s)
        return 1_000 * display.status().clock_lag_us


@pytest.mark.parametrize("is_within", [False, True], ids=["gap", "stimulus"])
def test_a_program_that_is_killed_leaves_silence_and_a_record(
    rig: CommandRig, is_within: bool
) -> None:
    trace = rig.folder / "trace.jsonl"
    with rig.daemon("--trace", str(trace), *PATIENT), experiment(rig, 2.0) as program:
        address = f"ipc://{next((rig.folder / 'run').rglob('control.sock'))}"
        lag_ns = wait_until(address, is_within=is_within)
        program.send_signal(signal.SIGKILL)
        killed_ns = clock.now_ns()
        program.communicate(timeout=WITHIN_S)
        with Display(address=address) as display:
            while display.status().holder is not None:
                clock.sleep_s(0.1)
        assert rig.run("record", "stop").status == 0
    at_ns = fired_ns(trace)
    # The fake's clock is late by less and less: what it says is never later than it was.
    assert max(at_ns) <= killed_ns + TTL_NS + SLACK_NS
    if is_within:
        assert max(at_ns) > killed_ns - lag_ns - TTL_NS
    lines = recorded(rig)
    fired = [
        row.t_ns
        for line in lines
        if isinstance(line, Pulses)
        for row in line.rows
        if row.purpose == "stimulus" and row.current_ua
    ]
    assert abs(max(fired) - max(at_ns)) < 1_000_000
    assert isinstance(lines[-1], End)
