"""The page of `make evidence`: figures as they were given, and what failed as that."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from bench.evidence import (
    MEASUREMENTS,
    Measured,
    Measurement,
    changed,
    kept,
    measured,
    page,
    rendered,
    section,
)
from bench.evidence_age import ages

ANY = MEASUREMENTS[1]
FIRST, SECOND, *REST = [one.name for one in MEASUREMENTS]


def test_a_list_of_objects_is_a_table_and_an_object_a_list() -> None:
    found = rendered([{"load": "none", "heard_p99_ms": 1.23456}, {"load": "all", "lost": 2}])
    assert found == [
        "| load | heard p99 ms | lost |",
        "|---|---|---|",
        "| none | 1.235 | - |",
        "| all | - | 2 |",
    ]
    assert rendered({"frame_ms": {"p50": 1.5, "max": 2}, "mb": [60.0, 61.5], "is_met": True}) == [
        "- frame ms: p50 1.5, max 2",
        "- mb: 60, 61.5",
        "- is met: yes",
    ]


def test_what_another_page_shows_is_left_out() -> None:
    asked = Measurement("one", "One", "run.py", "", "", left_out=("rows",))
    text = section(Measured(asked, "run.py", 0, 2.0, {"all": 3, "rows": [{"a": 1}]}, ""))
    assert "- all: 3" in text
    assert "rows" not in text


def test_what_failed_is_on_the_page_as_that() -> None:
    text = section(Measured(ANY, "run.py --short", 1, 2.0, None, "no engine within 30 s"))
    assert "`python run.py --short` in its SHORT form: 2 s, exit status 1: NOT met." in text
    assert "no engine within 30 s" in text


def test_what_was_recorded_is_not_said_to_have_been_measured_now() -> None:
    asked = Measurement("one", "One", "a", "b", "", recorded="-c print({})")
    found = measured(asked, is_recorded=True)
    assert found.figures == {}
    assert "shows what was recorded, by the versions below: " in section(found)
    assert "recorded" not in section(Measured(asked, "a", 0, 2.0, {}, ""))


def test_a_command_is_run_and_its_last_line_is_taken() -> None:
    asked = Measurement("one", "One", "-c pass", "-c print(1);print(dict(a=1))", "")
    assert measured(asked, is_short=False).figures is None
    found = measured(asked, is_short=True)
    assert (found.status, found.figures) == (0, None)
    assert found.said.endswith("{'a': 1}")
    as_json = Measurement("one", "One", "", "-c print('{\"a\":1}')", "")
    assert measured(as_json, is_short=True).figures == {"a": 1}
    indented = Measurement("one", "One", "", "-c print('[\\n1\\n]')", "")
    assert measured(indented, is_short=True).figures == [1]


def test_each_section_names_machine_date_and_version() -> None:
    text = section(Measured(ANY, "run.py", 0, 2.0, {"a": 1}, ""))
    for what in ("- date: 20", "- version: ", "- machine: ", "cores", "- a: 1", "bounds were met"):
        assert what in text


@pytest.mark.parametrize("figures", [{"rows": [{"a": 1, "b": "x"}], "## a": 2}, None])
def test_what_is_not_measured_anew_keeps_its_section(figures: object) -> None:
    said = "cut off\n### a heading\n"
    before = {
        one.name: section(Measured(one, one.command, 0, 2.0, figures, said))
        for one in MEASUREMENTS[:2]
    }
    text = page(before)
    assert kept(text) == before
    assert [name for name in REST if f"make evidence ARGS='--only {name}'" in text] == REST
    again = page({**kept(text), SECOND: section(Measured(ANY, "anew", 0, 1.0, {"a": 7}, ""))})
    assert kept(again)[FIRST] == before[FIRST]
    assert "anew" in kept(again)[SECOND]
    assert page(kept(again)) == again


def git(clone: Path, *asked: str) -> str:
    who = ("-c", "user.name=n", "-c", "user.email=n@example.org")
    said = subprocess.run(["git", *who, *asked], cwd=clone, check=True, capture_output=True)
    return said.stdout.decode().strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="there is no git on this machine")
def test_how_much_of_the_product_has_changed_since_each_was_measured(tmp_path: Path) -> None:
    for file in ("daemon/a.py", "hal/b.py", "tests/c.py"):
        (tmp_path / file).parent.mkdir()
        (tmp_path / file).write_text("1")
    git(tmp_path, "init")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-m", "first")
    version = git(tmp_path, "describe", "--always")
    section = f"## Kills\n\n- version: 0.1.0, {version}\n- machine: 2 cores"
    played = f"## Faults\n\n| version | day |\n|---|---|\n| {version} | a day |\n| 0123abc | no |"
    assert ages(["## Without\n\n- version: 0.1.0, not from a clone"], tmp_path) == []
    for changed_files, count in (((), 0), (("tests/c.py", "hal/b.py"), 1), (("daemon/a.py",), 2)):
        for file in changed_files:
            (tmp_path / file).write_text("2")
        *_, kills, faults, unknown = ages([section, played], tmp_path)
        assert kills == f"| Kills | {version} | {count} |"
        assert faults == f"| Faults | {version} | {count} |"
        assert unknown == "| Faults | 0123abc | not known: this clone does not have it |"


@pytest.mark.skipif(shutil.which("git") is None, reason="there is no git on this machine")
def test_what_is_not_committed_is_named_but_for_what_the_measurements_write(
    tmp_path: Path,
) -> None:
    (tmp_path / "docs").mkdir()
    for file in ("a.py", "docs/evidence.md"):
        (tmp_path / file).write_text("1")
    git(tmp_path, "init")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-m", "first")
    assert changed(tmp_path) == []
    (tmp_path / "docs" / "evidence.md").write_text("2")
    (tmp_path / "untracked").write_text("2")
    assert changed(tmp_path) == []
    (tmp_path / "a.py").write_text("2")
    assert changed(tmp_path) == ["a.py"]
    git(tmp_path, "add", "a.py")
    assert changed(tmp_path) == ["a.py"]
