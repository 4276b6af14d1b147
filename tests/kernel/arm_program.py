"""Runs ARM's Python on this machine, in the working tree, and ends as it ended.

    .venv/bin/python tests/kernel/arm_program.py [--compiled] -m pytest tests/daemon/test_ledger.py

Owns: the command line. Must not know: what the program does.

Only that program is emulated: the kernel, its files and its network are this machine's. What it
starts besides has to be this machine's own.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys

import build_arm
from pieces import TREE, RigFailure


def main() -> int:
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").splitlines()[0],
        usage="%(prog)s [--compiled] ARGUMENTS OF PYTHON",
        allow_abbrev=False,
    )
    parser.add_argument("--compiled", action="store_true", help="the code of `make compiled-arm`")
    asked, arguments = parser.parse_known_args()
    sources = [build_arm.COMPILED] if asked.compiled else [TREE / "daemon", TREE / "hal"]
    try:
        arm = build_arm.build()
    except (RigFailure, subprocess.SubprocessError) as failure:
        print(f"the program for ARM cannot be run: {failure}", file=sys.stderr)
        return 3
    environment = {**os.environ, **arm.environment([*sources, TREE / "tests"])}
    return subprocess.run(arm.python(arguments), env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
