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


def cells(steady_figures: SteadyFigures) -> tuple[str, ...]:
    """Of a row, in the order of `COLUMNS`."""
    return (
        f"{steady_figures.mean_felt:.2f}",
        f"{steady_figures.over_time:.1%}",
        f"{steady_figures.over_electrodes:.1%}",
        f"{steady_figures.below_threshold:.1%}",
        f"{steady_figures.above_pain:.3%} ({steady_figures.scans_above_pain})",
        f"{steady_figures.most_pain:.2f}",
        "-" if steady_figures.recontact_step is None else f"{steady_figures.recontact_step:.2f}",
        "-"
        if steady_figures.recontact_step_mean is None
        else f"{steady_figures.recontact_step_mean:.2f}",
        f"{steady_figures.recontacts_above} of {steady_figures.recontacts}, "
        f"{steady_figures.recontacts_not_judged} not judged",
        f"{steady_figures.recontacts_above_later}",
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
    rows = [
        f"| {steady_figures.name} | {' | '.join(cells(steady_figures))} |\n"
        for steady_figures in found
    ]
    verdicts = [
        f"- {'Met' if bound.is_met else '**Not met**'}: {bound.what}: {bound.value:g} (bound"
        f" {bound.bound:g}).\n"
        for bound in held
    ]
    head = f"| | {' | '.join(COLUMNS)} |\n|---|{'---|' * len(COLUMNS)}\n"
    return f"\n{said[:1].upper()}{said[1:]}:\n\n{head}{''.join(rows)}\n{''.join(verdicts)}\n"
