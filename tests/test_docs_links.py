"""Every page of the docs is found from the README, and every link among them leads somewhere.

Owns: following the links of Markdown files. Must not know: what the pages say, the network.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
README = REPOSITORY / "README.md"
#: Where no reader looks for a page.
CHANGELOG = REPOSITORY / "CHANGELOG.md"
PAGES = sorted(REPOSITORY.glob("docs/**/*.md"))


def links(page: Path) -> Iterator[tuple[Path, str]]:
    """(file or folder, anchor) of each link within the repository; code blocks are none."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" not in target and not target.startswith("mailto:"):
            path, _, anchor = target.partition("#")
            yield (page.parent / path).resolve() if path else page, anchor


def anchors(page: Path) -> set[str]:
    """Of its headings, as GitHub makes them."""
    found: set[str] = set()
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return found


def reachable() -> set[Path]:
    found, waiting = {README}, [README]
    while waiting:
        for target, _ in links(waiting.pop()):
            pages = set(target.glob("*.md")) if target.is_dir() else {target}
            new = {page for page in pages if page.suffix == ".md"} - found - {CHANGELOG}
            found |= new
            waiting += [page for page in new if page.exists()]
    return found


def test_every_page_is_found_by_links_from_the_readme() -> None:
    assert len(PAGES) > 20
    found = reachable()
    lost = [str(page.relative_to(REPOSITORY)) for page in PAGES if page not in found]
    assert lost == [], "linked from no page: name it under 'Read on' of README.md"


@pytest.mark.parametrize(
    "page",
    [README, REPOSITORY / "CONTRIBUTING.md", REPOSITORY / "SECURITY.md", *PAGES],
    ids=lambda page: str(page.relative_to(REPOSITORY)),
)
def test_every_link_leads_to_a_file_and_to_a_heading_of_it(page: Path) -> None:
    for target, anchor in links(page):
        assert target.exists(), target
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), f"{target.name}#{anchor}"
