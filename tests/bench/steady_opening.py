"""What README.md and docs/stabilization.md open with: the worst that any law did on any body.

Owns: reading the tables that `make bench-steady` wrote into the page, of all forms, and the
sentences between two marks of either file, which nobody writes by hand. The page is what is read,
so that a run of one form tells the worst of all.
Must not know: how a run is made, what is out of bounds, how a table is written.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.steady_docs import HARMS, between, put
from bench.steady_laws import OWN_K

README = Path(__file__).resolve().parents[2] / "README.md"
MARKS = ("<!-- the worst, written by make bench-steady -->\n", "<!-- so far, the worst -->\n")
_WIDTH = 120
_FIGURES = re.compile(r"(\d+)%, (\d+)%, (\d+)")


@dataclass(frozen=True)
class Told:
    """One law on one body, as a table of the page has it: whole percent."""

    #: As the table's conditions begin: "8 electrodes"; with the form's name, where it is unbroken.
    of: str
    law: str
    body: str
    without: int
    left: int
    not_felt_without: int
    not_felt: int

    @property
    def times(self) -> float:
        return self.left / max(self.without, 1)


def told(text: str, form: str) -> list[Told]:
    """All cells of a form's table with figures of a law's own: one that is refused has none.

    Raises: ValueError, where the marks or the table are not there.
    """
    part = between(text, *HARMS[form])
    conditions = re.search(r"^\d+ electrodes", part, re.MULTILINE)
    lines = [line for line in part.splitlines() if line.startswith("| ")]
    rows = [[cell.strip(" *") for cell in line.split("|")[1:-1]] for line in lines]
    if conditions is None or len(rows) < 2:
        raise ValueError(f"no table of the {form} form")
    of = f"{conditions[0]}, {form}" if form == "unbroken" else conditions[0]
    (_, *bodies), (_, *plain), *laws = rows
    found: list[Told] = []
    for law, *cells in laws:
        for body, before, cell in zip(bodies, plain, cells, strict=True):
            without, left = _FIGURES.match(before), _FIGURES.match(cell)
            if without and left:
                figures = (int(one[number]) for number in (1, 2) for one in (without, left))
                found.append(Told(of, law, body, *figures))
    return found


def worst(cells: Sequence[Told]) -> list[Told]:
    """The most variation that was left; then the most in times of no law's, if that is another."""
    if not cells:
        return []
    most = max(cells, key=lambda cell: (cell.left, cell.times))
    return list(dict.fromkeys((most, max(cells, key=lambda cell: (cell.times, cell.left)))))


def write(page: Path, readme: Path) -> None:
    """Into both, from the tables of the page as they are. Raises: ValueError."""
    text = page.read_text(encoding="utf-8")
    # The worst form first.
    forms = sorted(
        (told(text, form) for form in HARMS),
        key=lambda cells: -max((cell.left for cell in cells), default=0),
    )
    put(page, MARKS[0], page_part(forms), MARKS[1])
    put(readme, MARKS[0], readme_part(forms), MARKS[1])


def page_part(forms: Sequence[Sequence[Told]]) -> str:
    """The worst of each form; and of those laws alone that go by the finger's own k."""
    lines = [f"With {cells[0].of}: {_said(cells)}." for cells in forms if cells]
    own = [[cell for cell in cells if cell.law in OWN_K] for cells in forms]
    by_own = "; ".join(f"with {cells[0].of} {_said(cells)}" for cells in own if cells)
    if by_own:
        lines.append(f"By the finger's own k, which the fit finds or refuses: {by_own}.")
    return "".join(_filled(f"- {line}", "  ") for line in lines) or "- No law was played.\n"


def readme_part(forms: Sequence[Sequence[Told]]) -> str:
    """The worst alone, of each form."""
    each = [
        f"from {cell.without} to {cell.left} % with {cell.of} (`{cell.law}` on `{cell.body}`)"
        for cells in forms
        for cell in worst(cells)[:1]
    ]
    said = ", ".join(each) or "no law was played"
    return _filled(f"Variation of what is felt, without a law and with the worst one: {said}.")


def _filled(line: str, indent: str = "") -> str:
    """What is between backticks is not torn."""
    whole = re.sub(r"`.*?`", lambda code: code[0].replace(" ", "\0"), line)
    filled = textwrap.fill(whole, _WIDTH, subsequent_indent=indent, break_on_hyphens=False)
    return filled.replace("\0", " ") + "\n"


def _said(cells: Sequence[Told]) -> str:
    return "; in times of no law's the most is ".join(
        f"`{cell.law}`, from {cell.without} to {cell.left} % on `{cell.body}`"
        f" ({cell.not_felt_without} to {cell.not_felt} % not felt)"
        for cell in worst(cells)
    )
