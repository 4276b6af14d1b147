"""The program in docs/calibration.md, as it stands there, against a daemon with a modelled body."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import WITHIN_S, CommandRig, command_rig
from etd.files.calibration import load_calibration
from etd.files.resources import find

pytestmark = pytest.mark.slow

DOC = Path(__file__).parents[2] / "docs" / "calibration.md"


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def program() -> str:
    # Not the one with a reason not to run it, in the line before.
    found = re.findall(r"(?<!-->\n)```python\n(.*?)```", DOC.read_text(encoding="utf-8"), re.DOTALL)
    assert len(found) == 1
    return str(found[0])


def test_the_program_finds_where_the_fingertip_begins_to_feel(rig: CommandRig) -> None:
    with rig.daemon():
        ran = subprocess.run(
            [sys.executable, "-W", "error", "-c", program()],
            capture_output=True,
            text=True,
            env=rig.environment,
            timeout=3 * WITHIN_S,
            check=False,
        )
    assert (ran.returncode, ran.stderr) == (0, "")
    said = re.fullmatch(r"electrode 12: (\d+) uA, felt: True\n", ran.stdout)
    assert said is not None, ran.stdout
    when_laid_on = load_calibration(find("calibrations", "fake-fingertip")).electrode[12]
    # It sweats and moves meanwhile.
    assert 0.7 < int(said[1]) / when_laid_on.threshold_ua < 1.4
