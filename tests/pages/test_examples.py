"""The examples, as they stand there, against the daemon that they name."""

from __future__ import annotations

import ast
import csv
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from command_rig import WITHIN_S, CommandRig, command_rig

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
ALONE = ("two_displays.py", "stop_button.py", "plain_json.py")
TRIALS = "4"
#: No lease lapses because the machine is busy.
PATIENT = ("--timeout-factor", "10")
#: What each says last.
SAID = {
    "hello.py": r"felt at .* - (as asked|.* of about \d+ pulses .*)$",
    "moving_bar.py": r"^$",
    "two_intervals.py": r"after 4 trials the difference is 0\.\d+",
    "stream_numpy.py": r"^$",
    "with_asyncio.py": r"ARMED while it is felt\n\d\d pulses, \d\d ticks meanwhile$",
    "contact.py": r"touched before: 64 of 64\n\d+ (soft|closed).*; up to \d+ ohm$",
    "markers.py": (
        r"(?s)trial 2: marked at \d+ ns .*; first pulse at \d+ ns, 20\d\d-.*"
        r"triggered: first pulse \d+ us after the edge$"
    ),
}


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def run(rig: CommandRig, name: str, *words: str) -> str:
    ran = subprocess.run(
        [sys.executable, EXAMPLES / name, *words],
        capture_output=True,
        text=True,
        env=rig.environment,
        cwd=rig.folder,
        stdin=subprocess.DEVNULL,
        timeout=WITHIN_S,
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (0, ""), ran
    return ran.stdout.strip()


def fired(trace: Path) -> int:
    return len(re.findall(r'"bus": "body"', trace.read_text()))


def test_each_is_listed_and_run_here() -> None:
    names = {path.name for path in EXAMPLES.glob("*.py")}
    assert names == {*SAID, *ALONE}
    assert set(re.findall(r"\]\((\w+\.py)\)", (EXAMPLES / "README.md").read_text())) == names


def test_each_runs_and_is_felt(rig: CommandRig) -> None:
    """One after another beside one daemon, as somebody tries them."""
    trace = rig.folder / "trace.jsonl"
    before = 0
    with rig.daemon("--trace", str(trace), *PATIENT):
        for name, expected in SAID.items():
            said = run(rig, name, *((TRIALS,) if name == "two_intervals.py" else ()))
            assert re.search(expected, said), f"{name} said {said}"
            after = fired(trace)
            # 64 electrodes are measured when it is armed.
            assert after - before > 64 + 5, name
            before = after
    with (rig.folder / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == int(TRIALS)
    assert all(int(row["second_ns"]) > int(row["first_ns"]) for row in rows)


def test_two_displays_are_two_daemons(rig: CommandRig) -> None:
    with ExitStack() as stack:
        for name in ("left", "right"):
            stack.enter_context(rig.daemon("--name", name, *PATIENT))
        assert re.match(r"first pulses [\d.]+ ms apart", run(rig, "two_displays.py"))


def test_enter_stops_it_from_another_thread(rig: CommandRig) -> None:
    with (
        rig.daemon(*PATIENT),
        subprocess.Popen(
            [sys.executable, EXAMPLES / "stop_button.py"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=rig.environment,
            text=True,
        ) as program,
    ):
        assert program.stdout is not None
        assert program.stdout.readline() == "Enter stops it\n"
        said, _ = program.communicate("\n", timeout=WITHIN_S)
        # A frame that was on its way to the engine already finds that its lease has ended.
        assert re.match("stopped: (halted by stop|no lease stands)", said)
        assert program.returncode == 0


def test_plain_json_needs_nothing_but_pyzmq_and_an_old_python(rig: CommandRig) -> None:
    source = (EXAMPLES / "plain_json.py").read_text()
    tree = ast.parse(source, feature_version=(3, 8))
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    assert imported == {"json", "sys", "time", "zmq"}
    with rig.daemon(*PATIENT):
        address = f"ipc://{rig.folder}/run/etd/main/control.sock"
        said = run(rig, "plain_json.py", address)
    assert re.search(r"\d+ pulses of up to \d+ uA in the last frame$", said)
    assert "soft_start" in said
