"""`make kernel-test-pi`: the shipped drivers on the Pi's own, in an emulated Raspberry Pi 3.

Owns: what runs on it, how the kernel is told, and the table of how each went.
Must not know: what a check does.

Ends with 1 when a check failed, and with 3 when the machine could not be built or started: never
with a skip.
"""

from __future__ import annotations

import subprocess
import sys

import build_pi
from build_x86 import RigFailure
from etd.client import clock
from pi_machine import TIMEOUT_S, boot

_PYTEST = (
    *("python", "-m", "pytest", "-q", "--color=no", "-p", "no:cacheprovider"),
    *("-o", "python_files=check_*.py test_*.py"),
)
_CONTRACT = (
    *("tests/contract", "-k", "linux or check_pi", "--machine-file=config/machines/pi3.toml"),
    "--board-file=tests/kernel/pi-board.toml",
)
_DRIVERS = "tests/kernel/in_guest/check_pi.py"
_PINS = "tests/kernel/in_guest/check_pi_pins.py"


def runs() -> dict[str, tuple[bool, list[str]]]:
    """Of each run, by name: whether released lines keep their levels, and the command."""
    return {
        "contract, drivers, released lines become inputs (Debian)": (
            False,
            ["env", "ETD_KEEPS_OUTPUTS=0", *_PYTEST, "-s", *_CONTRACT, _DRIVERS, _PINS],
        ),
        "released lines stay driven (Raspberry Pi OS)": (
            True,
            ["env", "ETD_KEEPS_OUTPUTS=1", *_PYTEST, _PINS],
        ),
    }


def _seconds_since(begun_ns: int) -> str:
    return f"{(clock.now_ns() - begun_ns) / 1e9:6.0f} s"


def main() -> int:
    table: list[str] = []
    worst = 0
    try:
        begun_ns = clock.now_ns()
        build_pi.build()
        table.append(f"{_seconds_since(begun_ns)}  built, or found built")
        for name, (keeps_outputs, command) in runs().items():
            begun_ns = clock.now_ns()
            status = boot(command, TIMEOUT_S, keeps_outputs=keeps_outputs)
            said = "passed" if status == 0 else f"FAILED ({status})"
            table.append(f"{_seconds_since(begun_ns)}  pi {name}: {said}")
            worst = worst or (1 if status else 0)
    except (RigFailure, subprocess.SubprocessError) as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        worst = 3
    print("\n".join(["", *table]))
    return worst


if __name__ == "__main__":
    sys.exit(main())
