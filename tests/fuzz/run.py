"""`make fuzz`: bytes from outside, against every decoder there is and against a whole engine.

Owns: which targets are fuzzed for how long, what is told meanwhile and at the end. Exit status 1
with a finding. Must not know: how inputs are made, what a target decodes.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import select
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Run as a script, from a clone: the harnesses stand beside the test rigs.
sys.path[:0] = [str(Path(__file__).resolve().parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from etd.client import clock  # noqa: E402
from fuzz import stored, target  # noqa: E402
from fuzz.minimised import minimise  # noqa: E402
from fuzz.target import Target  # noqa: E402
from fuzz.targets import TARGETS  # noqa: E402

_WORKER = Path(__file__).with_name("worker.py")
#: After a change of decoders their targets are fuzzed for so long together at least, and each of
#: them for so long; then they are known to be clean.
AFTER_A_CHANGE_S, EACH_AFTER_A_CHANGE_S = 600, 60
#: Instrumenting, seeds, and an input that hangs: beyond its time.
_GRACE_S = 300
#: Then it is done once, after the last input.
_WORTH_MINIMISING_S = 60
#: As libFuzzer says it.
_COVERAGE, _RUNS = re.compile(rb"cov: (\d+)"), re.compile(rb"Done (\d+) runs")


@dataclass(frozen=True)
class Outcome:
    """Of one target."""

    target: Target
    seconds: float
    executions: int
    coverage: int | None
    kept: int
    findings: list[Path]


def shares_s(targets: Sequence[Target], seconds: int) -> dict[str, int]:
    """Of the time, by name; each gets a second at least, and none of it is lost."""
    all_shares = sum(one.shares for one in targets)
    return {one.name: max(1, -(-seconds * one.shares // all_shares)) for one in targets}


def fuzz(one: Target, seconds: int, folder: Path, seed: int, is_guided: bool) -> Outcome:
    """In a process of its own."""
    findings, log = folder / "findings" / one.name, folder / f"{one.name}.log"
    findings.mkdir(parents=True, exist_ok=True)
    before = stored.findings(findings)
    command = [sys.executable, str(_WORKER), one.play.__module__, one.name]
    command += ["--seconds", str(seconds)]
    command += ["--folder", str(folder), "--findings", str(findings), "--seed", str(seed)]
    if is_guided:
        command += ["--guiding", ",".join(one.guiding)]
    begun_ns = clock.now_ns()
    with log.open("wb") as told:
        piped = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=told)
        with piped as worker:
            executions = _followed(worker, one.name, seconds, log)
    runs, coverage = _last(log, _RUNS), _last(log, _COVERAGE)
    after = stored.findings(findings)
    new = [path for path in after if after[path] != before.get(path)]
    if is_guided and not new and seconds >= _WORTH_MINIMISING_S:
        minimise(one.name, folder, command, log)
    if worker.returncode and not new:
        raise RuntimeError(f"{one.name} ended with status {worker.returncode}: see {log}")
    corpus = folder / "corpus" / one.name
    return Outcome(
        one,
        (clock.now_ns() - begun_ns) / 1e9,
        runs or executions,
        coverage,
        len(list(corpus.glob("*"))),
        new,
    )


def _followed(worker: subprocess.Popen[bytes], name: str, seconds: int, log: Path) -> int:
    """Until it ends; how many inputs it has told of."""
    assert worker.stdout is not None
    executions, begun_ns, told_ns = 0, clock.now_ns(), 0
    while True:
        passed_s = (clock.now_ns() - begun_ns) / 1e9
        if select.select([worker.stdout], [], [], 5.0)[0]:
            line = worker.stdout.readline()
            if not line:
                worker.wait()
                break
            executions = int(line)
        elif passed_s > seconds + _GRACE_S:
            worker.kill()
        if clock.now_ns() - told_ns >= _tell_every_ns():
            told_ns = clock.now_ns()
            _tell(name, passed_s, seconds, executions, log)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    return executions


def _tell_every_ns() -> int:
    return 1_000_000_000 if sys.stderr.isatty() else 30_000_000_000


def _tell(name: str, passed_s: float, seconds: int, executions: int, log: Path) -> None:
    coverage = _last(log, _COVERAGE)
    line = (
        f"{name}: {passed_s:.0f} of {seconds} s, {executions} inputs,"
        f" {executions / max(passed_s, 1.0):.0f} a second, coverage {coverage or 'not known'}"
    )
    end = "" if sys.stderr.isatty() else "\n"
    begin = "\r\x1b[K" if sys.stderr.isatty() else ""
    print(f"{begin}{line}", end=end, file=sys.stderr, flush=True)


def _last(log: Path, figure: re.Pattern[bytes]) -> int | None:
    """The figure as it was told last."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - 8_192))
        found = figure.findall(file.read())
    return int(found[-1]) if found else None


