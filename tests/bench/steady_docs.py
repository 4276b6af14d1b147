"""What a run of the benchmark says in the docs: its table, its conditions, what was met.

Owns: the part of docs/stabilization.md between two marks, which nobody writes by hand.
Must not know: how a run is made, how a figure is counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.run import Bound
from bench.steady_figures import SteadyFigures
from bench.steady_harm import Harm, exclusions
from etd_body.kinds import BodyKind

PAGE = Path(__file__).resolve().parents[2] / "docs" / "stabilization.md"
_BEGIN, _END = "<!-- written by make bench-finger -->\n", "<!-- so far -->\n"
#: Of the benchmark of all bodies, by the name of the form that was played.
HARMS = {
    "full": ("<!-- written by make bench-steady -->\n", "<!-- so far, full -->\n"),
    "short": ("<!-- written by make bench-steady ARGS=--short -->\n", "<!-- so far, short -->\n"),
}
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
    put(page, _BEGIN, _part(found, held, said), _END)


def write_harms(page: Path, form: str, made: Sequence[Harm], said: str) -> None:
    """What laws gave and took on all bodies. Raises: ValueError, where the marks are not there."""
    begin, end = HARMS[form]
    put(page, begin, _harms_part(made, said), end)


def harm_said(harm: Harm) -> str:
    """One law on one body, in figures."""
    plain, law = harm.plain, harm.with_law
    return (
        f"{harm.law} on {harm.body}: variation {plain.over_time:.1%} -> {law.over_time:.1%}, not"
        f" felt {plain.not_felt:.1%} -> {law.not_felt:.1%}, scans above pain"
        f" {plain.scans_above_pain} -> {law.scans_above_pain}"
    )


def put(page: Path, begin: str, part: str, end: str) -> None:
    """Between two marks. Raises: ValueError, where they are not there."""
    text = page.read_text(encoding="utf-8")
    before, has_begin, rest = text.partition(begin)
    _, has_end, after = rest.partition(end)
    if not (has_begin and has_end):
        raise ValueError(f"{page} has lost its marks: {begin!r} and {end!r}")
    page.write_text(before + begin + part + end + after, encoding="utf-8")


def _harms_part(made: Sequence[Harm], said: str) -> str:
    by_both = {(harm.law, harm.body): harm for harm in made}
    plain = {harm.body: harm.plain for harm in made}
    bodies = [body for body in BodyKind if body in plain]
    head = f"| | {' | '.join(bodies)} |\n|---|{'---|' * len(bodies)}\n"
    first = " | ".join(
        f"{plain[body].over_time:.0%}, {plain[body].not_felt:.0%}, {plain[body].scans_above_pain}"
        for body in bodies
    )
    rows = [f"| *no law* | {first} |\n"]
    for law in exclusions(made):
        shown = (_harm_cell(by_both.get((law, body))) for body in bodies)
        rows.append(f"| {law} | {' | '.join(shown)} |\n")
    return f"\n{said[:1].upper()}{said[1:]}:\n\n{head}{''.join(rows)}\n"


def _harm_cell(harm: Harm | None) -> str:
    if harm is None:
        return "-"
    law = harm.with_law
    if law.refused == harm.fingers:
        return "refused"
    text = f"{law.over_time:.0%}, {law.not_felt:.0%}, {law.scans_above_pain}"
    text = f"**{text}**" if harm.is_out else text
    return f"{text} ({law.refused} refused)" if law.refused else text


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
