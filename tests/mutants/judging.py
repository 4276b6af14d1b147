"""What becomes of the mistakes of one module under its tests.

Owns: the order. The tests are run once without a mistake: which come by which line, how long each
takes, which branches none takes. Then each mistake is tried by the tests that come by its lines,
the quickest first, up to the first failure. Must not know: explanations, digests, what is shown.

A mistake within a function is put into the module as the tests have loaded it, in a fork. One
outside of functions is there before the tests load the module; so is, a second time, one that no
test has found in a function that ran while the tests were loaded: what they keep of that time was
made without the mistake.
"""

from __future__ import annotations

import json
import mmap
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import coverage

from mutants import fork, session
from mutants.loading import Loaded, NotSo, load_instead, module_name
from mutants.mistakes import Mutant, Mutated
from mutants.session import FOUND, NOT_SO, PASSED, Tests, may_take_s

#: As coverage is told what runs meanwhile, beside the names of tests.
_LOADING = "loading"
#: Loading the tests may take so long of the processor.
_LOADING_S = 60.0
#: What no test can take, and so no test need: what is there for type checkers.
_NOT_RUN = [r"if TYPE_CHECKING:", r"^\s*\.\.\.$"]


class Unfit(Exception):
    """The tests cannot judge: they fail without a mistake."""


@dataclass(frozen=True)
class Baseline:
    """The tests without a mistake."""

    taken_s: dict[str, float]
    #: By line, from 1.
    reached: dict[int, list[str]]
    #: The lines that run while the tests are loaded.
    loading: frozenset[int]
    #: Lines and branches, as coverage names them.
    gaps: list[str]

    def quickest(self, lines: range | None = None) -> list[str]:
        """The tests that come by any of these lines; None: all."""
        if lines is None:
            names = set(self.taken_s)
        else:
            names = {name for line in lines for name in self.reached.get(line, ())}
        return sorted(names, key=lambda name: (self.taken_s[name], name))

    def is_of_loading(self, mutant: Mutant) -> bool:
        """Whether it is in effect while the tests are loaded: then any test may find it."""
        return mutant.is_of_module or not self.loading.isdisjoint(mutant.lines)


@dataclass(frozen=True)
class Outcome:
    """Of one mistake. `by`: the test that has found it, or nothing."""

    name: str
    #: "found", "time", "stalled", "ended", "survived" or "not reached".
    how: str
    by: str

    @property
    def has_survived(self) -> bool:
        return self.how in ("survived", "not reached")


