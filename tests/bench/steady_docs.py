"""What a run of the benchmark says in the docs: its table, its conditions, what was met.

Owns: the parts of docs/stabilization.md between two marks, which nobody writes by hand; the
sentences that it opens with are `steady_opening.py`'s.
Must not know: how a run is made, how a figure is counted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.run import Bound
from bench.steady_exclusions import Excluded
from bench.steady_figures import SteadyFigures
from bench.steady_harm import Harm, OfFinger, exclusions
from etd_body.kinds import BodyKind

PAGE = Path(__file__).resolve().parents[2] / "docs" / "stabilization.md"
_BEGIN, _END = "<!-- written by make bench-finger -->\n", "<!-- so far -->\n"
#: Of the benchmark of all bodies, by the name of the form that was played.
HARMS = {
    "full": ("<!-- written by make bench-steady -->\n", "<!-- so far, full -->\n"),
    "short": ("<!-- written by make bench-steady ARGS=--short -->\n", "<!-- so far, short -->\n"),
    "unbroken": (
        *("<!-- written by make bench-steady ARGS=--unbroken -->\n", "<!-- so far, unbroken -->\n"),
    ),
}
#: The documented ones.
EXCLUSIONS = ("<!-- written from steady_exclusions.toml -->\n", "<!-- so far, excluded -->\n")
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


def write_harms(
    page: Path, form: str, made: Sequence[Harm], said: str, fingers: Sequence[OfFinger] = ()
) -> None:
    """What laws gave and took on all bodies, and on the worst `fingers` where there are several.
    Raises: ValueError, where the marks are not there.
    """
    begin, end = HARMS[form]
    put(page, begin, _harms_part(made, said) + _fingers_part(fingers), end)


def write_exclusions(page: Path, known: Mapping[str, Excluded]) -> None:
    """The documented ones, as a table. Raises: ValueError, where the marks are not there."""
    head = (
        "| law | out of bounds with 64 electrodes on | with 8 (short form) on"
        f" | with 64, unbroken, on | why |\n|{'---|' * 5}\n"
    )
    rows = (
        f"| `{law.removesuffix(', own k')}`{excluded.by and f', {excluded.by}'}"
        f" | {_listed(excluded.full)} | {_listed(excluded.short)} | {_listed(excluded.unbroken)}"
        f" | {excluded.why} |\n"
        for law, excluded in known.items()
    )
    put(page, EXCLUSIONS[0], f"\n{head}{''.join(rows)}\n", EXCLUSIONS[1])


def _listed(bodies: Sequence[BodyKind] | None) -> str:
    if bodies is None:
        return "not played"
    others = [body for body in BodyKind if body not in bodies]
    if len(others) < len(BodyKind) // 2:
        return f"all but {', '.join(f'`{body}`' for body in others)}" if others else "all"
    return ", ".join(f"`{body}`" for body in bodies) or "none"


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
    before, _, after = _parted(page.read_text(encoding="utf-8"), begin, end, str(page))
    page.write_text(before + begin + part + end + after, encoding="utf-8")


def between(text: str, begin: str, end: str) -> str:
    """What stands between two marks. Raises: ValueError, where they are not there."""
    return _parted(text, begin, end, "the page")[1]


def _parted(text: str, begin: str, end: str, name: str) -> tuple[str, str, str]:
    before, has_begin, rest = text.partition(begin)
    part, has_end, after = rest.partition(end)
    if not (has_begin and has_end):
        raise ValueError(f"{name} has lost its marks: {begin!r} and {end!r}")
    return before, part, after


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


def _fingers_part(fingers: Sequence[OfFinger]) -> str:
    if not fingers:
        return ""
    lines = [
        f"- {one.harm.law}: {times_said(one.harm)} on `{one.harm.body}`, finger {one.seed}\n"
        for one in fingers
    ]
    return (
        "The worst single finger of each law, by the largest of three, each in times of no law's:"
        f" variation, not felt, scans\nabove pain.\n\n{''.join(lines)}\n"
    )


def times_said(harm: Harm) -> str:
    """Of no law's; where there is nothing without a law, and something with it, `inf`."""
    times = (harm.variation_times, harm.not_felt_times, harm.pain_times)
    return ", ".join(f"{value:.2f}" for value in times)


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
