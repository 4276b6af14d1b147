"""`make bench-finger`: how steady the sensation stays on the fake's own finger, law by law.

Feeling follows resistance on it, by choice; `steady_bodies.py` plays bodies that disagree.

Owns: what is run, what must hold, and how it is shown. What is felt is modelled: nobody is
measured. Exit status 1 where something does not hold.
Must not know: how a run is made, how a figure is counted.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from itertools import product
from pathlib import Path

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

from rich.console import Console  # noqa: E402
from rich.progress import Progress  # noqa: E402
from rich.table import Table  # noqa: E402

from bench import steady_docs, steady_plots  # noqa: E402
from bench.run import Bound, at_least, at_most  # noqa: E402
from bench.steady_figures import MOST_STEP, SteadyFigures, figures  # noqa: E402
from bench.steady_laws import (  # noqa: E402
    AHEAD,
    CALIBRATED,
    CONTACT,
    CONTACT_AHEAD,
    FOR_FINGER,
    LAWS,
    NONE,
)
from bench.steady_run import ELECTRODES, Kept, run  # noqa: E402
from bench.steady_skin import PIECE_S, RATE_HZ, WIDTH_US  # noqa: E402

#: Fingers that nothing was tuned on, and those that were looked at while this was built.
SEEDS = (801, 802)
LOOKED_AT = {
    *range(1, 21),
    *range(101, 107),
    201,
    202,
    *range(301, 305),
    *range(401, 407),
    501,
    502,
    601,
    602,
    701,
    702,
}
MINUTES, LEVEL = 10.0, 0.6
#: `--quick`: so many pieces of each finger's minutes.
PIECES = 3
#: What they cost, roughly, where it is not 1: the longest runs begin first.
_COSTS = {AHEAD: 2.2, CONTACT_AHEAD: 2.1, "bursts": 2.0, CALIBRATED: 1.2}
PLOTS = Path(__file__).resolve().parents[2] / "docs" / "plots"
#: Of the un-stabilized variation over time.
MOST_VARIATION = 0.5


def bounds(found: dict[str, SteadyFigures]) -> list[Bound]:
    """What must hold. What there is nothing to judge by is not met."""
    plain, ahead = found.get(NONE), found.get(AHEAD)
    variation = f"{AHEAD}: variation over time, of that of {NONE}"
    pain = f"{AHEAD}: scans of an electrode above pain"
    held: list[Bound] = []
    if plain is None or ahead is None or not plain.over_time:
        held += [_not_judged(variation, MOST_VARIATION), _not_judged(pain, 0)]
    else:
        held += [
            at_most(variation, ahead.over_time / plain.over_time, MOST_VARIATION),
            at_most(pain, ahead.scans_above_pain, 0),
            at_least(f"{NONE}: the same", plain.scans_above_pain, 1),
        ]
    for name in (CONTACT, CALIBRATED, CONTACT_AHEAD, AHEAD):
        what = f"{name}: felt on touching again, of the steady strength"
        step = found[name].recontact_step if name in found else None
        held.append(
            _not_judged(what, MOST_STEP) if step is None else at_most(what, step, MOST_STEP)
        )
    return held


def _not_judged(what: str, bound: float) -> Bound:
    return Bound(f"{what}: not judged, there is nothing to judge by", 0.0, bound, is_met=False)


def measure(names: list[str], seeds: list[int], pieces: int | None) -> dict[str, list[Kept]]:
    """{law: what was kept of each finger}, the longest runs first, each told as it ends."""
    jobs = sorted(product(names, seeds), key=lambda job: -_COSTS.get(job[0], 1.0))
    kept: dict[tuple[str, int], Kept] = {}
    console = Console(stderr=True, width=None if sys.stderr.isatty() else 130)
    with ProcessPoolExecutor(2) as pool, Progress(console=console) as progress:
        futures = {
            pool.submit(run, seed, LAWS[name], LEVEL, MINUTES, pieces): (name, seed)
            for name, seed in jobs
        }
        task = progress.add_task("fingers", total=len(futures))
        for future in as_completed(futures):
            name, seed = futures[future]
            kept[name, seed] = future.result()
            told = steady_docs.cells(figures(name, [kept[name, seed]]))
            console.log(f"{name}, finger {seed}: {' | '.join(told)}")
            progress.advance(task)
    return {name: [kept[name, seed] for seed in seeds] for name in names}


def show(console: Console, found: list[SteadyFigures], held: list[Bound], said: str) -> None:
    table = Table(title=f"felt strength, modelled: {said}")
    for column in ("", *steady_docs.COLUMNS):
        table.add_column(column, justify="right" if column else "left")
    for steady_figures in found:
        table.add_row(steady_figures.name, *steady_docs.cells(steady_figures))
    table.caption = (
        "felt: 1 is the threshold; over time, over electrodes: standard deviation over mean, firm"
        " contacts only; not felt, above pain: of the scans of an electrode (how many of them);"
        " touching again: the most felt in three seconds after it, over the electrode's steady"
        " strength; within 7 s: how many are above 1.2 by then"
    )
    console.print(table)
    for bound in held:
        verdict = "[green]met[/]" if bound.is_met else "[red]NOT MET[/]"
        console.print(f"{verdict}  {bound.what}: {bound.value:g} (bound {bound.bound:g})")


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="bench-finger", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--json", action="store_true", help="one JSON object for all figures")
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{PIECES} pieces of each finger's time, not all of it: a minute, and less sure",
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="the fingers")
    parser.add_argument(
        "--only", nargs="+", choices=FOR_FINGER, default=list(FOR_FINGER), help="these laws"
    )
    parser.add_argument(
        "--write-docs",
        action="store_true",
        help="write table, bounds and plots into docs; of all laws and all minutes only",
    )
    args = parser.parse_args()
    if args.write_docs and (args.quick or set(args.only) != set(FOR_FINGER)):
        parser.error("--write-docs is for the whole run: without --quick and --only")
    if set(args.seeds) & LOOKED_AT:
        parser.error(f"these are seeds of fingers that were looked at: {sorted(LOOKED_AT)}")
    kept = measure(args.only, args.seeds, PIECES if args.quick else None)
    found = {name: figures(name, runs) for name, runs in kept.items()}
    held = bounds(found)
    looked_at = f"{PIECES} pieces of {PIECE_S:g} s of" if args.quick else "all of"
    said = (
        f"{ELECTRODES} electrodes, level {LEVEL:g}, {WIDTH_US} us, {RATE_HZ:g} Hz; fingers of"
        f" seeds {args.seeds}; {looked_at} each one's {MINUTES:g} min"
    )
    if args.json:
        told = [asdict(steady_figures) for steady_figures in found.values()]
        plain = {"conditions": said, "seeds": args.seeds, "laws": told}
        print(json.dumps(plain | {"bounds": [asdict(bound) for bound in held]}))
    else:
        show(Console(width=None if sys.stdout.isatty() else 130), list(found.values()), held, said)
    if args.write_docs:
        steady_docs.write(steady_docs.PAGE, list(found.values()), held, said)
        steady_plots.write(PLOTS, {name: runs[0] for name, runs in kept.items()})
    return 0 if all(bound.is_met for bound in held) else 1


if __name__ == "__main__":
    sys.exit(main())
