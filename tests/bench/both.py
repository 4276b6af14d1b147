"""The engine's processor time for a pulse, compiled and interpreted, turn about.

Owns: the processes, each with its own code, and the table of their medians; the least of the rounds
counts, because what else the machine does only adds. Must not know: what is measured
(`processor.py`).

`--tree FOLDER`: another checkout beside these two, with its own benchmark.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

CLONE = Path(__file__).resolve().parents[2]
#: Each folder of compiled code is called as the target of the Makefile that makes it.
COMPILED = CLONE / "build" / "compiled"
KINDS = {
    "plain": "",
    "with stabilizers": ", modelled.STABILIZED",
    "probe first": ", modelled.AHEAD",
}
_MEASURE = (
    "from bench import modelled, processor; print(processor.measure({scans}{kind}).median_us)"
)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--tree", type=Path, help="another checkout, measured beside these")
    asked = parser.parse_args()
    trees = code_of(asked.tree, COMPILED)
    for kind, argument in KINDS.items():
        program = _MEASURE.format(scans=asked.scans, kind=argument)
        found = {name: float("inf") for name in trees}
        for _ in range(asked.rounds):
            for name, path in trees.items():
                found[name] = min(found[name], _median_us(program, path))
        first = next(iter(found.values()))
        told = (f"{name} {us:.1f} us ({us / first:.2f})" for name, us in found.items())
        print(f"a pulse, {kind}: {', '.join(told)}")
    return 0


def code_of(tree: Path | None, compiled: Path) -> dict[str, list[Path]]:
    """By name, the folders of modules of each that is measured: the other checkout's first."""
    trees = [] if tree is None else [(tree.resolve().name, tree.resolve())]
    code = {
        name: [root / part for part in ("daemon", "hal", "tests")]
        for name, root in (*trees, ("interpreted", CLONE))
    }
    if compiled.is_dir():
        code["compiled"] = [compiled, CLONE / "tests"]
    else:
        print(
            f"the compiled code is not measured: make {compiled.name}, where there is a C compiler"
        )
    return code


def _median_us(program: str, path: list[Path]) -> float:
    environment = {**os.environ, "PYTHONPATH": ":".join(map(str, path)), "PYTHONHASHSEED": "0"}
    ran = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    return float(ran.stdout)


if __name__ == "__main__":
    sys.exit(main())