def show(outcomes: Sequence[Outcome]) -> None:
    print(
        f"{'target':<17}{'inputs':>10}{'a second':>10}{'coverage':>10}{'kept':>7}{'findings':>10}"
    )
    for one in outcomes:
        rate = one.executions / max(one.seconds, 1.0)
        coverage = "-" if one.coverage is None else str(one.coverage)
        print(
            f"{one.target.name:<17}{one.executions:>10}{rate:>10.0f}{coverage:>10}"
            f"{one.kept:>7}{len(one.findings):>10}"
        )
    for one in outcomes:
        for path in one.findings:
            print(f"\nFINDING  {one.target.name}: {_last_line(path.with_suffix('.txt'))}")
            print(f"again:   make fuzz ARGS='{one.target.name} --play {path}'")


def figures(outcomes: Sequence[Outcome], is_guided: bool) -> dict[str, Any]:
    """The same for programs; `is_guided`: coverage led to new inputs."""
    return {
        "is_guided": is_guided,
        "seconds": round(sum(one.seconds for one in outcomes)),
        "targets": [
            {
                "target": one.target.name,
                "inputs": one.executions,
                "coverage": one.coverage,
                "kept": one.kept,
                "findings": [str(path) for path in one.findings],
            }
            for one in outcomes
        ],
    }


def _last_line(path: Path) -> str:
    lines = path.read_text().splitlines() if path.exists() else []
    return lines[-1] if lines else "it hung, or took all memory"


def _play(one: Target, path: Path) -> int:
    """Raises: what makes it a finding."""
    target.play(one, path.read_bytes())
    print(f"{one.name}: nothing wrong with {path}")
    return 0


def planned_s(chosen: Sequence[Target], changed: Sequence[Target], seconds: int) -> dict[str, int]:
    """By target: its share of `seconds`. For one of `changed` its share of ten minutes for these
    alone, or a minute, where that is more.
    """
    plan = shares_s(chosen, seconds)
    for name, share_s in shares_s(changed, AFTER_A_CHANGE_S).items() if changed else ():
        plan[name] = max(plan[name], share_s, EACH_AFTER_A_CHANGE_S)
    return plan


def is_enough(plan: Mapping[str, int], changed: Sequence[Target]) -> bool:
    """Whether these are known to be clean, if nothing was found."""
    given_s = [plan[one.name] for one in changed]
    return sum(given_s) >= AFTER_A_CHANGE_S and min(given_s) >= EACH_AFTER_A_CHANGE_S


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="fuzz", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("targets", nargs="*", metavar="TARGET", help="all, if none is named")
    parser.add_argument("--list", action="store_true", help="the targets there are")
    parser.add_argument("--seconds", type=int, default=3_600, help="for all of them together")
    parser.add_argument(
        "--changed",
        action="store_true",
        help=(
            "targets whose decoders changed since they were clean get"
            f" {AFTER_A_CHANGE_S} s together at least, and {EACH_AFTER_A_CHANGE_S} s each, in place"
            " of their share of --seconds where that is less"
        ),
    )
    parser.add_argument("--play", type=Path, metavar="FILE", help="one input, to one target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--unguided", action="store_true", help="without atheris, as where it is not"
    )
    parser.add_argument("--folder", type=Path, default=stored.BUILD, help="for what is kept")
    parser.add_argument("--json", action="store_true", help="the figures as the last line")
    args = parser.parse_args()
    names = [one.name for one in TARGETS]
    for name in args.targets:
        if name not in names:
            parser.error(f"there is no target {name}; there are {', '.join(names)}")
    if args.play is not None and len(args.targets) != 1:
        parser.error("--play goes with one target")
    return args


def main() -> int:
    args = _arguments()
    chosen = [one for one in TARGETS if not args.targets or one.name in args.targets]
    if args.list:
        for one in chosen:
            print(f"{one.name:<17}{one.about}")
        return 0
    if args.play is not None:
        return _play(chosen[0], args.play)
    is_guided = not args.unguided and importlib.util.find_spec("atheris") is not None
    if not is_guided:
        print("no atheris: inputs are changes of seeds, and no coverage guides them")
    changed = stored.changed(chosen)
    print(f"changed: {', '.join(one.name for one in changed) or 'no decoder'}", flush=True)
    plan = planned_s(chosen, changed if args.changed else (), args.seconds)
    outcomes = [fuzz(one, plan[one.name], args.folder, args.seed, is_guided) for one in chosen]
    show(outcomes)
    is_clean = not any(one.findings for one in outcomes)
    if is_clean and is_guided and changed and not os.environ.get("CI"):
        if is_enough(plan, changed):
            stored.note_fuzzed(changed)
            print(f"clean: written to {stored.FUZZED.relative_to(stored.CLONE)}")
        else:
            print("clean, but too short to count for what has changed: see --changed")
    if args.json:
        print(json.dumps(figures(outcomes, is_guided)))
    return 0 if is_clean else 1


if __name__ == "__main__":
    sys.exit(main())
