"""`make bench-felt`: what it gives and takes that a person says of the strength, on every body.

Owns: which fingers and persons are played, and how it is shown. What is felt is modelled: nobody is
measured. Exit status 1 where a bound is not met. Must not know: how answers are heeded, which bound
a body has, and why.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import get_args

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

import msgspec  # noqa: E402
from rich.console import Console  # noqa: E402

from bench import (  # noqa: E402
    felt_docs,
    felt_harm,
    felt_laws,
    felt_limits,
    felt_manners,
    fresh_seeds,
)
from bench.felt_compared import (  # noqa: E402
    PERSONS,
    SHIPS_PERSONS,
    Compared,
    again_where_common,
    bounds,
    compared,
)
from bench.felt_person import Manner  # noqa: E402
from bench.felt_play import MINUTES  # noqa: E402
from bench.run import Bound  # noqa: E402
from bench.steady_docs import PAGE  # noqa: E402
from bench.steady_laws import LAWS  # noqa: E402
from etd.stabilize.offset_estimate import Answer  # noqa: E402
from etd_body.kinds import BodyKind  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(prog="bench-felt", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(fresh_seeds.FELT))
    parser.add_argument(
        "--common-seeds",
        type=int,
        nargs="*",
        default=list(fresh_seeds.FELT_COMMON),
        help="fingers, with a person each, that a body is judged on whose drift is common to all"
        " electrodes; none: on --seeds as the others",
    )
    parser.add_argument(
        "--persons", type=int, default=PERSONS, help="of each finger, where answers may raise"
    )
    parser.add_argument(
        "--ships-persons", type=int, default=SHIPS_PERSONS, help="of each finger, as it ships"
    )
    parser.add_argument(
        "--ships", action="store_true", help="only as it ships: in a third of the time"
    )
    parser.add_argument("--bodies", type=BodyKind, nargs="+", default=list(BodyKind))
    parser.add_argument("--right", type=float, default=Manner.right, help="answers, of all")
    parser.add_argument("--band", type=float, default=Manner.band, help="what is called good")
    parser.add_argument("--errs", choices=get_args(Answer), help="what they say where they err")
    parser.add_argument("--insists", action="store_true", help="says too strong again soon")
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument(
        "--law",
        choices=list(LAWS),
        help="answers together with this law, through the engine: some minutes for each body and"
        " finger, one person each; status 1 where the law does harm and is not given up",
    )
    parser.add_argument(
        "--of-each",
        action="store_true",
        help="with --law: they are asked about the next electrode each time, not about all",
    )
    parser.add_argument(
        "--limits",
        action="store_true",
        help="on --common-seeds: what the limits on raising leave to any rule, by a rise at once"
        " whatever is said",
    )
    parser.add_argument(
        "--manners",
        action="store_true",
        help="as it ships, persons that the estimate was not made for: told, and not judged",
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="one JSON object for all figures")
    parser.add_argument(
        "--write-docs", action="store_true", help="write what was found into docs/stabilization.md"
    )
    args = parser.parse_args()
    manner = Manner(args.right, args.band, args.errs, args.insists)
    if args.limits:
        for body in args.bodies:
            _show(felt_limits.limit(body, args.common_seeds, manner, args.processes), args.json)
        return 0
    if args.manners:
        _show_manners(args)
        return 0
    if args.law is not None:
        with ProcessPoolExecutor(args.processes) as pool:
            running = [
                pool.submit(
                    felt_laws.with_law,
                    *(body, args.law, seed, manner, args.minutes),
                    of_each=args.of_each,
                )
                for body in args.bodies
                for seed in args.seeds
            ]
            played = [_shown(each.result(), args.json) for each in running]
        return 0 if all(each.is_held for each in played) else 1
    fingers = f"fingers {', '.join(map(str, args.seeds))}"
    persons = 0 if args.ships else args.persons
    said = f"{fingers}, {args.minutes:g} min"
    found = compared(
        *(args.bodies, args.seeds, manner, args.minutes, persons, args.processes),
        ships_persons=args.ships_persons,
    )
    if args.common_seeds and not args.ships and any(each.drift.is_common for each in found):
        many = (args.common_seeds, manner, args.minutes, args.processes)
        found = again_where_common(found, *many)
        said = f"{said}; where the drift is common to all, {_in_short(args.common_seeds)}"
        said = f"{said}, one person each"
    ships = [each for each in found if not each.may_raise]
    raising = [each for each in found if each.may_raise]
    checked = asked(found)
    excluded = felt_harm.excluded(found)
    not_met = [bound for bound in checked if not bound.is_met]
    if args.json:
        plain = {"bodies": [asdict(each) for each in found], "excluded": excluded}
        print(msgspec.json.encode(plain | {"bounds": [asdict(each) for each in checked]}).decode())
    else:
        console = Console(width=None if sys.stdout.isatty() else 170)
        console.print(felt_docs.table(ships, f"with answers, modelled, as it ships: {said}"))
        if raising:
            console.print(felt_docs.table(raising, f"where answers may raise: {said}"))
        for line in excluded:
            console.print(line)
        for bound in not_met:
            console.print(f"[red]NOT MET[/]  {bound.what}: {bound.value:g} (bound {bound.bound:g})")
    if args.write_docs:
        felt_docs.write(PAGE, ships, said, not_met)
        if raising:
            felt_docs.write(PAGE, raising, said, not_met)
    return 1 if not_met else 0


def _in_short(seeds: Sequence[int]) -> str:
    """Which fingers."""
    if list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"fingers {seeds[0]} to {seeds[-1]}"
    return f"fingers {', '.join(map(str, seeds))}"


def _show_manners(args: argparse.Namespace) -> None:
    others = felt_manners.played(args.bodies, args.seeds, args.minutes, args.processes)
    if args.json:
        print(msgspec.json.encode(others).decode())
    else:
        print(felt_manners.table(others))
    if args.write_docs:
        said = f"{_in_short(args.seeds)}, {felt_manners.PERSONS} persons each"
        felt_manners.write(PAGE, others, f"{said}, {args.minutes:g} min")


def _show(found: felt_limits.Limit, as_json: bool) -> None:
    if as_json:
        print(msgspec.json.encode(found).decode(), flush=True)
        return
    print(
        f"{found.body} (modelled): a rise at once leaves {found.variation_times:.3f} times the"
        f" variation, standard error {found.standard_error:.3f}, {found.fingers} fingers",
        flush=True,
    )


def asked(found: Sequence[Compared]) -> list[Bound]:
    """What must hold, as it ships and where answers may raise: variation on every body, and what
    is not felt; pain on every body but for those that are excluded where answers may raise.
    """
    return felt_harm.bounds(found) + bounds(found)


def _shown(each: felt_laws.WithLaw, as_json: bool) -> felt_laws.WithLaw:
    """As it comes: each takes minutes."""
    if as_json:
        print(msgspec.json.encode(each).decode(), flush=True)
        return each
    print(f"{each.body}, {each.law}, finger {each.seed} (modelled): {each.verdict}")
    for name, one in (("nothing", each.plain), ("the law", each.alone), ("answers", each.said)):
        print(
            f"  {name}: {one.over_time:.1%}, not felt {one.below_threshold:.1%},"
            f" {one.scans_above_pain} scans above pain",
            flush=True,
        )
    return each


if __name__ == "__main__":
    sys.exit(main())
