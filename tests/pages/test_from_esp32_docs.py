"""The commands and the program of docs/from-esp32-kits.md, as they stand there, on the fake."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import WITHIN_S, CommandRig, Said, command_rig

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parents[2]
PAGE = (REPOSITORY / "docs" / "from-esp32-kits.md").read_text(encoding="utf-8")
#: No lease lapses because the machine is busy.
PATIENT = ("--timeout-factor", "10")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    """With the two files of the page, and the shipped ones where a clone has them."""
    with command_rig() as made:
        for text in re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL):
            name = "rows.json" if "Pattern_Data" in text else "layout.json"
            (made.folder / name).write_text(text)
        (made.folder / "config").symlink_to(REPOSITORY / "config")
        yield made


def run(rig: CommandRig, command: str) -> Said:
    name, *words = shlex.split(command)
    assert name == "etd"
    said = rig.run(*words)
    assert (said.status, said.err) == (0, ""), said
    return said


def form_of(line: str) -> str:
    """Without figures, which are of one run, and without what a busy machine adds to them."""
    form = re.sub(r"[\d.]+", "#", line.strip()).replace(" (# too late to be shown)", "")
    return re.split(r" (?:and # pulses )?in # s", form)[0]


def test_each_command_prints_what_the_page_shows(rig: CommandRig) -> None:
    shown = re.findall(r"^\$ (etd .*)\n((?:(?!\$|```).*\n)+)", PAGE, re.MULTILINE)
    assert len(shown) >= 7
    for command, lines in shown:
        printed = [form_of(line) for line in run(rig, command).out.splitlines()]
        assert [line for line in map(form_of, lines.splitlines()) if line not in printed] == []


def test_the_table_and_the_program_run_beside_the_daemon_of_the_page(rig: CommandRig) -> None:
    """Of the table, what needs no person and no Pi."""
    cells = re.findall(r"^\| [^|]+ \| (.*) \|$", PAGE, re.MULTILINE)
    named = [word for cell in cells for word in re.findall(r"`([^`]+)`", cell)]
    (played,) = [word for word in named if word.startswith("etd play") and "--current" in word]
    assert {"--polarity cathodic", "biphasic", "--max-rate 30"} < set(named)
    told = rig.run(*shlex.split(played)[1:], "--polarity", "biphasic", "--max-rate", "30")
    assert told.status == 0, told
    assert "0 frames clamped" in told.out
    (arguments,) = re.findall(r"^etd run --board fake:etactilekit-hv513 (.*)$", PAGE, re.MULTILINE)
    with rig.daemon(*shlex.split(arguments), *PATIENT):
        for command in ("etd measure", "etd record start first", "etd record stop"):
            assert command in named
            run(rig, command)
        check_the_program(rig)
        for command in ("etd stop", "etd clear"):
            assert command in named
            run(rig, command)


def check_the_program(rig: CommandRig) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True,
        text=True,
        env=rig.environment,
        timeout=WITHIN_S,
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    # On a busy machine the fake fires less, and says so.
    assert re.search(r" as asked$| of about \d+ pulses ", ran.stdout.strip())
