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
import sys
from collections.abc import Sequence
from pathlib import Path

# Run as a script, from a clone: the campaign and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]
# Each case is a process that computes alone.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import msgspec  # noqa: E402
from rich.console import Console  # noqa: E402
from rich.progress import Progress  # noqa: E402
from rich.table import Table  # noqa: E402

from campaign import choice, docs, forked, record, results, scenes  # noqa: E402
from campaign.case import Outcome  # noqa: E402
from campaign.judge import PAIR, bounds, lines_not_met, not_met  # noqa: E402
from campaign.kind import Kind  # noqa: E402
from campaign.operations import Port  # noqa: E402
from campaign.places import chosen  # noqa: E402
from campaign.record import Line  # noqa: E402
from campaign.results import BENCH  # noqa: E402

_BOUNDED_PART = 300
_EACH = 3
#: Of the whole; of a part as much less.
_PAIRS = 100
#: Each so many-th case of a scene whose cases take long: two hours are for all scenes.
_PART_OF_LONG = 4


def play(
    board: str,
    scene: str,
    args: argparse.Namespace,
    progress: Progress,
) -> list[Outcome]:
    """Play what is not kept yet. Returns all that is kept."""
    path = results.file_of(board, scene, args.folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = results.kept(path)
    done = {(one.kind, one.operation) for one in kept}
    whole = forked.whole(board, scene)
    every = choice.kinds_in(board, scene)
    kinds = [kind for kind in every if choice.is_asked_for(kind.name, args.only)]
    at = chosen(
        whole.operations,
        None if args.all else args.each,
        had=forked.places_of(board, scenes.BEGUN_AS.get(scene, ())),
        is_long=scene in choice.LONG,
    )
    doubled = choice.pairs(
        f"{board} {scene}", kinds, every, whole.operations, count=args.pairs, seed=args.seed
    )
    part = args.part * (1 if args.all or scene not in choice.LONG else _PART_OF_LONG)
    missing = choice.classes_first_at(board, scene) if part > 1 else set[str]()

    def wanted(number: int, port: Port) -> list[Kind]:
        found = choice.due_at(kinds, number, port, at)
        found = choice.one_of_each_class(found, number) if scene in choice.LONG else found
        found = [
            one for one in found if choice.is_in(one, number, part) or choice.takes(missing, one)
        ]
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


def _conditions(args: argparse.Namespace) -> str:
    """What was run, as the page says it."""
    where = "each operation" if args.all else f"{args.each} operations of each place of the code"
    is_thinned = BENCH in args.scenes and not args.all
    where += f" (in a self-test each {_PART_OF_LONG}th case at one)" if is_thinned else ""
    part = "" if args.part == 1 else f", each {args.part}th case of these"
    pairs = f", with {args.pairs} pairs of faults in each scene on each board" if args.pairs else ""
    return f"At {where}{part}{pairs}"


def _as_json(lines: Sequence[Line]) -> dict[str, object]:
    """What each table of the page has, all of it in one row, and by class; and who played it."""
    return {
        "played": record.played(lines),
        "in_all": record.in_all(lines),
        "by_class": [msgspec.to_builtins(line) for line in lines],
    }


def _why_not_to_write(args: argparse.Namespace) -> str:
    """Of a part of the campaign: the record has whole classes. Nothing where it may be written."""
    if args.recorded:
        return ""
    if results.version().endswith("-dirty"):
        return "--write with changes that are not committed: the record names the version"
    if args.part != 1 or not _is_whole(args):
        return (
            "--write with a part of the cases: the record has whole classes, of all scenes with a"
            f" person, or of the {BENCH}, on all boards"
        )
    if args.only and args.pairs:
        return "--write with --only: add --pairs 0, since the record has pairs of all kinds"
    if args.only and (name := choice.part_of_a_class(args.only)):
        return f"--write with --only: it leaves out a part of the class {name!r}"
    return ""


def _is_whole(args: argparse.Namespace) -> bool:
    """The bench of a self-test has lines of its own."""
    every, asked_for = set(scenes.SCENES), set(args.scenes)
    return asked_for in (every, every - {BENCH}, {BENCH}) and args.boards == scenes.BOARDS


def show(console: Console, lines: Sequence[Line]) -> None:
    for title, rows in docs.tables(lines):
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
    parser.add_argument("--kept", action="store_true", help="play nothing: what has been played")
    parser.add_argument(
        "--recorded", action="store_true", help="play nothing: show what is recorded in the clone"
    )
    parser.add_argument("--json", action="store_true")
    parser.add_argument(
        "--write", action="store_true", help="into the record, and the table in docs/safety.md"
    )
    args = parser.parse_args()
    args.part = _BOUNDED_PART if args.bounded else args.part
    args.pairs = _PAIRS // args.part if args.pairs is None else args.pairs
    if args.write and (why := _why_not_to_write(args)):
        parser.error(why)
    errors = Console(stderr=True, width=None if sys.stderr.isatty() else 130)
    if args.recorded:
        lines = record.recorded()
        broken = lines_not_met(lines, bounds())
    else:
        found = _all_played(args, errors)
        lines = record.lines_of(found, _conditions(args))
        broken = not_met(found, bounds())
    if args.write and broken:
        errors.print("Not written: the record and the page have what holds (--kept: again)")
    elif args.write:
        # A run of all takes the place of everything; of some classes or scenes, of these.
        is_part = args.only or set(args.scenes) != set(scenes.SCENES)
        kept = record.recorded() if is_part else []
        written = lines if args.recorded else record.merged(kept, lines)
        record.record(written)
        docs.write(written)
    console = Console(width=None if sys.stdout.isatty() else 150)
    if args.json:
        print(json.dumps(_as_json(lines)))
    else:
        show(console, lines)
    for sentence in broken[:50]:
        (errors if args.json else console).print(f"NOT MET  {sentence}", style="red", markup=False)
    return 1 if broken else 0


def _all_played(args: argparse.Namespace, errors: Console) -> list[Outcome]:
    found: list[Outcome] = []
    # Of what is loaded: the clone may be edited while it plays.
    results.version()
    with Progress(console=errors, disable=not sys.stderr.isatty()) as progress:
        for scene, board in itertools.product(args.scenes, args.boards):
            path = results.file_of(board, scene, args.folder)
            found += results.kept(path) if args.kept else play(board, scene, args, progress)
    return [one for one in found if _is_asked_for(one, args)]


def _is_asked_for(one: Outcome, args: argparse.Namespace) -> bool:
    """What is kept may be of another call, with other words or with pairs."""
    is_wanted = bool(args.pairs) or one.fault_class != PAIR
    return is_wanted and choice.is_asked_for(one.kind, args.only)


if __name__ == "__main__":
    sys.exit(main())
