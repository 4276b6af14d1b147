"""How old the figures of the evidence are: what was changed in the product since each was measured.

Owns: the table that says so. Must not know: what is measured, and how.

A figure is of the code that it was measured with. One that is older than the product need not be
wrong, but a reader must see its age.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

#: What runs at a person, and by which settings.
PRODUCT = ("daemon", "hal", "config")
#: As a section says it, or a row of what was played by several versions.
_VERSION = re.compile(r"^(?:- version: \S+ |\| )([0-9a-f]{7,40})(?: \||$)", re.MULTILINE)


def ages(sections: Iterable[str], clone: Path) -> list[str]:
    """As Markdown, a row for each section and version."""
    rows = [
        f"| {_title(section)} | {version} | {changed_since(version, clone)} |"
        for section in sections
        for version in dict.fromkeys(_VERSION.findall(section))
    ]
    if not rows:
        return []
    folders = ", ".join(f"`{folder}`" for folder in PRODUCT)
    return [
        f"How many files of {folders} are other ones by now, when this page was written:",
        "",
        "| measured | by version | changed since |",
        "|---|---|---|",
        *rows,
    ]


def changed_since(version: str, clone: Path) -> str:
    """How many of the product's files the clone has otherwise than this version."""
    if shutil.which("git") is None:
        return "not known: there is no git"
    asked = ("git", "diff", "--name-only", version, "--", *PRODUCT)
    said = subprocess.run(asked, cwd=clone, capture_output=True, text=True, check=False)
    if said.returncode:
        return "not known: this clone does not have it"
    return str(len(said.stdout.splitlines()))


def _title(section: str) -> str:
    return section.partition("\n")[0].removeprefix("## ")
