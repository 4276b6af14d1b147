"""`make bench-steady`: how steady the sensation stays, without and with each stabilizer.

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

from bench import steady_plots  # noqa: E402
from bench.run import Bound, at_least, at_most  # noqa: E402
from bench.steady_figures import SteadyFigures, figures  # noqa: E402
from bench.steady_laws import AHEAD, CALIBRATED, CONTACT, CONTACT_AHEAD, LAWS, NONE  # noqa: E402
from bench.steady_run import ELECTRODES, Kept, run  # noqa: E402
from bench.steady_skin import PIECE_S, RATE_HZ, WIDTH_US  # noqa: E402

#: Fingers that nothing was tuned on, and those that were looked at while this was built.
SEEDS, LOOKED_AT = (301, 302), {*range(1, 21), *range(101, 107), 201, 202}
MINUTES, LEVEL = 10.0, 0.6
#: `--quick`: so many pieces of each finger's minutes.
PIECES = 3
#: In the order of what they cost.
_LONGEST = ("bursts", AHEAD, CONTACT_AHEAD)
PLOTS = Path(__file__).resolve().parents[2] / "docs" / "plots"
#: Of the un-stabilized variation over time; of the steady strength.
MOST_VARIATION, MOST_STEP = 0.5, 1.2


def bounds(found: dict[str, SteadyFigures]) -> list[Bound]:
    """What must hold of the laws that were run."""
    held: list[Bound] = []
    plain, ahead = found.get(NONE), found.get(AHEAD)
    if plain is not None and ahead is not None:
        part = ahead.over_time / plain.over_time
        held += [
            at_most(f"{AHEAD}: variation over time, of that of {NONE}", part, MOST_VARIATION),
            at_least(f"{NONE}: scans of an electrode above pain", plain.scans_above_pain, 1),
            at_most(f"{AHEAD}: the same", ahead.scans_above_pain, 0),
        ]
    for name in (CONTACT, CALIBRATED, CONTACT_AHEAD, AHEAD):
        one = found.get(name)
        if one is not None:
            what = f"{one.name}: felt on touching again, of the steady strength"
            held.append(at_most(what, one.recontact_step, MOST_STEP))
    return held


def measure(names: list[str], seeds: list[int], pieces: int | None) -> dict[str, list[Kept]]:
    """{law: what was kept of each finger}, the longest runs first."""
    jobs = sorted(product(names, seeds), key=lambda job: job[0] not in _LONGEST)
    kept: dict[tuple[str, int], Kept] = {}
    with ProcessPoolExecutor(2) as pool, Progress(console=Console(stderr=True)) as progress:
        futures = {
            pool.submit(run, seed, LAWS[name], LEVEL, MINUTES, pieces): (name, seed)
            for name, seed in jobs
        }
        task = progress.add_task("fingers", total=len(futures))
        for future in as_completed(futures):
            kept[futures[future]] = future.result()
            progress.advance(task)
    return {name: [kept[name, seed] for seed in seeds] for name in names}


def show(console: Console, found: list[SteadyFigures], held: list[Bound], said: str) -> None:
    table = Table(title=f"felt strength, modelled: {said}")
    columns = ("", "felt", "over time", "over electrodes", "not felt", "above pain")
    for column in (*columns, "of them firm", "most pain", "touching again", "(mean)"):
        table.add_column(column, justify="right" if column else "left")
    for one in found:
        table.add_row(
            one.name,
            f"{one.mean_felt:.2f}",
            f"{one.over_time:.1%}",
            f"{one.over_electrodes:.1%}",
            f"{one.below_threshold:.2%}",
            f"{one.above_pain:.3%} ({one.scans_above_pain})",
            str(one.firm_scans_above_pain),
            f"{one.most_pain:.2f}",
            f"{one.recontact_step:.2f}",
            f"{one.recontact_step_mean:.2f}",
        )
    table.caption = (
        "felt: 1 is the threshold; over time, over electrodes: standard deviation over mean, firm"
        " contacts only; not felt, above pain: of the scans of an electrode (how many of them);"
        " touching again: the most felt just after it, over the electrode's steady strength"
    )
    console.print(table)
    for bound in held:
        verdict = "[green]met[/]" if bound.is_met else "[red]NOT MET[/]"
        console.print(f"{verdict}  {bound.what}: {bound.value:g} (bound {bound.bound:g})")


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="bench-steady", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--json", action="store_true", help="one JSON object for all figures")
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{PIECES} pieces of each finger's time, not all of it: a minute, and less sure",
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS), help="the fingers")
    parser.add_argument("--only", nargs="+", choices=LAWS, default=list(LAWS), help="these laws")
    parser.add_argument(
        "--no-plots", action="store_true", help="leave docs/plots as it is, as parts do"
    )
    args = parser.parse_args()
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
        told = [asdict(one) for one in found.values()]
        plain = {"conditions": said, "seeds": args.seeds, "laws": told}
        print(json.dumps(plain | {"bounds": [asdict(one) for one in held]}))
    else:
        show(Console(width=None if sys.stdout.isatty() else 130), list(found.values()), held, said)
    if not (args.no_plots or args.quick) and len(found) == len(LAWS):
        steady_plots.write(PLOTS, {name: runs[0] for name, runs in kept.items()})
    return 0 if all(one.is_met for one in held) else 1


if __name__ == "__main__":
    sys.exit(main())