class Judged:
    """One module, below a tree, and its tests."""

    def __init__(self, tree: Path, path: str, tests: Sequence[str], log: Path) -> None:
        self._tree = tree
        self._path = tree / path
        self._name = module_name(path)
        self._tests = list(tests)
        self._log = log
        self._mutated = Mutated(self._path.read_text(encoding="utf-8"), str(self._path))
        #: Which test runs is written there by the fork that runs it.
        self._place = mmap.mmap(-1, 4)

    @property
    def mutants(self) -> list[Mutant]:
        return self._mutated.mutants

    # --- without a mistake -------------------------------------------------------------------

    def baseline(self) -> Baseline:
        """Raises: Unfit."""
        told = list(fork.telling(self._measure, self._log))
        last: dict[str, Any] = told[-1] if told else {"failed": ["what was to be collected"]}
        if last["failed"]:
            raise Unfit(f"tests fail without a mistake: {', '.join(last['failed'])}")
        return Baseline(
            {one["test"]: one["s"] for one in told[:-1]},
            {int(line): names for line, names in last["reached"].items()},
            frozenset(last["loading"]),
            last["gaps"],
        )

    def _measure(self, tell: fork.Tell) -> None:
        tracer = coverage.Coverage(
            data_file=None, branch=True, include=[str(self._path)], config_file=False
        )
        tracer.set_option("report:exclude_also", _NOT_RUN)
        tracer.set_option("run:disable_warnings", ["no-data-collected", "module-not-measured"])
        load_instead(self._name, self._path, self._mutated.compiled(None))
        tracer.start()
        tracer.switch_context(_LOADING)

        def use(tests: Tests) -> None:
            failed = tests.measured(tracer, lambda name, s: tell({"test": name, "s": s}))
            tracer.stop()
            contexts = tracer.get_data().contexts_by_lineno(str(self._path))
            known = set(tests.names)
            reached = {line: sorted(known & set(names)) for line, names in contexts.items()}
            loading = [line for line, names in contexts.items() if _LOADING in names]
            gaps = _gaps(tracer)
            tell({"failed": failed, "reached": reached, "loading": loading, "gaps": gaps})

        session.collected(self._tree, self._tests, self._place, use, ends=False)

    # --- with one ----------------------------------------------------------------------------

    def outcomes(self, baseline: Baseline, of: Sequence[Mutant]) -> Iterator[Outcome]:
        """As they come, each once. Raises: Unfit."""
        later: list[Mutant] = []
        within: list[Mutant] = []
        for one in of:
            if not one.is_of_module and baseline.quickest(one.lines):
                within.append(one)
            elif baseline.is_of_loading(one):
                later.append(one)
            else:
                yield Outcome(one.name, "not reached", "")
        by_name = {one.name: one for one in of}
        for told in self._all(self._put_in(baseline, within), within):
            outcome = _outcome(told)
            mutant = by_name[outcome.name]
            is_of_loading = baseline.is_of_loading(mutant)
            if told["status"] == NOT_SO or (outcome.has_survived and is_of_loading):
                later.append(mutant)
            else:
                yield outcome
        for told in self._all(self._load_with(baseline, later), later):
            yield _outcome(told)

    def _all(
        self, work: Callable[[fork.Tell], None], of: Sequence[Mutant]
    ) -> Iterator[dict[str, Any]]:
        if not of:
            return
        for told in fork.telling(work, self._log):
            if "unfit" in told:
                raise Unfit(told["unfit"])
            if told["status"] == fork.BROKEN:
                raise Unfit(f"trying {told['name']!r} broke down: see {self._log}")
            yield told

    def _put_in(self, baseline: Baseline, of: Sequence[Mutant]) -> Callable[[fork.Tell], None]:
        def work(tell: fork.Tell) -> None:
            plain = self._mutated.compiled(None)
            load_instead(self._name, self._path, plain)

            def use(tests: Tests) -> None:
                loaded = Loaded(self._path, plain)
                names = baseline.quickest()
                status = fork.ending(lambda: tests.run(names, _limits(baseline)))
                if status != PASSED:
                    tell({"unfit": f"without a mistake, {self._running(names)} fails after others"})
                    return
                for mutant in of:
                    names = baseline.quickest(mutant.lines)
                    status = fork.ending(partial(self._try, loaded, tests, mutant, names, baseline))
                    tell({"name": mutant.name, "status": status, "by": self._running(names)})

            if not session.collected(self._tree, self._tests, self._place, use, ends=True):
                tell({"unfit": "the tests could not be collected again"})

        return work

    def _try(
        self,
        loaded: Loaded,
        tests: Tests,
        mutant: Mutant,
        names: Sequence[str],
        baseline: Baseline,
    ) -> int:
        if self._name not in sys.modules:
            return NOT_SO
        try:
            loaded.put(self._mutated.compiled(mutant))
        except NotSo:
            return NOT_SO
        return tests.run(names, _limits(baseline))

    def _load_with(self, baseline: Baseline, of: Sequence[Mutant]) -> Callable[[fork.Tell], None]:
        def work(tell: fork.Tell) -> None:
            for mutant in of:
                is_of_loading = baseline.is_of_loading(mutant)
                names = baseline.quickest(None if is_of_loading else mutant.lines)
                status = fork.ending(partial(self._load_and_try, mutant, names, baseline))
                tell({"name": mutant.name, "status": status, "by": self._running(names)})

        return work

    def _load_and_try(self, mutant: Mutant, names: Sequence[str], baseline: Baseline) -> int:
        self._place[:4] = (0xFFFFFFFF).to_bytes(4, "little")
        signal.setitimer(signal.ITIMER_PROF, _LOADING_S)
        load_instead(self._name, self._path, self._mutated.compiled(mutant))
        passed = []

        def use(tests: Tests) -> None:
            passed.append(tests.run(names, _limits(baseline)))

        files = sorted({name.partition("::")[0] for name in names})
        if session.collected(self._tree, files, self._place, use, ends=True):
            return passed[0]
        return FOUND

    def _running(self, names: Sequence[str]) -> str:
        """Which test ran last; "" while they were being loaded."""
        index = int.from_bytes(self._place[:4], "little")
        return names[index] if index < len(names) else ""


def _limits(baseline: Baseline) -> Callable[[str], float]:
    slowest_s = max(baseline.taken_s.values())
    return lambda name: may_take_s(baseline.taken_s.get(name, slowest_s))


def _outcome(told: dict[str, Any]) -> Outcome:
    status, by = told["status"], told["by"]
    match status:
        case 0:
            return Outcome(told["name"], "survived", "")
        case fork.STALLED:
            return Outcome(told["name"], "stalled", by)
        case _ if status == -signal.SIGPROF:
            return Outcome(told["name"], "time", by)
        case _ if status < 0:
            return Outcome(told["name"], "ended", by)
    return Outcome(told["name"], "found", by)


def _gaps(tracer: coverage.Coverage) -> list[str]:
    """What no test has taken: a line, or the way from one to another (below 0: out of it)."""
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        tracer.json_report(outfile=file.name)
        report = json.loads(Path(file.name).read_text(encoding="utf-8"))
    gaps: list[str] = []
    for one in report["files"].values():
        gaps += [f"line {line}" for line in one["missing_lines"]]
        missing = set(one["missing_lines"])
        gaps += [
            f"{begin} -> {end}" for begin, end in one["missing_branches"] if begin not in missing
        ]
    return gaps
