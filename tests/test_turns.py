"""Of a test of a whole model with many cases every third one is run in CI, each in its turn."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CLONE = Path(__file__).resolve().parents[1]
MANY = """
import pytest
@pytest.mark.parametrize("case", range(5))
def test_many(case): pass
@pytest.mark.parametrize("case", range(3))
def test_few(case): pass
def test_one(): pass
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("turns")
    own = (CLONE / "tests" / "models" / "conftest.py").read_text(encoding="utf-8")
    (made / "conftest.py").write_text(own, encoding="utf-8")
    (made / "test_these.py").write_text(MANY, encoding="utf-8")
    return made


def collected(folder: Path, *options: str) -> set[str]:
    said = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider",
         "--rootdir", str(folder), *options, str(folder)],
        capture_output=True, text=True, check=True, env={"PYTHONPATH": str(CLONE / "tests")},
    )  # fmt: skip
    return {line.partition("::")[2] for line in said.stdout.splitlines() if "::" in line}


def test_each_case_has_its_turn_and_a_test_with_few_has_each_turn(folder: Path) -> None:
    given = [("--turn=0",), ("--turn=1",), ("--turn=2",)]
    whole, *turns = (collected(folder, *options) for options in ((), *given))
    assert len(whole) == 9
    few = {one for one in whole if "many" not in one}
    assert set.intersection(*turns) == few
    assert set.union(*turns) == whole
    assert [len(turn) for turn in turns] == [6, 6, 5]
