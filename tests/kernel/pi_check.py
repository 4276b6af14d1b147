"""`make kernel-test-pi`: the shipped drivers on the Pi's own, in an emulated Raspberry Pi 3.

Owns: what runs on it, how the kernel is told, and the table of how each went.
Must not know: what a check does.

Ends with 1 when a check failed, and with 3 when the machine could not be built or started: never
with a skip.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter

import build_pi
from etd.client import clock
from pi_machine import TIMEOUT_S, boot
from pieces import RigFailure

_PYTEST = (
    *("python", "-m", "pytest", "-q", "-s", "--color=no", "-p", "no:cacheprovider"),
    *("-o", "python_files=check_*.py test_*.py"),
)
#: Of the contract only what runs on the Pi's drivers; no register hangs on its READBACK.
_CONTRACT = (
    *("tests/contract", "-k", "check_ or (linux and not readback)"),
    *("--board-file=tests/kernel/pi-board.toml", "--machine-file=config/machines/pi3.toml"),
)
_DRIVERS = "tests/kernel/on_pi/check_drivers.py"
_PINS = "tests/kernel/on_pi/check_pins.py"
#: In pytest's last line: how many tests went how.
_COUNT = re.compile(r"(\d+) (passed|failed|errors?|skipped)")


def runs() -> dict[str, tuple[bool, list[str]]]:
    """Of each run, by name: whether released lines keep their levels, and the command."""
    return {
        "released lines become inputs, as with Debian's kernel": (
            False,
            ["env", "ETD_KEEPS_OUTPUTS=0", *_PYTEST, *_CONTRACT, _DRIVERS, _PINS],
        ),
        "released lines stay driven, as with that of Raspberry Pi OS": (
            True,
            ["env", "ETD_KEEPS_OUTPUTS=1", *_PYTEST, _PINS],
        ),
    }


def counted(said: str) -> Counter[str]:
    """Tests by how they went."""
    lines = said.strip().splitlines()
    counts: Counter[str] = Counter()
    for count, how in _COUNT.findall(lines[-1] if lines else ""):
        counts["passed" if how == "passed" else "failed"] += int(count)
    return counts


def main() -> int:
    table: list[str] = []
    counts: Counter[str] = Counter()
    try:
        begun_ns = clock.now_ns()
        build_pi.build()
        table.append(f"{_seconds_since(begun_ns)}  built, or found built")
        for name, (keeps_outputs, command) in runs().items():
            begun_ns = clock.now_ns()
            ended = boot(command, TIMEOUT_S, keeps_outputs=keeps_outputs)
            went = counted(ended.said)
            if ended.status or not went["passed"]:
                went["failed"] = went["failed"] or 1
            counts += went
            said = f"FAILED ({ended.status})" if went["failed"] else "passed"
            table.append(f"{_seconds_since(begun_ns)}  pi, {name}: {said}")
    except (RigFailure, subprocess.SubprocessError) as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        return 3
    print("\n".join(["", *table]))
    print(f"kernel rig, pi: {counts['passed']} passed, {counts['failed']} failed")
    return 1 if counts["failed"] else 0


def _seconds_since(begun_ns: int) -> str:
    return f"{(clock.now_ns() - begun_ns) / 1e9:6.0f} s"


if __name__ == "__main__":
    sys.exit(main())
