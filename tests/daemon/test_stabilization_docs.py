"""docs/stabilization.md against the settings, the shipped files and the program that writes in it.

Owns: the table that the page tells to append, the list of laws, which are on, which are recommended
and where each is excluded, the worst that page and README open with, and the marks.
Must not know: what a law does, what came out of a benchmark.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from bench import steady_docs, steady_opening
from bench.steady_exclusions import documented
from bench.steady_harm import RECOMMENDED
from etd.files.body_site import load_body_site
from etd.stabilize.settings import NO_STABILIZERS, Name
from etd_body.kinds import BodyKind

REPOSITORY = Path(__file__).parents[2]
SITES = sorted((REPOSITORY / "config" / "bodysites").glob("*.toml"))
PAGE = REPOSITORY / "docs" / "stabilization.md"
TEXT = PAGE.read_text(encoding="utf-8")
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")


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


@pytest.mark.parametrize("form", steady_docs.HARMS)
def test_readme_and_page_open_with_the_worst_of_all_tables(form: str) -> None:
    """The most variation that a law left on any body, first that of the worst form; in the page
    also the most in times of no law's. `make bench-steady ARGS=--write-docs` writes them.
    """
    of_forms = {form: compared(form) for form in steady_docs.HARMS}
    opening = TEXT.partition("**The worst, first**")[2].partition("**No law is on")[0]
    for text in (opening, README.partition("\n## ")[0]):
        said = re.findall(r"from (\d+) to (\d+) %", " ".join(text.split()))
        most = tuple(map(str, max(of_forms[form])[::-1]))
        assert most in said
        assert said[0] == tuple(map(str, max(max(found) for found in of_forms.values())[::-1]))
    with_law, before = max(of_forms[form], key=lambda one: one[0] / one[1])
    assert f"from {before} to {with_law} %" in " ".join(opening.split())


def compared(form: str) -> list[tuple[int, int]]:
    """Variation with and without a law, of each cell of a form's table."""
    head, _, plain, *laws = table(form)
    without = [percent(cell) for cell in plain.split(" | ")[1:]]
    found = [
        (with_law, before)
        for law in laws
        for with_law, before in zip(map(percent, law.split(" | ")[1:]), without, strict=True)
        if with_law is not None and before is not None
    ]
    assert len(found) >= len(laws) * head.count(" | ") // 2
    return found


def table(form: str) -> list[str]:
    """Its lines, without the bars around them."""
    begin, end = steady_docs.HARMS[form]
    return re.findall(r"^\| ?(.*?) ?\|$", TEXT.partition(begin)[2].partition(end)[0], re.MULTILINE)


def test_what_readme_and_page_open_with_is_as_the_benchmark_writes_it(tmp_path: Path) -> None:
    page, readme = tmp_path / PAGE.name, tmp_path / "README.md"
    page.write_text(TEXT, encoding="utf-8")
    readme.write_text(README, encoding="utf-8")
    steady_opening.write(page, readme)
    steady_docs.write_exclusions(page, documented())
    assert readme.read_text(encoding="utf-8") == README
    assert page.read_text(encoding="utf-8") == TEXT


@pytest.mark.parametrize("form", steady_docs.HARMS)
def test_each_law_is_out_where_it_is_excluded_and_nowhere_else(form: str) -> None:
    """If not: mend `tests/bench/steady_exclusions.toml`, and write the docs again. With 64
    electrodes an exclusion may be of earlier fingers than the table's.
    """
    head, _, _, *laws = table(form)
    bodies = [BodyKind(body) for body in head.strip("| ").split(" | ")]
    assert set(bodies) == set(BodyKind)
    rows = {name: cells for name, *cells in (law.split(" | ") for law in laws)}
    out = {
        law: {body for body, cell in zip(bodies, cells, strict=True) if cell.startswith("**")}
        for law, cells in rows.items()
    }
    known = documented()
    played = {law for law, excluded in known.items() if excluded.by_form[form] is not None}
    excluded = {law: set(known[law].on(form)) for law in played}
    assert set(excluded) == set(out)
    assert {law: out[law] - excluded[law] for law in out} == {law: set() for law in out}
    if form == "short":
        assert excluded == out, "always the same finger"


def test_the_columns_of_exclusions_say_where_a_law_is_out() -> None:
    """What `all but` stands for, and what `none`: read as a reader does."""
    begin, end = steady_docs.EXCLUSIONS
    part = TEXT.partition(begin)[2].partition(end)[0]
    _, *rows = re.findall(r"^\| (.*?) \|$", part, re.MULTILINE)
    known = documented()
    assert len(rows) == len(known)
    for row, excluded in zip(rows, known.values(), strict=True):
        for said, form in zip(row.split(" | ")[1:4], steady_docs.HARMS, strict=True):
            named = set(map(BodyKind, re.findall(r"`(\w+)`", said)))
            read = set(BodyKind) - named if said.startswith("all") else named
            assert read == set(excluded.on(form))
            assert (said == "not played") == (excluded.by_form[form] is None)


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
