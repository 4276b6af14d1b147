"""`make campaign`: every fault that the fake can show, at every operation of an engine.

Owns: what is played, what must hold, and how it is shown. The judge is the body's own account of
charge; what hardware does beyond the model is not in it. Exit status 1 where something does not
hold. Must not know: how a case is played, what a fault does.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
from collections import Counter
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
from campaign.kinds import Kind, kinds_of  # noqa: E402
from campaign.operations import Port  # noqa: E402

#: Beyond the programmed pulse, with the guards in hardware: the one-shot's 250 us at 10 mA.
MOST_UC = 2.5
GUARDED = "reference-hv507"
_BOUNDED_EVERY = 200


def play(
    board: str, every: int, only: Sequence[str], pairs: int, seed: int, folder: Path
) -> list[Outcome]:
    """Play what is not kept yet, of each `every`-th operation of a port, and of ten times as many
    messages. Returns all that is kept.
    """
    path = results.file_of(board, folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    done = {(one.kind, one.operation) for one in results.kept(path)}
    allowed, ports = forked.whole(board)
    kinds = [
        kind
        for kind in kinds_of(scenes.config(board).board)
        if not only or any(text in kind.name for text in only)
    ]
    doubled = _pairs(board, kinds, ports, pairs, seed)

    chosen = _chosen(ports, every)

    def wanted(number: int, port: Port) -> list[Kind]:
        found = [kind for kind in kinds if number in chosen and kind.applies(number, port)]
        return [one for one in (*found, *doubled.get(number, ())) if (one.name, number) not in done]

    console = Console(stderr=True, width=None if sys.stderr.isatty() else 130)
    with Progress(console=console) as progress:
        task = progress.add_task(board, total=len(ports))
        forked.play(
            board, allowed, wanted, path, lambda number: progress.update(task, completed=number + 1)
        )
    return results.kept(path)


def _chosen(ports: Sequence[Port], every: int) -> set[int]:
    """The numbers of the operations that faults come at."""
    counted: Counter[Port] = Counter()
    chosen = set()
    for number, port in enumerate(ports):
        if counted[port] % (max(1, every // 10) if port == "spi" else every) == 0:
            chosen.add(number)
        counted[port] += 1
    return chosen


def _pairs(
    board: str, kinds: Sequence[Kind], ports: Sequence[Port], count: int, seed: int
) -> dict[int, list[Kind]]:
    """So many, drawn: two kinds at two operations, the same with the same seed."""
    drawn: dict[int, list[Kind]] = {}
    dice = random.Random(f"{board} {seed}")
    while kinds and sum(map(len, drawn.values())) < count:
        number, kind, then = dice.randrange(len(ports)), dice.choice(kinds), dice.choice(kinds)
        after = dice.randrange(1, 400)
        if kind.applies(number, ports[number]):
            both = f"{kind.name}, then {then.name} after {after}"
            made = replace(
                kind, fault_class="two at once", variant=both, then=then, then_after=after
            )
            drawn.setdefault(number, []).append(made)
    return drawn


def faults_found(found: Sequence[Outcome]) -> list[str]:
    """What does not hold, as sentences."""
    said = [
        f"{one.board}, operation {one.operation} ({one.port}), {one.kind}: {one.seen}"
        for one in found
        if one.seen.startswith("crashed")
    ]
    for one in found:
        most_uc = max(one.beyond_alone_pc, one.beyond_shared_pc) / results.PC_PER_UC
        if (
            one.board == GUARDED
            and most_uc > MOST_UC
            and one.fault_class not in docs.NEEDS_HARDWARE
        ):
            said.append(
                f"{one.board}, operation {one.operation} ({one.port}), {one.kind}: {most_uc:.1f} uC"
            )
    return said


def _conditions(every: int, pairs: int) -> str:
    """What was run, as the page says it."""
    which = (
        "each operation"
        if every == 1
        else (f"each {every}th operation of a port and each {max(1, every // 10)}th message")
    )
    return f"At {which}, with {pairs} pairs of faults on each board."


def show(console: Console, found: Sequence[Outcome]) -> None:
    for board in dict.fromkeys(one.board for one in found):
        table = Table(title=f"{board}: what each class of faults let through")
        for title in docs.COLUMNS:
            table.add_column(title, justify="left" if title == docs.COLUMNS[0] else "right")
        for figure in results.figures(one for one in found if one.board == board):
            table.add_row(*docs.cells(figure))
        console.print(table)


def main() -> int:
    parser = argparse.ArgumentParser(prog="campaign", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--boards", nargs="+", choices=scenes.BOARDS, default=scenes.BOARDS)
    parser.add_argument(
        "--every",
        type=int,
        default=1,
        help="at each so many-th operation of a port only, and at ten times as many messages",
    )
    parser.add_argument(
        "--bounded", action="store_true", help=f"as CI does it: --every {_BOUNDED_EVERY}"
    )
    parser.add_argument("--only", nargs="+", default=(), help="kinds with these words in them")
    parser.add_argument("--pairs", type=int, default=0, help="so many random pairs on each board")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, default=results.KEPT, help="where results are kept")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--write", action="store_true", help="the table in docs/safety.md")
    args = parser.parse_args()
    if args.write and args.only:
        parser.error("--write with --only: the page would have a part of the kinds")
    every = _BOUNDED_EVERY if args.bounded else args.every
    found = [
        one
        for board in args.boards
        for one in play(board, every, args.only, args.pairs, args.seed, args.folder)
    ]
    console = Console(width=None if sys.stdout.isatty() else 150)
    if args.json:
        print(json.dumps([asdict(figure) for figure in results.figures(found)]))
    else:
        show(console, found)
    if args.write:
        docs.write(found, _conditions(every, args.pairs))
    broken = faults_found(found)
    for sentence in broken[:50]:
        console.print(f"NOT MET  {sentence}", style="red", markup=False)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
