"""One target, fuzzed in a process of its own: by atheris where it is, else by changes of seeds.

Owns: playing inputs until the time is over or one is a finding, and telling how many there were.
Must not know: other targets, how time is shared. Exit status 1 with a finding.

Run by `run.py`. Each second a line with the number of inputs so far goes to the standard output;
what the program under test prints there goes nowhere.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from fuzz.mutation import Mutator
    from fuzz.target import Target

# Run as a script, from a clone: the harnesses stand beside the test rigs.
sys.path[:0] = [str(Path(__file__).resolve().parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: An input that takes so long hangs.
_HANGS_S = 120
_MOST_MB = 2_048
_SECOND_NS = 1_000_000_000

# Nothing of ours is imported before it is known whether it is to be instrumented.


class Counted:
    """Plays inputs; keeps the first that is a finding, and ends the process."""

    def __init__(self, module: str, name: str, findings: Path, telling: TextIO) -> None:
        from etd.client import clock
        from fuzz import stored, target

        there = importlib.import_module(module).TARGETS
        self.target: Target = next(one for one in there if one.name == name)
        self.starts = stored.starts(self.target)
        self.now_ns = clock.now_ns
        self._play, self._keep = target.play, stored.keep_finding
        self._findings, self._telling = findings, telling
        self._count = 0
        self._told_ns = self.now_ns()
        # What is imported and made at the first input belongs to none.
        with contextlib.suppress(Exception):
            self.target.play(self.starts[0])

    def __call__(self, data: bytes) -> None:
        try:
            self._play(self.target, data)
        except Exception as error:  # noqa: BLE001 (any is a finding)
            self._keep(self._findings, data, error)
            self.tell()
            os._exit(1)
        self._count += 1
        if self.now_ns() - self._told_ns >= _SECOND_NS:
            self.tell()

    def tell(self) -> None:
        self._told_ns = self.now_ns()
        print(self._count, file=self._telling, flush=True)


def _mutator(counted: Counted, seed: int) -> Mutator:
    from fuzz.mutation import Mutator

    return Mutator(counted.starts, counted.target.most_bytes, seed)


def _guided(args: argparse.Namespace, telling: TextIO) -> None:
    """Does not return."""
    import atheris

    with atheris.instrument_imports(include=args.guiding.split(",")):
        counted = Counted(args.module, args.target, args.findings, telling)
    from fuzz import mutation, stored

    if args.merge:
        atheris.Setup(args.merge, counted)
        atheris.Fuzz()
    mutator = _mutator(counted, args.seed)

    def change(data: bytes, most: int, _: int) -> bytes:
        """With the words of the format, whose decoders in C tell no coverage; or as it will."""
        changed: bytes = atheris.Mutate(data, most)
        return mutator.changed(data)[:most] if mutator.is_heads() else changed

    folder: Path = args.folder
    corpus, seeds = folder / "corpus" / args.target, folder / "seeds" / args.target
    for made in (corpus, args.findings):
        made.mkdir(parents=True, exist_ok=True)
    stored.written(seeds, counted.starts)
    dictionary = folder / f"{args.target}.dict"
    dictionary.write_text("".join(map(_entry, mutation.words(counted.starts))))
    options = (
        f"-max_total_time={args.seconds}",
        f"-max_len={max(counted.target.most_bytes, *map(len, counted.starts))}",
        f"-seed={args.seed}",
        f"-timeout={_HANGS_S}",
        f"-rss_limit_mb={_MOST_MB}",
        f"-artifact_prefix={args.findings}/",
        f"-dict={dictionary}",
        "-len_control=0",
    )
    arguments = [sys.argv[0], *options, str(corpus), str(seeds)]
    atheris.Setup(arguments, counted, custom_mutator=change)
    atheris.Fuzz()


def _entry(word: bytes) -> str:
    return '"' + "".join(f"\\x{byte:02x}" for byte in word) + '"\n'


def _unguided(args: argparse.Namespace, telling: TextIO) -> None:
    counted = Counted(args.module, args.target, args.findings, telling)
    mutator = _mutator(counted, args.seed)

    def hangs(*_: object) -> None:
        raise TimeoutError(f"it hangs: more than {_HANGS_S} s")

    signal.signal(signal.SIGALRM, hangs)
    until_ns = counted.now_ns() + args.seconds * _SECOND_NS
    starts = iter(counted.starts)
    while counted.now_ns() < until_ns:
        signal.alarm(_HANGS_S)
        counted(next(starts, None) or mutator.next())
    counted.tell()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("module", help="where the target is: of others nothing is imported")
    parser.add_argument("target")
    parser.add_argument("--seconds", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, required=True, help="for what is kept")
    parser.add_argument("--findings", type=Path, required=True)
    parser.add_argument("--guiding", default="", help="packages; none: without atheris")
    parser.add_argument("--merge", nargs=argparse.REMAINDER, help="as libFuzzer has it")
    args = parser.parse_args()
    telling = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    (_guided if args.guiding else _unguided)(args, telling)


if __name__ == "__main__":
    main()
