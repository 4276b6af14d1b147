"""Every fault is named at the stage where it can first be seen."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from etd import selftest
from selftest_cases import ALL, BARE, CASES, RELAY, Case, case_id, rig_of
from selftest_rig import bad, selftest_rig


@pytest.mark.parametrize("case", CASES, ids=case_id)
def test_a_fault_is_named_at_its_stage_and_nothing_comes_after_it(case: Case) -> None:
    report = rig_of(case).run()
    failed = [found for found in bad(report) if found[0] != "end"]
    assert not report.passed
    assert {stage for stage, _ in failed} == {case.stage}
    assert (case.stage, case.name) in failed
    later = [check for check in report.checks if check.name == "all"]
    assert all(check.result == "skip" for check in later)


def test_at_least_twenty_five_kinds_of_trouble_are_tried() -> None:
    assert len({case.faults[0] if case.faults else case.what for case in CASES}) >= 25
    assert len(CASES) == len({case.what for case in CASES})


def test_every_check_that_is_made_or_fails_is_in_the_table_of_what_to_do() -> None:
    table = (Path(__file__).parents[2] / "docs/bring-up.md").read_text(encoding="utf-8")
    told = set(re.findall(r"`(?:[a-z]+: )?([a-z_]+)`", table))
    told |= {f"{name}_idle" for name in told if name.startswith("rise")}
    made = {
        check.name for board in (ALL, BARE, RELAY) for check in selftest_rig(board).run().checks
    }
    assert (made | judged() | {case.name for case in CASES}) - told == set()


def judged() -> set[str]:
    """The names that stand in the stages themselves, whichever board has them."""
    calls = [
        node
        for path in Path(selftest.__file__).parent.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "judge"
    ]
    first = [call.args[0] for call in calls]
    return {str(expr.value) for expr in first if isinstance(expr, ast.Constant)}
