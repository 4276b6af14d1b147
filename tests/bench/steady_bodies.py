"""`make bench-steady`: every law on every body, gain and harm side by side.

Owns: what is played, in which order, and how it is shown. What is felt is modelled: nobody is
measured. Exit status 1 where a law is out of bounds on a body that is not among its documented
exclusions (`steady_exclusions.toml`); where one that ships or is recommended has any, is out on any
body, or was not played; where what was asked for was not all played; and, with 64 electrodes, where
the law by the finger's own k does not halve the variation of the body whose feeling follows
resistance. A run that was cut continues where it stopped.
Must not know: how a run is made, how a figure is counted, what is out of bounds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict
from itertools import product
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import msgspec  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn  # noqa: E402
from rich.table import Table  # noqa: E402

from bench import fresh_seeds, steady_docs, steady_opening  # noqa: E402
from bench.run import Bound  # noqa: E402
from bench.steady_cells import KEPT, Cell, Form  # noqa: E402
from bench.steady_exclusions import (  # noqa: E402
    Excluded,
    back_in,
    documented,
    free_of_exclusions,
    not_excluded,
)
from bench.steady_figures import SteadyFigures  # noqa: E402
from bench.steady_harm import (  # noqa: E402
    BOUND,
    MOST_TIMES,
    Harm,
    OfFinger,
    exclusions,
    halved,
    harms,
    held,
    worst_fingers,
)
from bench.steady_laws import (  # noqa: E402
    CONTACT,
    CONTACT_AHEAD,
    ENERGY_AHEAD,
    FOR_SHORT,
    LAWS,
    NONE,
    OWN,
    OWN_AHEAD,
    SHIPPED,
)
from bench.steady_skin import PIECE_S  # noqa: E402
from etd_body.kinds import BodyKind  # noqa: E402

#: 64 electrodes for all of ten minutes cost minutes of a processor for a law, a body and a finger:
#: many hours in all. Eight pieces of 9.6 s, spread over the ten minutes, take an hour on two cores.
FULL = Form("full", 64, 10.0, 8)
SHORT = Form("short", 8, 10.0, 4)
UNBROKEN = Form("unbroken", 64, 10.0, None)
#: What is played with 64 electrodes, what is nearest to a recommendation first: an hour has no room
#: for what differs little from these.
FULL_LAWS = (
    *(NONE, *SHIPPED, OWN, OWN_AHEAD, "power_law", "energy", CONTACT, CONTACT_AHEAD, ENERGY_AHEAD),
)
#: What ships, and what is nearest to a recommendation.
UNBROKEN_LAWS = (NONE, *SHIPPED, OWN)
LAWS_OF = {FULL: FULL_LAWS, SHORT: FOR_SHORT, UNBROKEN: UNBROKEN_LAWS}
Found = dict[tuple[BodyKind, str, int], SteadyFigures]


def cells(
    form: Form, laws: Sequence[str], bodies: Sequence[BodyKind], seeds: Sequence[int]
) -> list[Cell]:
    """In the order of playing: finger by finger, no law first, since all is judged beside it."""
    of_law = [NONE, *(law for law in laws if law != NONE)]
    return [Cell(form, body, law, seed) for seed, law, body in product(seeds, of_law, bodies)]


def play(wanted: Sequence[Cell], *, processes: int, within_s: float, folder: Path = KEPT) -> Found:
    """All that is kept, and what can be begun within this time: each is told as it ends."""
    console = Console(stderr=True, width=None if sys.stderr.isatty() else 120)
    found = {cell: kept for cell in wanted if (kept := cell.kept(folder)) is not None}
    left = iter([cell for cell in wanted if cell not in found])
    columns = ("[progress.description]{task.description}", BarColumn())
    with (
        ProcessPoolExecutor(processes) as pool,
        Progress(*columns, MofNCompleteColumn(), TimeElapsedColumn(), console=console) as progress,
    ):
        task = progress.add_task("fingers", total=len(wanted), completed=len(found))
        running: dict[Future[SteadyFigures], Cell] = {}
        while True:
            elapsed_s = progress.tasks[task].elapsed or 0.0
            while len(running) < processes and elapsed_s < within_s and (cell := next(left, None)):
                running[pool.submit(cell.played, folder)] = cell
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                cell = running.pop(future)
                found[cell] = future.result()
                told = f"{cell.body}, {cell.law}, finger {cell.seed}: {_said(found[cell])}"
                progress.console.log(told)
                progress.advance(task)
    return {(cell.body, cell.law, cell.seed): figures for cell, figures in found.items()}


def _said(found: SteadyFigures) -> str:
    return (
        "refused: no k of this finger's own may be used"
        if found.is_refused
        else (
            f"variation {found.over_time:.1%}, not felt {found.below_threshold:.1%}, "
            f"above pain {found.scans_above_pain}"
        )
    )


def show(
    console: Console, made: Sequence[Harm], said: str, fingers: Sequence[OfFinger] = ()
) -> None:
    """Laws x bodies, worst first in both directions; then each that is out, worst first; then the
    worst of several fingers, law by law.
    """
    bodies = sorted(
        BodyKind, key=lambda body: -sum(harm.is_out for harm in made if harm.body is body)
    )
    table = Table(title=f"beside no law, modelled: {said}")
    table.add_column("")
    for body in bodies:
        table.add_column(body.value, justify="right", no_wrap=True)
    by_both = {(harm.law, harm.body): harm for harm in made}
    for law in exclusions(made):
        row = (by_both.get((law, body)) for body in bodies)
        table.add_row(law, *(_cell(harm) for harm in row))
    table.caption = (
        "variation over time, part not felt, and scans above pain, in times of no law's (inf: where"
        f" there are none without a law). Out of bounds: above {MOST_TIMES:g}"
    )
    console.print(table)
    for harm in made:
        if harm.is_out:
            console.print(steady_docs.harm_said(harm))
    for one in fingers:
        of = f"{one.harm.law}, worst finger: {one.seed} on {one.harm.body}"
        console.print(f"{of}, {steady_docs.times_said(one.harm)} times no law's")


def _cell(harm: Harm | None) -> str:
    if harm is None:
        return "-"
    if harm.with_law.refused == harm.fingers:
        return "refused"
    text = f"{harm.variation_times:.2f} {harm.not_felt_times:.2f} {harm.pain_times:.2f}"
    return f"[red]{text}[/]" if harm.is_out else text


def conditions(form: Form, seeds: Sequence[int], ran: int, wanted: int) -> str:
    """What was played, in words."""
    pieces = "all" if form.pieces is None else f"{form.pieces} pieces of {PIECE_S:g} s"
    fingers = ", ".join(map(str, seeds))
    return (
        f"{form.electrodes} electrodes, fingers {fingers}, {pieces} of each one's"
        f" {form.minutes:g} min, {ran} of {wanted} runs"
    )


def judged(
    form: str, made: Sequence[Harm], known: Mapping[str, Excluded], left: int
) -> list[Bound]:
    """What must hold of any run. `left`: of the runs that were asked for, those not played."""
    all_played = Bound("runs that were not played", left, 0.0, is_met=not left)
    harmless = [*not_excluded(made, form, known), *free_of_exclusions(known), *held(made)]
    return [all_played, *harmless]


def verdict(console: Console, bounds: Sequence[Bound]) -> bool:
    """Whether all of what must hold does; each is told."""
    for bound in bounds:
        met = "[green]met[/]" if bound.is_met else "[red]NOT MET[/]"
        console.print(f"{met}  {bound.what}: {bound.value:g} (bound {bound.bound:g})")
    is_held = all(bound.is_met for bound in bounds)
    if not BOUND:
        console.print("No law ships switched on, and none is recommended.")
    if is_held:
        console.print("No law is out of bounds on a body that is not among its exclusions.")
    return is_held


def write_docs(
    page: Path,
    readme: Path,
    form: str,
    made: Sequence[Harm],
    said: str,
    fingers: Sequence[OfFinger],
    known: Mapping[str, Excluded],
) -> None:
    """The form's table, the exclusions, and what both files open with. Raises: ValueError."""
    steady_docs.write_harms(page, form, made, said, fingers)
    steady_docs.write_exclusions(page, known)
    steady_opening.write(page, readme)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="bench-steady", description=(__doc__ or "").split("\n")[0]
    )
    how_much = parser.add_mutually_exclusive_group()
    how_much.add_argument("--short", action="store_true", help="8 electrodes, four pieces: minutes")
    how_much.add_argument(
        "--unbroken",
        action="store_true",
        help="all of the ten minutes, no law and the law by the finger's own k",
    )
    parser.add_argument("--seeds", type=int, nargs="+", help="the fingers")
    parser.add_argument("--only", nargs="+", choices=LAWS)
    parser.add_argument("--bodies", type=BodyKind, nargs="+", default=list(BodyKind))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument(
        "--within", type=float, default=600.0, help="minutes after which no run begins; 0: show"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object for all figures")
    parser.add_argument(
        "--write-docs",
        action="store_true",
        help="write what was found, of all laws and bodies, into page and README",
    )
    args = parser.parse_args()
    form = SHORT if args.short else UNBROKEN if args.unbroken else FULL
    seeds = args.seeds or list(fresh_seeds.TESTED if args.short else fresh_seeds.STEADY)
    all_laws = LAWS_OF[form]
    only = args.only or list(all_laws)
    if args.write_docs and (set(all_laws) - set(only) or set(BodyKind) - set(args.bodies)):
        parser.error("--write-docs is for all laws of the form on all bodies")
    laws = [*only, *(law for law in BOUND if law not in only)]
    known = documented()
    wanted = cells(form, laws, args.bodies, seeds)
    found = play(wanted, processes=args.processes, within_s=args.within * 60.0)
    made = harms(found)
    played = sorted({seed for _, _, seed in found})
    said = conditions(form, played, len(found), len(wanted))
    fingers = worst_fingers(found) if len(played) > 1 else []
    bounds = judged(form.name, made, known, len(set(wanted)) - len(found))
    if form is not SHORT and not args.only:
        bounds.append(halved(made))
    console = Console(width=None if sys.stdout.isatty() else 210)
    if args.json:
        plain = {
            "conditions": said,
            "harms": [asdict(harm) for harm in made],
            "worst_fingers": [asdict(one) for one in fingers],
            "bounds": [asdict(bound) for bound in bounds],
            "excluded_and_within_bounds": back_in(made, form.name, known),
        }
        print(msgspec.json.encode(plain).decode())
    else:
        show(console, made, said, fingers)
        for told in back_in(made, form.name, known):
            console.print(told)
    if args.write_docs:
        write_docs(steady_docs.PAGE, steady_opening.README, form.name, made, said, fingers, known)
    is_held = verdict(Console(stderr=True) if args.json else console, bounds)
    return 0 if is_held else 1


if __name__ == "__main__":
    sys.exit(main())
