"""The engine's instructions for a pulse, compiled and interpreted, whatever else the machine does.

Owns: the runs, each with its own code, and the table of what they took. The instructions of a pulse
are those of two runs, one of which plays more scans, apart, over the pulses between them: start,
imports and arming are in both. Must not know: what is counted (`processor.py`), how a program for
another processor is built and run (`tests/kernel/build_arm.py`).

`--arm`: of 64-bit ARM, by an emulator, instead of this machine's, by valgrind.
`--tree FOLDER`: another checkout beside these two, with its own benchmark.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

# Run as a script, from a clone: the benchmark and the kernel rig stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS), str(_TESTS / "kernel")]

import build_arm  # noqa: E402
from bench.both import COMPILED, KINDS, code_of  # noqa: E402
from bench.modelled import ELECTRODES  # noqa: E402
from pieces import RigFailure, need, run  # noqa: E402

#: How many scans the shorter and the longer run of each play.
SCANS = (4, 36)
_PLAY = "from bench import modelled, processor; processor.measure({scans}{kind})"
_VALGRIND = ("valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null")
_REFERENCES = re.compile(r"I\s+refs:\s+([\d,]+)")
#: The same sets and dictionaries in each run.
_STEADY = {"PYTHONHASHSEED": "0"}

#: The instructions of a program with these folders of modules.
Count = Callable[[str, list[Path]], int]


def by_valgrind() -> Count:
    """Of this machine's processor. Raises: RigFailure."""
    need({"valgrind": "valgrind"})

    def count(program: str, path: list[Path]) -> int:
        with tempfile.TemporaryDirectory() as kept:
            log = Path(kept, "log")
            line = (*_VALGRIND, f"--log-file={log}", sys.executable, "-c", program)
            run(*line, env={"PYTHONPATH": ":".join(map(str, path)), **_STEADY})
            found = _REFERENCES.search(log.read_text())
            if found is None:
                raise RigFailure(f"valgrind did not tell how many instructions ran: {program}")
            return int(found.group(1).replace(",", ""))

    return count


def by_emulator() -> Count:
    """Of 64-bit ARM. Raises: RigFailure."""
    arm = build_arm.build()

    def count(program: str, path: list[Path]) -> int:
        with tempfile.TemporaryDirectory() as kept:
            log = Path(kept, "log")
            run(*arm.python(["-c", program], log), env={**arm.environment(path), **_STEADY})
            return build_arm.counted(log)

    return count


def of_a_pulse(count: Count, kind: str, path: list[Path]) -> float:
    fewer, more = (count(_PLAY.format(scans=scans, kind=kind), path) for scans in SCANS)
    return (more - fewer) / ((SCANS[1] - SCANS[0]) * ELECTRODES)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--arm", action="store_true", help="64-bit ARM, by an emulator")
    parser.add_argument("--tree", type=Path, help="another checkout, counted beside these")
    asked = parser.parse_args()
    code = code_of(asked.tree, build_arm.COMPILED if asked.arm else COMPILED)
    try:
        count = by_emulator() if asked.arm else by_valgrind()
        processor = "aarch64" if asked.arm else platform.machine()
        # Side by side: what else a machine does changes no count.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for kind, argument in KINDS.items():
                found = pool.map(partial(of_a_pulse, count, argument), code.values())
                table = dict(zip(code, found, strict=True))
                first = next(iter(table.values()))
                told = (f"{name} {n / 1e3:.1f} ({n / first:.3f})" for name, n in table.items())
                print(f"{processor}, a pulse, {kind}, thousands: {', '.join(told)}", flush=True)
    except (RigFailure, subprocess.SubprocessError) as failure:
        print(f"nothing is counted: {failure}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
