"""What `make bench-felt` shows: its tables in the terminal, and in docs/stabilization.md.

Owns: which figure stands where, and the part of the page between two marks, which nobody writes by
hand. Must not know: how a figure is made, which bound a body has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isnan
from pathlib import Path
from textwrap import fill

from rich.table import Table

from bench import felt_harm
from bench.felt_compared import RAISED, Compared
from bench.run import Bound
from bench.steady_docs import put

BEGIN, RAISING_BEGIN, END = (
    "<!-- written by make bench-felt, as it ships -->\n",
    "<!-- written by make bench-felt, where answers may raise -->\n",
    "<!-- so far, felt -->\n",
)
_SHIPS = "As it ships: answers lower, and give back what was lowered"
_RAISING = (
    "Where the body site lets answers raise (`felt_may_raise = true`), of those of whom"
    " `--adaptation` found that they feel less in use"
)


def _times(times: float, each: Compared) -> str:
    return f"**{times:.2f}**" if times > each.bound else f"{times:.2f}"


def _pair(plain: float, said: float, digits: int = 0) -> str:
    return f"{100 * plain:.{digits}f}, {100 * said:.{digits}f} %"


#: By the name of the row: what it says of a body.
_ROWS: dict[str, Callable[[Compared], str]] = {
    "bound": lambda each: f"{each.bound:g}",
    "variation, times that without answers": lambda each: _times(each.variation_times, each),
    "its standard error, over fingers": lambda each: (
        "-" if isnan(each.standard_error) else f"{each.standard_error:.3f}"
    ),
    "fingers, persons of each": lambda each: (
        f"{each.fingers}, {each.persons // max(each.fingers, 1)}"
    ),
    "the worst of these fingers": lambda each: _times(each.worst_times, each),
    "the worst person": lambda each: _times(each.worst_person_times, each),
    "variation without, with": lambda each: _pair(each.plain.variation, each.said.variation),
    "not felt": lambda each: _pair(each.plain.not_felt, each.said.not_felt),
    "scans above pain": lambda each: (
        f"{each.plain.scans_above_pain:.0f}, {each.said.scans_above_pain:.0f}"
        f"{' (excluded)' if felt_harm.is_out(each) else ''}"
    ),
    "too strong for them, of the time": lambda each: _pair(
        each.plain.too_strong, each.said.too_strong
    ),
    "too weak": lambda each: _pair(each.plain.too_weak, each.said.too_weak),
}
_RAISING_ROWS: dict[str, Callable[[Compared], str]] = {
    "persons whose answers may raise": lambda each: f"{each.raisers} of {each.persons}",
}
#: Of the fingers without answers, so the same whether answers may raise or not.
_DRIFT_ROWS: dict[str, Callable[[Compared], str]] = {
    "of the variance: drift, common to all": lambda each: f"{each.drift.drift:.0%}",
    "its size, of the current": lambda each: f"{100 * each.drift.size:.0f} %",
    "moments, common to all": lambda each: f"{each.drift.moments:.0%}",
    "each electrode's own": lambda each: f"{each.drift.own:.0%}",
    "left, with each moment's mean taken": lambda each: f"{each.drift.left_moments:.2f}",
    "with each minute's": lambda each: f"{each.drift.left_minutes:.2f}",
    "with each minute's, at most 1.2 times": lambda each: f"{each.drift.left_at_most:.2f}",
}


def write(page: Path, found: Sequence[Compared], said: str, not_met: Sequence[Bound]) -> None:
    """One table, as it ships or where answers may raise, and each bound of it that is not met.
    Raises: ValueError, where the marks are not there.
    """
    may_raise = found[0].may_raise
    told = [
        *(
            f"On {each.unfelt} of the fingers of `{each.body}` nothing is felt without answers:"
            " they have no variation, and are left out of it."
            for each in found
            if each.unfelt
        ),
        *(
            f"Not met: {bound.what}: {bound.value:g} (bound {bound.bound:g})."
            for bound in not_met
            if (RAISED in bound.what) == may_raise
        ),
        *felt_harm.excluded(found),
    ]
    rows = _RAISING_ROWS | _ROWS if may_raise else _ROWS | _DRIFT_ROWS
    begin, what = (RAISING_BEGIN, _RAISING) if may_raise else (BEGIN, _SHIPS)
    parts = [
        f"\n{what}. {said[:1].upper()}{said[1:]}:\n\n{_table(found, rows)}\n",
        *(fill(f"- {each}", 118, subsequent_indent="  ") + "\n" for each in told),
    ]
    put(page, begin, "".join(parts) + ("\n" if told else ""), END)


def _table(found: Sequence[Compared], rows: dict[str, Callable[[Compared], str]]) -> str:
    head = f"| | {' | '.join(each.body.value for each in found)} |\n|---|{'---|' * len(found)}\n"
    return head + "".join(
        f"| {name} | {' | '.join(map(row, found))} |\n" for name, row in rows.items()
    )


def table(found: Sequence[Compared], title: str) -> Table:
    """A body to a line."""
    made = Table(title=title)
    for heading in ("", "may raise", "variation", "times", "error", "finger", "person", "bound"):
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
            f"{each.raisers} of {each.persons}",
            f"{said.variation:.1%} ({plain.variation:.1%})",
            f"{'[red]' if each.variation_times > each.bound else ''}{each.variation_times:.2f}",
            "-" if isnan(each.standard_error) else f"{each.standard_error:.3f}",
            f"{each.worst_times:.2f}",
            f"{each.worst_person_times:.2f}",
            f"{each.bound:g}",
            f"{said.not_felt:.1%} ({plain.not_felt:.1%})",
            f"{said.scans_above_pain:.0f} ({plain.scans_above_pain:.0f})",
            f"{said.too_strong:.0%} ({plain.too_strong:.0%})",
            f"{said.too_weak:.0%} ({plain.too_weak:.0%})",
            *(f"{it:.0%}" for it in (drift.drift, drift.size, drift.moments, drift.own)),
        )
    made.caption = (
        "in brackets: without answers. Error: the standard error of times, over fingers. Finger,"
        " person: the worst of them. Drift, moments: parts of the variance without answers that are"
        " common to all electrodes; own: each one's. Size: of the drift, of the current that would"
        " make up for it"
    )
    return made
