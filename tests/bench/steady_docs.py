"""What a run of the benchmark says in the docs: its table, its conditions, what was met.

Owns: the part of docs/stabilization.md between two marks, which nobody writes by hand.
Must not know: how a run is made, how a figure is counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.run import Bound
from bench.steady_figures import SteadyFigures

PAGE = Path(__file__).resolve().parents[2] / "docs" / "stabilization.md"
_BEGIN, _END = "<!-- written by make bench-steady -->\n", "<!-- so far -->\n"
COLUMNS = (
    *("felt", "over time", "over electrodes", "not felt", "above pain (scans)", "most pain"),
    *("touching again", "(mean)", "(above 1.2)", "(within 7 s)"),
)


def cells(one: SteadyFigures) -> tuple[str, ...]:
    """Of a row, in the order of `COLUMNS`."""
    return (
        f"{one.mean_felt:.2f}",
        f"{one.over_time:.1%}",
        f"{one.over_electrodes:.1%}",
        f"{one.below_threshold:.1%}",
        f"{one.above_pain:.3%} ({one.scans_above_pain})",
        f"{one.most_pain:.2f}",
        "-" if one.recontact_step is None else f"{one.recontact_step:.2f}",
        "-" if one.recontact_step_mean is None else f"{one.recontact_step_mean:.2f}",
        f"{one.recontacts_above} of {one.recontacts}, {one.recontacts_not_judged} not judged",
        f"{one.recontacts_above_later}",
    )


def write(page: Path, found: Sequence[SteadyFigures], held: Sequence[Bound], said: str) -> None:
    """Raises: ValueError, where the marks are not there."""
    text = page.read_text(encoding="utf-8")
    before, begin, rest = text.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    if not (begin and end):
        raise ValueError(f"{page} has lost its marks: {_BEGIN!r} and {_END!r}")
    page.write_text(before + begin + _part(found, held, said) + end + after, encoding="utf-8")


def _part(found: Sequence[SteadyFigures], held: Sequence[Bound], said: str) -> str:
    rows = [f"| {one.name} | {' | '.join(cells(one))} |\n" for one in found]
    verdicts = [
        f"- {'Met' if one.is_met else '**Not met**'}: {one.what}: {one.value:g} (bound"
        f" {one.bound:g}).\n"
        for one in held
    ]
    head = f"| | {' | '.join(COLUMNS)} |\n|---|{'---|' * len(COLUMNS)}\n"
    return f"\n{said[:1].upper()}{said[1:]}:\n\n{head}{''.join(rows)}\n{''.join(verdicts)}\n"
