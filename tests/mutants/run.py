"""`make mutants`: one mistake after another in what bounds current, and a test must see each.

Owns: which modules are judged, and what is shown. Exit status 1: a mistake that no test has found
and nothing explains, an explanation of none, or a branch that no test takes; 2: the tests cannot
judge. Must not know: how a mistake is made or tried.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

# Run as a script, from a clone: the packages beside the tests' own rigs.
sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from mutants import session  # noqa: E402
from mutants.account import Account  # noqa: E402
from mutants.judging import Baseline, Judged, Outcome, Unfit  # noqa: E402
from mutants.mistakes import Mutant  # noqa: E402

#: What the table needs: a log has no width.
_TABLE_WIDTH = 110
_TREE = Path(__file__).resolve().parents[2]


@dataclass
class Verdict:
    """Of one module."""

    module: str
    tests: int = 0
    mutants: int = 0
    #: How many ended in which way.
    how: dict[str, int] = field(default_factory=dict)
    unexplained: list[str] = field(default_factory=list)
    needless: list[str] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)
    #: Whether its mistakes were judged, not its branches alone.
    is_whole: bool = True
    unfit: str | None = None
    processor_s: float = 0.0

    @property
    def is_clean(self) -> bool:
        return not (self.unexplained or self.needless or self.gaps or self.unfit)


class Run:
    """Over some modules; what is found is kept at once."""

    def __init__(self, account: Account, tree: Path, log: Path, console: Console) -> None:
        self._account = account
        self._tree = tree
        self._log = log
        self._console = console

    def module(self, name: str, only: str = "") -> Verdict:
        """All of its mistakes, but those that were tried before over the same sources. `only`:
        those that have this in their names, from which nothing follows for the module.
        """
        judged = Judged(self._tree, name, self._account.modules[name], self._log)
        mutants = [one for one in judged.mutants if only in one.name]
        verdict = Verdict(name, mutants=len(mutants))
        begun_s = _processor_s()
        try:
            outcomes = self._tried(name, judged, mutants, verdict)
        except Unfit as error:
            verdict.unfit = str(error)
            return verdict
        finally:
            verdict.processor_s = round(_processor_s() - begun_s, 1)
        survived = {one.name for one in outcomes if one.has_survived}
        explained = self._account.explained(name)
        verdict.how = dict(Counter(one.how for one in outcomes))
        verdict.unexplained = [
            one.name for one in mutants if one.name in survived and one.name not in explained
        ]
        verdict.needless = [one for one in explained if only in one and one not in survived]
        if not only:
            self._account.note(name, is_clean=verdict.is_clean)
        return verdict

    def branches(self, name: str) -> Verdict:
        """Without a mistake: which branches no test takes."""
        judged = Judged(self._tree, name, self._account.modules[name], self._log)
        verdict = Verdict(name, is_whole=False)
        begun_s = _processor_s()
        try:
            self._measured(name, judged, verdict)
        except Unfit as error:
            verdict.unfit = str(error)
        verdict.processor_s = round(_processor_s() - begun_s, 1)
        return verdict

    def _tried(
        self, name: str, judged: Judged, mutants: Sequence[Mutant], verdict: Verdict
    ) -> list[Outcome]:
        baseline, kept = self._measured(name, judged, verdict)
        names = {one.name for one in mutants}
        outcomes = [one for one in kept if one.name in names]
        known = {one.name for one in outcomes}
        left = [one for one in mutants if one.name not in known]
        # Drawn where nothing else writes, and by no thread: threads do not outlive a fork.
        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
        is_shown = self._console.is_terminal
        with Progress(
            *columns,
            TextColumn("{task.fields[left]} unseen"),
            TimeElapsedColumn(),
            console=self._console,
            auto_refresh=False,
            transient=True,
            disable=not is_shown,
        ) as progress:
            unseen = sum(one.has_survived for one in outcomes)
            task = progress.add_task(name, total=len(mutants), completed=len(known), left=0)
            for outcome in judged.outcomes(baseline, left):
                self._account.keep(name, outcome)
                outcomes.append(outcome)
                unseen += outcome.has_survived
                progress.update(task, advance=1, left=unseen, refresh=True)
        return outcomes

    def _measured(
        self, name: str, judged: Judged, verdict: Verdict
    ) -> tuple[Baseline, list[Outcome]]:
        baseline, outcomes = self._account.kept(name)
        if baseline is None:
            baseline = judged.baseline()
            self._account.keep_baseline(name, baseline)
        verdict.tests, verdict.gaps = len(baseline.taken_s), baseline.gaps
        return baseline, outcomes


def _processor_s() -> float:
    """Of this process and of those that it has waited for."""
    return sum(os.times()[:4])


def chosen(account: Account, wanted: Sequence[str]) -> list[str]:
    """Of the modules, those whose path ends like this. Raises: ValueError."""
    found = []
    for one in wanted:
        ending = one if one.endswith(".py") else f"{one.replace('.', '/')}.py"
        matching = [name for name in account.modules if f"/{name}".endswith(f"/{ending}")]
        if not matching:
            raise ValueError(f"no module of modules.toml is {one!r}: {', '.join(account.modules)}")
        found += matching
    return found or list(account.modules)


def show(console: Console, verdict: Verdict) -> None:
    """What is wrong, to be read and to be copied into survivors.toml."""
    name = verdict.module
    if verdict.unfit is not None:
        console.print(f"{name}: {verdict.unfit}", markup=False, soft_wrap=True)
    if verdict.unexplained:
        lines = [f"{json.dumps(one, ensure_ascii=False)} = ''" for one in verdict.unexplained]
        told = "\n".join(["No test finds, and nothing explains:", f'["{name}"]', *lines])
        console.print(told, markup=False, highlight=False, soft_wrap=True)
    for one in verdict.needless:
        console.print(f"{name}: explained, but found or gone: {one}", markup=False, soft_wrap=True)
    for one in verdict.gaps:
        console.print(f"{name}: no test takes {one}", markup=False, highlight=False)


def table(verdicts: Sequence[Verdict]) -> Table:
    shown = Table(
        Column("module", no_wrap=True),
        *("tests", "mutants", "found", "explained", "unseen", "branches", "s"),
    )
    for one in verdicts:
        survived = sum(one.how.get(how, 0) for how in ("survived", "not reached"))
        unseen = len(one.unexplained)
        figures = (one.mutants, sum(one.how.values()) - survived, survived - unseen, unseen)
        of_mutants = [str(figure) for figure in figures] if one.is_whole else ["-"] * 4
        branches = "all" if not one.gaps else f"{len(one.gaps)} not"
        shown.add_row(one.module, str(one.tests), *of_mutants, branches, f"{one.processor_s:.0f}")
    return shown


def main(arguments: Sequence[str], tree: Path = _TREE) -> int:
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__.partition("\n")[0])
    parser.add_argument("module", nargs="*", help="paths, or their ends: guard, safety/limits")
    parser.add_argument("--only", default="", help="mistakes with this in their names")
    parser.add_argument("--changed", action="store_true", help="mistakes of what is not as it was")
    parser.add_argument("--coverage", action="store_true", help="each branch of each module")
    parser.add_argument("--json", action="store_true", help="for programs")
    given = parser.parse_args(arguments)
    session.prepare()
    kept = tree / "build" / "mutants"
    kept.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    try:
        account = Account(tree, kept)
        modules = chosen(account, given.module)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    run = Run(account, tree, kept / "log", console)
    verdicts = []
    for name in modules:
        is_tried = not given.changed or not account.is_clean(name)
        if given.coverage and not given.changed:
            is_tried = False
        if not is_tried and not given.coverage:
            continue
        verdict = run.module(name, given.only) if is_tried else run.branches(name)
        verdicts.append(verdict)
        if not console.is_terminal:
            console.print(f"{name}: {verdict.how or 'branches'}", markup=False, highlight=False)
        show(console, verdict)
    if given.json:
        print(json.dumps([asdict(one) for one in verdicts], indent=1, ensure_ascii=False))
    elif verdicts:
        Console(width=max(_TABLE_WIDTH, console.width)).print(table(verdicts))
    else:
        print(f"all {len(modules)} modules are as they were when each mistake was found")
    if any(one.unfit for one in verdicts):
        return 2
    return 0 if all(one.is_clean for one in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
