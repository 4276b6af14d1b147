"""The README's first example, as it stands there, against the daemon that it names."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import WITHIN_S, CommandRig, command_rig

README = Path(__file__).parents[2] / "README.md"


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def first_example() -> str:
    found = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


def test_the_first_example_runs_as_it_is_and_is_felt(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    with rig.daemon("--trace", str(trace)):
        ran = subprocess.run(
            [sys.executable, "-c", first_example()],
            capture_output=True,
            text=True,
            env=rig.environment,
            timeout=WITHIN_S,
            check=False,
        )
    assert (ran.returncode, ran.stderr) == (0, "")
    # On a busy machine the fake fires less, and says so.
    assert re.search(r" as asked$| of about \d+ pulses ", ran.stdout.strip())
    felt = re.findall(r'"bus": "body", "electrode": (\d+)', trace.read_text())
    assert set(felt) >= {"27", "28"}
