"""Each hazard on docs/fmea.md is traced to checks, classes of the campaign and tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from campaign.judge import bounds

CLONE = Path(__file__).resolve().parents[1]
PAGE = (CLONE / "docs" / "fmea.md").read_text(encoding="utf-8")
SAFETY = (CLONE / "docs" / "safety.md").read_text(encoding="utf-8")
_HEADER = "| # | what goes wrong | told or prevented by | played as | kept by | what is left |"
_COLUMNS = len(_HEADER.split("|")) - 2
_NOT_TREATED = "**Not treated**"


def rows() -> list[list[str]]:
    lines = [line for line in PAGE.splitlines() if re.match(r"\| \d", line)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def checked() -> set[str]:
    """What is checked while it runs, as docs/safety.md names it."""
    _, _, after = SAFETY.partition("## What is checked while it runs")
    table = [line for line in after.partition("\n## ")[0].splitlines() if line.startswith("|")]
    return {line.strip("|").split("|")[0].strip() for line in table[2:]}


def named_checks(row: list[str]) -> set[str]:
    """In italics; a sentence may begin with one."""
    found = re.findall(r"(?<!\*)\*([^*]+)\*(?!\*)", row[2])
    return {name[0].lower() + name[1:] if name not in checked() else name for name in found}


def played(row: list[str]) -> list[str]:
    return [] if row[3] == "-" else row[3].split("; ")


def files(row: list[str]) -> list[str]:
    return [] if row[4] == "-" else [name.strip("`") for name in row[4].split(", ")]


def test_each_number_is_there_once_and_in_order() -> None:
    assert [row[0] for row in rows()] == [str(number + 1) for number in range(len(rows()))]
    assert len(rows()) >= 40
    assert PAGE.count(_HEADER) == PAGE.count("\n## ")


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_what_a_row_names_exists(row: list[str]) -> None:
    assert len(row) == _COLUMNS
    assert all(row), "an empty cell says nothing"
    assert named_checks(row) - checked() == set()
    assert [name for name in played(row) if name not in bounds()] == []
    assert [name for name in files(row) if not (CLONE / name).is_file()] == []


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_a_row_without_a_test_says_that_it_is_not_treated(row: list[str]) -> None:
    assert files(row) or _NOT_TREATED in row[2] + row[5]


def test_every_check_guards_against_something() -> None:
    named = {name for row in rows() for name in named_checks(row)}
    assert checked() - named == set()


def test_every_class_of_the_campaign_is_a_hazard() -> None:
    assert set(bounds()) - {name for row in rows() for name in played(row)} == set()


@pytest.mark.parametrize("page", ["fmea.md", "hardware.md"])
def test_how_long_etd_safe_takes_is_what_was_measured(page: str) -> None:
    evidence = (CLONE / "docs" / "evidence.md").read_text(encoding="utf-8")
    found = re.search(r"^\| etd safe alone \| \d+ \| (\S+) \| \S+ \| (\S+) \|$", evidence, re.M)
    assert found is not None
    p50_ms, most_ms = (round(float(figure)) for figure in found.groups())
    text = " ".join((CLONE / "docs" / page).read_text(encoding="utf-8").split())
    said = re.search(r"(\d+) ms (?:after the engine is killed|in the middle).*?(\d+) at most", text)
    assert said is not None
    assert tuple(map(int, said.groups())) == (p50_ms, most_ms)
