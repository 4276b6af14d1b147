"""A bounded part of the fault campaign, as it is played on every change: every class and scene."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from msgspec.structs import replace

from campaign.judge import bounds
from campaign.results import kept
from campaign.scenes import BOARDS, SCENES

RUN = Path(__file__).resolve().parents[2] / "tests" / "campaign" / "run.py"


def test_a_bounded_part_of_it_holds_and_goes_on_where_it_was_cut(tmp_path: Path) -> None:
    command = [sys.executable, str(RUN), "--bounded", "--pairs", "2", "--folder", str(tmp_path)]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    said = json.loads(done.stdout)
    found = said["by_class"]
    for what in ("cases", "told", "silent"):
        assert sum(one[what] for one in said["in_all"]) == sum(one[what] for one in found)
    failed = "a call fails, nothing done"
    assert all(one["silent"] == 0 for one in found if one["fault_class"] == failed)
    assert sum(one["told"] for one in found) > 100
    assert {one["fault_class"] for one in found} == set(bounds())
    doubled = sum(one["cases"] for one in found if one["fault_class"] == "two at once")
    assert doubled == 2 * len(BOARDS) * len(SCENES)

    one = min(tmp_path.glob("*/*.jsonl"))
    before = kept(one)
    one.write_bytes(b"".join(one.read_bytes().splitlines(keepends=True)[:-3]))
    board, scene = one.stem.split(" ", 1)
    command += ["--boards", board, "--scenes", scene]
    subprocess.run(command, capture_output=True, check=True)
    again, at_first = (
        {
            (each.kind, each.operation): replace(each, played="", processor_s=0.0)
            for each in outcomes
        }
        for outcomes in (kept(one), before)
    )
    assert again == at_first
    assert all(each.version and each.played for each in kept(one))
