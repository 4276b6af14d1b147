"""What `make bench-felt` shows: its table in the terminal, and in docs/stabilization.md.

Owns: which figure stands where, and the part of the page between two marks, which nobody writes by
hand. Must not know: how a figure is made, which bound a body has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import fill

from rich.table import Table

from bench.felt_compared import Compared
from bench.steady_docs import put

BEGIN, END = "<!-- written by make bench-felt -->\n", "<!-- so far, felt -->\n"


def _times(each: Compared) -> str:
    return f"{each.variation_times:.2f}"


def _foreseen(each: Compared) -> str:
    return "-" if each.foreseen_times is None else f"{each.foreseen_times:.2f}"


def _pair(plain: float, said: float, digits: int = 0) -> str:
    return f"{100 * plain:.{digits}f}, {100 * said:.{digits}f} %"


#: By the name of the row: what it says of a body.
_ROWS: dict[str, Callable[[Compared], str]] = {
    "bound": lambda each: f"{each.bound:g}",
    "variation, times that without answers": lambda each: (
        f"**{_times(each)}**" if each.variation_times > each.bound else _times(each)
    ),
    "the worst of these fingers": lambda each: (
        f"**{each.worst_times:.2f}**"
        if each.worst_times > each.bound
        else f"{each.worst_times:.2f}"
    ),
    "all known beforehand, each *too strong* heeded": _foreseen,
    "variation without, with": lambda each: _pair(each.plain.variation, each.said.variation),
    "not felt": lambda each: _pair(each.plain.not_felt, each.said.not_felt),
    "scans above pain": lambda each: (
        f"{each.plain.scans_above_pain:.0f}, {each.said.scans_above_pain:.0f}"
    ),
    "too strong for them, of the time": lambda each: _pair(
        each.plain.too_strong, each.said.too_strong
    ),
    "of the variance: drift, common to all": lambda each: f"{each.drift.drift:.0%}",
    "its size, of the current": lambda each: f"{100 * each.drift.size:.0f} %",
    "moments, common to all": lambda each: f"{each.drift.moments:.0%}",
    "each electrode's own": lambda each: f"{each.drift.own:.0%}",
    "left, with each moment's mean taken": lambda each: f"{each.drift.left_moments:.2f}",
    "with each minute's": lambda each: f"{each.drift.left_minutes:.2f}",
    "with each minute's, at most 1.2 times": lambda each: f"{each.drift.left_at_most:.2f}",
}


def write(page: Path, found: Sequence[Compared], said: str, not_asked: Sequence[str]) -> None:
    """Raises: ValueError, where the marks are not there."""
    head = f"| | {' | '.join(each.body.value for each in found)} |\n|---|{'---|' * len(found)}\n"
    rows = "".join(f"| {name} | {' | '.join(map(row, found))} |\n" for name, row in _ROWS.items())
    told = "".join(fill(f"- {each}", 118, subsequent_indent="  ") + "\n" for each in not_asked)
    told = f"{told}\n" if told else ""
    put(page, BEGIN, f"\n{said[:1].upper()}{said[1:]}:\n\n{head}{rows}\n{told}", END)


def table(found: Sequence[Compared], title: str) -> Table:
    """A body to a line."""
    made = Table(title=title)
    for heading in ("", "variation", "times", "worst", "bound", "foreseen"):
        made.add_column(heading, justify="right")
    for heading in (
        "not felt",
        "above pain",
        "too strong",
        "too weak",
        "drift",
        "size",
        "moments",
        "own",
    ):
        made.add_column(heading, justify="right")
    for each in found:
        said, plain, drift = each.said, each.plain, each.drift
        made.add_row(
            each.body.value,
            f"{said.variation:.1%} ({plain.variation:.1%})",
            f"{'[red]' if each.variation_times > each.bound else ''}{_times(each)}",
            f"{each.worst_times:.2f}",
            f"{each.bound:g}",
            _foreseen(each),
            f"{said.not_felt:.1%} ({plain.not_felt:.1%})",
            f"{said.scans_above_pain:.0f} ({plain.scans_above_pain:.0f})",
            f"{said.too_strong:.0%} ({plain.too_strong:.0%})",
            f"{said.too_weak:.0%} ({plain.too_weak:.0%})",
            *(f"{it:.0%}" for it in (drift.drift, drift.size, drift.moments, drift.own)),
        )
    made.caption = (
        "in brackets: without answers. Drift, moments: parts of the variance without answers that"
        " are common to all electrodes; own: each one's. Size: of the drift, of the current that"
        " would make up for it. Foreseen: variation, in times of that without answers, where all is"
        " known beforehand and each too strong is heeded"
    )
    return made
