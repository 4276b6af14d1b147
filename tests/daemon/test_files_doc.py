"""The examples of docs/files.md are files that load."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from etd.files.check import check_file
from files_by_hand import REPOSITORY, write

DOC = (REPOSITORY / "docs" / "files.md").read_text(encoding="utf-8")
SECTIONS = {
    heading: re.search(r"```(toml|json)\n(.*?)```", text, re.DOTALL)
    for heading, text in re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", DOC, re.DOTALL | re.MULTILINE)
}
EXAMPLES = {heading: found[2] for heading, found in SECTIONS.items() if found is not None}


def test_there_is_an_example_of_each_kind_but_the_board() -> None:
    assert list(EXAMPLES) == [
        "Configuration",
        "Machine",
        "Array",
        "Body site",
        "Calibration",
        "Pattern",
    ]


@pytest.mark.parametrize("heading", EXAMPLES)
def test_the_example_holds_together_and_is_of_the_kind_it_stands_under(
    tmp_path: Path, heading: str
) -> None:
    checked = check_file(write(tmp_path, "example", EXAMPLES[heading]))
    assert checked.error is None
    assert checked.kind == heading.lower()


def test_the_example_of_a_body_site_puts_contact_first_as_the_advice_is() -> None:
    order = tomllib.loads(EXAMPLES["Body site"])["stabilize"]["order"]
    assert order[0] == "contact"
    assert len(order) > 1
