"""`make kernel-test`: builds the guests, runs every check in the guests where it holds.

Owns: which check runs where, and the table of how each went. Must not know: what a check does.

x86 shows what needs a processor that goes on while others wait, uml what needs time to be exact.
Ends with 1 when a check failed, and with 3 when a guest could not be built or started: never with
a skip.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import build_uml
import build_x86
from build_x86 import TREE, RigFailure
from etd.client import clock
from run import Guest, boot

_CHECKS = TREE / "tests/kernel/in_guest"
_EVERYWHERE = ("check_lines.py", "check_faults.py", "check_pulse.py")
_ONLY: dict[Guest, tuple[str, ...]] = {
    "x86": ("check_kills.py",),
    "uml": ("check_width.py", "check_scene.py"),
}
_PYTEST = (
    *("python", "-m", "pytest", "-q", "--color=no", "-p", "no:cacheprovider"),
    *("-o", "python_files=check_*.py"),
)
#: At most, on a machine that has other things to do.
_A_KILL_S = 20.0
_TIMEOUT_S = {"x86": 400.0, "uml": 300.0}


def runs(guest: Guest, kills: int) -> dict[str, list[str]]:
    """What runs in a guest, by name."""
    checks = [str(_CHECKS / name) for name in (*_EVERYWHERE, *_ONLY[guest])]
    return {
        "contract": ["python", str(Path(__file__).with_name("contract_in_guest.py"))],
        "checks": ["env", f"ETD_KILLS={kills}", *_PYTEST, "-s", *checks],
    }


def _seconds_since(begun_ns: int) -> str:
    return f"{(clock.now_ns() - begun_ns) / 1e9:6.0f} s"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--guest", choices=("x86", "uml"), help="this one only")
    parser.add_argument("--kills", type=int, default=10, help="of the engine, in x86")
    chosen = parser.parse_args()
    guests: tuple[Guest, ...] = (chosen.guest,) if chosen.guest else ("x86", "uml")
    table: list[str] = []
    worst = 0
    try:
        begun_ns = clock.now_ns()
        for build in (build_x86.build, build_uml.build):
            build(sys.executable)
        table.append(f"{_seconds_since(begun_ns)}  built, or found built")
        for guest in guests:
            for name, command in runs(guest, chosen.kills).items():
                begun_ns = clock.now_ns()
                status = boot(guest, command, _TIMEOUT_S[guest] + chosen.kills * _A_KILL_S)
                said = "passed" if status == 0 else f"FAILED ({status})"
                table.append(f"{_seconds_since(begun_ns)}  {guest} {name}: {said}")
                worst = worst or (1 if status else 0)
    except RigFailure as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        worst = 3
    print("\n".join(["", *table]))
    return worst


if __name__ == "__main__":
    sys.exit(main())
