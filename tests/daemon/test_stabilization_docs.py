"""docs/stabilization.md against the settings, the shipped files and the program that writes in it.

Owns: the table that the page tells to append, the list of laws, which are on and which are
recommended, and the marks.
Must not know: what a law does, what came out of a benchmark.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from bench import steady_docs
from bench.steady_harm import RECOMMENDED
from etd.files.body_site import load_body_site
from etd.stabilize.settings import NO_STABILIZERS, Name

REPOSITORY = Path(__file__).parents[2]
SITES = sorted((REPOSITORY / "config" / "bodysites").glob("*.toml"))
PAGE = REPOSITORY / "docs" / "stabilization.md"
TEXT = PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("site", SITES, ids=lambda site: str(site.stem))
def test_the_table_on_the_page_can_be_appended_to_a_shipped_site(
    site: Path, tmp_path: Path
) -> None:
    (table,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    copy = tmp_path / "steady.toml"
    copy.write_text(site.read_text(encoding="utf-8") + "\n" + table, encoding="utf-8")
    settings = load_body_site(copy).stabilize
    assert settings.order == ("power_law",)
    assert not settings.probe_first
    assert not settings.before_contact


def test_no_shipped_file_has_a_law_switched_on_as_the_page_says() -> None:
    assert "**No law is on in a shipped file.**" in TEXT
    assert SITES
    for site in SITES:
        assert load_body_site(site).stabilize == NO_STABILIZERS
        assert f"`{site.stem}`" in TEXT


@pytest.mark.parametrize("law", [*get_args(Name), "probe_first", "bursts"])
def test_each_law_has_a_line_of_its_own(law: str) -> None:
    assert re.search(rf"^- \*\*`{law}`\*\*: \S", TEXT, re.MULTILINE)


def test_the_benchmark_writes_between_its_marks_and_nowhere_else(tmp_path: Path) -> None:
    copy = tmp_path / PAGE.name
    copy.write_text(TEXT, encoding="utf-8")
    steady_docs.write(copy, [], [], "a run that was not made")
    written = copy.read_text(encoding="utf-8")
    assert "A run that was not made:" in written
    assert outside_of_marks(written) == outside_of_marks(TEXT)


@pytest.mark.parametrize("form", steady_docs.HARMS)
def test_the_benchmark_of_all_bodies_writes_between_its_marks_too(
    form: str, tmp_path: Path
) -> None:
    copy = tmp_path / PAGE.name
    copy.write_text(TEXT, encoding="utf-8")
    steady_docs.write_harms(copy, form, [], "a run that was not made")
    written = copy.read_text(encoding="utf-8")
    assert "A run that was not made:" in written
    assert outside_of_marks(written, *steady_docs.HARMS[form]) == outside_of_marks(
        TEXT, *steady_docs.HARMS[form]
    )


def test_the_page_recommends_what_the_benchmark_binds() -> None:
    (said,) = re.findall(r"^\*\*Recommended: (.*?)\.\*\*", TEXT, re.MULTILINE)
    assert said == (", ".join(f"`{law}`" for law in RECOMMENDED) or "none")


def test_readme_and_page_open_with_the_worst_of_the_table() -> None:
    """The most variation that a law left on any body, and the most in times of no law's."""
    table = TEXT.partition(steady_docs.HARMS["full"][0])[2].partition(steady_docs.HARMS["full"][1])
    head, _, plain, *laws = re.findall(r"^\| ?(.*?) ?\|$", table[0], re.MULTILINE)
    without = [percent(cell) for cell in plain.split(" | ")[1:]]
    found = [
        (with_law, before)
        for law in laws
        for with_law, before in zip(map(percent, law.split(" | ")[1:]), without, strict=True)
        if with_law is not None and before is not None
    ]
    assert len(found) > 5 * head.count(" | ")
    most = max(found)
    opening = TEXT.partition("**The worst, first**")[2].partition("**No law is on")[0]
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    for text in (opening, readme.partition("\n## ")[0]):
        assert f"from {most[1]} to {most[0]} %" in " ".join(text.split())
    with_law, before = max(found, key=lambda one: one[0] / one[1])
    assert f"from {before} to {with_law} %" in " ".join(opening.split())


def percent(cell: str) -> int | None:
    """The variation in a cell; None where the law was refused, or not played."""
    found = re.match(r"\*{0,2}(\d+)%", cell)
    return None if found is None else int(found[1])


def outside_of_marks(
    text: str,
    begin: str = "<!-- written by make bench-finger -->\n",
    end: str = "<!-- so far -->\n",
) -> tuple[str, str]:
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    assert before
    assert after
    return before, after
