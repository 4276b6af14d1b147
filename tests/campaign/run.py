"""`make campaign`: every fault that the fake can show, at every operation of an engine.

Owns: what is played, what must hold, and how it is shown. The judge is the body's own account of
charge; what hardware does beyond the model is not in it. Exit status 1 where something does not
hold. Must not know: how a case is played, what a fault does.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import random
import sys
import zlib
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

# Run as a script, from a clone: the campaign and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]
# Each case is a process that computes alone.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from rich.console import Console  # noqa: E402
from rich.progress import Progress  # noqa: E402
from rich.table import Table  # noqa: E402

from campaign import docs, forked, results, scenes  # noqa: E402
from campaign.case import Outcome  # noqa: E402
from campaign.judge import BENCH, PAIR, bounds, not_met, where_of  # noqa: E402
from campaign.kind import Kind  # noqa: E402
from campaign.kinds import kinds_of  # noqa: E402
from campaign.operations import Port  # noqa: E402
from campaign.places import Chosen, Operation, chosen  # noqa: E402

#: Whose cases take long, and which have no link that a gateway could hang at.
_LONG, _UNLINKED = ("self-test",), ("self-test", "power-up")
_BOUNDED_PART = 250
_EACH = 3
#: Of the whole; of a part as much less.
_PAIRS = 100


def play(
    board: str,
    scene: str,
    args: argparse.Namespace,
    progress: Progress,
) -> list[Outcome]:
    """Play what is not kept yet. Returns all that is kept and was asked for."""
    path = results.file_of(board, scene, args.folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = results.kept(path)
    done = {(one.kind, one.operation) for one in kept}
    whole = forked.whole(board, scene)
    kinds = [
        kind
        for kind in kinds_of(
            scenes.config(board).board,
            has_link=scene not in _UNLINKED,
            on_bench=scene == BENCH,
        )
        if not args.only or any(text in kind.name for text in args.only)
    ]
    at = chosen(whole.operations, None if args.all else args.each, is_long=scene in _LONG)
    doubled = _pairs(f"{board} {scene}", kinds, whole.operations, args.pairs, args.seed)

    def wanted(number: int, port: Port) -> list[Kind]:
        found = _at(kinds, number, port, at)
        found = _one_of_each_class(found, number) if scene in _LONG else found
        found = [kind for kind in found if _is_in(kind, number, args.part)]
        found += doubled.get(number, ())
        return [one for one in found if (one.name, number) not in done]

    task = progress.add_task(f"{board}, {scene}", total=len(whole.operations))
    forked.play(
        *(whole, wanted, path, lambda number: progress.update(task, completed=number + 1)),
        at_a_time=args.jobs,
        version=results.version(),
        played_at=results.now(),
    )
    return results.kept(path)


def _at(kinds: Sequence[Kind], number: int, port: Port, at: Chosen) -> list[Kind]:
    if number not in at.once and number not in at.staying:
        return []
    return [kind for kind in kinds if kind.applies(number, port, at)]


def _one_of_each_class(kinds: Sequence[Kind], number: int) -> list[Kind]:
    """Of what happens once, in turn."""
    by_class: dict[str, list[Kind]] = {}
    for kind in kinds:
        if not kind.stays:
            by_class.setdefault(kind.fault_class, []).append(kind)
    turns = [variants[number % len(variants)] for variants in by_class.values()]
    return [*turns, *(kind for kind in kinds if kind.stays)]


def _is_in(kind: Kind, number: int, part: int) -> bool:
    """Every so many-th case, the same each time."""
    return part == 1 or zlib.crc32(f"{kind.name} {number}".encode()) % part == 0


def _pairs(
    scene: str, kinds: Sequence[Kind], operations: Sequence[Operation], count: int, seed: int
) -> dict[int, list[Kind]]:
    """So many, drawn: two kinds at any two operations, the same with the same seed."""
    drawn: dict[int, list[Kind]] = {}
    dice = random.Random(f"{scene} {seed}")
    while kinds and sum(map(len, drawn.values())) < count:
        number, kind, then = dice.randrange(len(operations)), dice.choice(kinds), dice.choice(kinds)
        after = dice.randrange(1, 400)
        if kind.may_come_at(operations[number].port):
            both = f"{kind.name}, then {then.name} after {after}"
            made = replace(kind, fault_class=PAIR, variant=both, then=then, then_after=after)
            drawn.setdefault(number, []).append(made)
    return drawn


def _conditions(args: argparse.Namespace) -> str:
    """What was run, as the page says it."""
    where = "each operation" if args.all else f"{args.each} operations of each place of the code"
    part = "" if args.part == 1 else f", each {args.part}th case of these"
    return f"At {where}{part}, with {args.pairs} pairs of faults in each scene on each board."


def _as_json(found: Sequence[Outcome]) -> dict[str, list[dict[str, object]]]:
    """What each table of the page has, all of it in one row, and by class."""
    those = {
        where: [one for one in found if (where_of(one), one.pulse_pc) == where]
        for where in sorted({(where_of(one), one.pulse_pc) for one in found})
    }

    def row(where: tuple[str, int], figures: results.Figures) -> dict[str, object]:
        return {"on": where[0], "pulse_uc": where[1] / results.PC_PER_UC} | asdict(figures)

    return {
        "in_all": [row(where, results.figures_of("all", ones)) for where, ones in those.items()],
        "by_class": [
            row(where, one) for where, ones in those.items() for one in results.figures(ones)
        ],
    }


def show(console: Console, found: Sequence[Outcome]) -> None:
    for title, rows in docs.tables(found):
        table = Table(title=title)
        for column in docs.COLUMNS:
            table.add_column(column, justify="left" if column in docs.COLUMNS[:2] else "right")
        for row in rows:
            table.add_row(*row)
        console.print(table)


def main() -> int:
    parser = argparse.ArgumentParser(prog="campaign", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--boards", nargs="+", choices=scenes.BOARDS, default=scenes.BOARDS)
    parser.add_argument("--scenes", nargs="+", choices=scenes.SCENES, default=tuple(scenes.SCENES))
    parser.add_argument(
        "--each", type=int, default=_EACH, help="at so many operations of one place of the code"
    )
    parser.add_argument("--all", action="store_true", help="at each operation: days")
    parser.add_argument("--part", type=int, default=1, help="each so many-th case only")
    parser.add_argument(
        "--bounded", action="store_true", help=f"as CI does it: --part {_BOUNDED_PART}"
    )
    parser.add_argument("--only", nargs="+", default=(), help="kinds with these words in them")
    parser.add_argument(
        "--pairs", type=int, help=f"so many random pairs in each scene; of the whole {_PAIRS}"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="so many cases at a time"
    )
    parser.add_argument("--folder", type=Path, default=results.KEPT, help="where results are kept")
    parser.add_argument("--kept", action="store_true", help="play nothing: show what is kept")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--write", action="store_true", help="the table in docs/safety.md")
    args = parser.parse_args()
    if args.write and args.only:
        parser.error("--write with --only: the page would have a part of the kinds")
    args.part = _BOUNDED_PART if args.bounded else args.part
    args.pairs = _PAIRS // args.part if args.pairs is None else args.pairs
    errors = Console(stderr=True, width=None if sys.stderr.isatty() else 130)
    found: list[Outcome] = []
    with Progress(console=errors, disable=not sys.stderr.isatty()) as progress:
        for scene, board in itertools.product(args.scenes, args.boards):
            path = results.file_of(board, scene, args.folder)
            found += results.kept(path) if args.kept else play(board, scene, args, progress)
    console = Console(width=None if sys.stdout.isatty() else 150)
    if args.json:
        print(json.dumps(_as_json(found)))
    else:
        show(console, found)
    if args.write:
        docs.write(found, docs.played(found) if args.kept else _conditions(args))
    broken = not_met(found, bounds())
    for sentence in broken[:50]:
        (errors if args.json else console).print(f"NOT MET  {sentence}", style="red", markup=False)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
