"""`make kernel-test`: builds the guests, runs every check in the guests where it holds.

Owns: which check runs where and how long, and the account of it all. Must not know: what a check
does.

x86 shows what needs a processor that goes on while others wait, uml what needs time to be exact,
service what needs systemd. The guests run at the same time: none measures this machine's own time.
Ends with 1 when a check failed or was skipped, and with 3 when a guest could not be built or
started.
"""

from __future__ import annotations

import argparse
import secrets
import shlex
import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree

import build_uml
import build_x86
import bytecode
import measured
import mutants
import service_layers
from etd.client import clock
from pieces import BUILD, TREE, RigFailure, need
from run import PROCESSOR_S, Guest, boot

_CHECKS = TREE / "tests/kernel/in_guest"
_CONTRACT = TREE / "tests/contract"
_EVERYWHERE = ("check_lines.py", "check_faults.py", "check_pulse.py", "check_stopper.py")
_ONLY: dict[Guest, tuple[str, ...]] = {
    "x86": ("check_kills.py", "check_hog.py", "check_fade.py", "check_scan_core.py"),
    "uml": (
        *("check_scene.py", "check_selftest.py", "check_unplugged.py", "check_refusals.py"),
        *("check_missing.py", "check_kill_test_process.py"),
    ),
    "service": ("check_service.py", "check_service_kills.py"),
    "service-x86": ("check_service.py", "check_service_kills.py"),
}
#: Those that run together, every day.
_GUESTS: tuple[Guest, ...] = ("x86", "uml", "service")
#: What is so exact that nothing may be different from one run to the next.
_APART: dict[Guest, tuple[str, ...]] = {"uml": ("check_width.py",)}
#: Every plugin that is loaded and not used costs a second and more: only those named here are.
_BY_NAME = "PYTEST_DISABLE_PLUGIN_AUTOLOAD=1"
_PYTEST = (
    *("-m", "pytest", "-q", "-s", "--color=no", "-p", "no:cacheprovider", "-p", "pytest_timeout"),
)
#: Of the contract only what runs on the guest's drivers; of the checks all. In random order.
_WITH_CONTRACT = (
    *("-p", "drawn_order", "-p", "contract_chips", "-k", "check_ or linux"),
    *("-o", "python_files=check_*.py test_*.py"),
    *("--junitxml=/run/rig/tests.xml", str(_CONTRACT)),
)
_AS_EVER = ("-o", "python_files=check_*.py", "--junitxml=/run/rig/tests-apart.xml")
#: Stories, in their order.
_SERVICE = (
    *("-p", "running_services", "-o", "python_files=check_*.py"),
    "--junitxml=/run/rig/tests.xml",
)
#: At most, on a machine that has other things to do.
_A_KILL_S = 20.0
_TIMEOUT_S = 900.0
_SEEDS = 2**32


@dataclass(frozen=True)
class Amounts:
    """How much of what is random or slow, and what chance begins with."""

    kills: int
    pulses: int
    hog_s: int
    faults: int
    seed: int = 0

    def for_guest(self) -> list[str]:
        return [
            f"ETD_KILLS={self.kills}",
            f"ETD_PULSES={self.pulses}",
            f"ETD_HOG_S={self.hog_s}",
            f"ETD_FAULTS={self.faults}",
            f"ETD_SEED={self.seed}",
        ]


EVERYDAY = Amounts(kills=3, pulses=1_000, hog_s=3, faults=1)
THOROUGH = Amounts(kills=200, pulses=1_000, hog_s=60, faults=5)


@dataclass(frozen=True)
class Done:
    """How a guest's run went."""

    guest: Guest
    seconds: float
    processor_s: float
    status: int
    counts: Counter[str]
    figures: str
    failure: str = ""

    @property
    def passed(self) -> bool:
        wrong = self.counts.total() - self.counts["passed"]
        return self.status == 0 and self.counts["passed"] > 0 and not wrong and not self.failure

    def line(self) -> str:
        told = ", ".join(f"{count} {what}" for what, count in self.counts.items() if count)
        said = "passed" if self.passed else f"FAILED ({self.status})"
        took = f"{self.seconds:6.0f} s, {self.processor_s:4.0f} s of a processor"
        return f"{took}  {self.guest}: {said}: {told or 'nothing ran'}"


def command(guest: Guest, amounts: Amounts) -> list[str]:
    """What runs in a guest."""
    env = ["env", _BY_NAME, *amounts.for_guest()]
    checks = [str(_CHECKS / name) for name in _ONLY[guest]]
    if guest in ("service", "service-x86"):
        return [*env, "python", *_PYTEST, *_SERVICE, *checks]
    apart = [str(_CHECKS / name) for name in _APART.get(guest, ())]
    everywhere = [str(_CHECKS / name) for name in _EVERYWHERE]
    tests = [*_PYTEST, *_WITH_CONTRACT, *everywhere, *checks]
    # Where processors are emulated, counting lines takes too long.
    parts = [measured.command(tests) if guest == "uml" else ["python", *tests]]
    if apart:
        parts.insert(0, ["python", *_PYTEST, *_AS_EVER, *apart])
    all_parts = "; ".join(f"{shlex.join(part)} || status=$?" for part in parts)
    return [*env, "sh", "-c", f"status=0; {all_parts}; exit $status"]


def counted(reports: Iterable[Path]) -> Counter[str]:
    """Tests by how they went."""
    counts: Counter[str] = Counter()
    for report in reports:
        for case in ElementTree.parse(report).iter("testcase"):
            went = [child.tag for child in case if child.tag in ("failure", "error", "skipped")]
            counts[{"failure": "failed"}.get(went[0], went[0]) if went else "passed"] += 1
    return counts


def check(guest: Guest, amounts: Amounts) -> Done:
    """Run everything in one guest."""
    begun_ns = clock.now_ns()
    status, failure = 3, ""
    try:
        timeout_s = _TIMEOUT_S + amounts.kills * _A_KILL_S + amounts.hog_s * 20.0
        status = boot(guest, command(guest, amounts), timeout_s)
    except RigFailure as error:
        failure = f"{guest}: {error}"
    out = BUILD / guest / "out"
    figures, used = out / "figures", out / PROCESSOR_S
    return Done(
        guest=guest,
        seconds=(clock.now_ns() - begun_ns) / 1e9,
        processor_s=float(used.read_text()) if used.exists() else 0.0,
        status=status,
        counts=counted(out.glob("tests*.xml")),
        figures=figures.read_text() if figures.exists() else "",
        failure=failure,
    )


def _chosen() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--guest", choices=get_args(Guest), help="this one only")
    parser.add_argument("--thorough", action="store_true", help=f"{THOROUGH}, not {EVERYDAY}")
    parser.add_argument("--kills", type=int, help="of the service's engine")
    parser.add_argument("--pulses", type=int, help="of each width, in uml")
    parser.add_argument("--faults", type=int, help="of the board, named by the self-test, in uml")
    parser.add_argument("--hog-s", type=int, help="seconds beside a hog, in x86")
    parser.add_argument("--seed", type=int, help="of the moments of kills and the order of checks")
    return parser.parse_args()


def _amounts(chosen: argparse.Namespace) -> Amounts:
    base = THOROUGH if chosen.thorough else EVERYDAY
    return Amounts(
        kills=base.kills if chosen.kills is None else chosen.kills,
        pulses=base.pulses if chosen.pulses is None else chosen.pulses,
        hog_s=base.hog_s if chosen.hog_s is None else chosen.hog_s,
        faults=base.faults if chosen.faults is None else chosen.faults,
        seed=secrets.randbelow(_SEEDS) if chosen.seed is None else chosen.seed,
    )


def _account(done: list[Done]) -> int:
    """Print how it went, and return the exit status."""
    for guest_run in done:
        print(f"\n{guest_run.guest}\n{guest_run.figures}", end="")
        if guest_run.failure:
            print(f"the kernel rig failed: {guest_run.failure}", file=sys.stderr)
    print()
    lines, all_ran = "", True
    if any(guest_run.guest == "uml" for guest_run in done):
        lines, all_ran = measured.table([BUILD / "uml" / "out"])
    print(lines)
    for guest_run in done:
        print(guest_run.line())
    counts = sum((guest_run.counts for guest_run in done), Counter())
    counts["failed"] += counts.pop("error", 0) + counts.pop("skipped", 0)
    print(f"kernel rig: {counts['passed']} passed, {counts['failed']} failed")
    if any(guest_run.failure for guest_run in done):
        return 3
    return 0 if all_ran and all(guest_run.passed for guest_run in done) else 1


def main() -> int:
    chosen = _chosen()
    guests: tuple[Guest, ...] = (chosen.guest,) if chosen.guest else _GUESTS
    begun_ns = clock.now_ns()
    try:
        # All of them before anything is built: naming them one build after another takes hours.
        need(build_x86.TOOLS | build_uml.TOOLS | service_layers.TOOLS)
        mutants.check_places()
        bytecode.compile_tree()
        for build in (build_x86.build, build_uml.build):
            build(sys.executable)
        service_layers.build()
    except RigFailure as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        return 3
    amounts = _amounts(chosen)
    print(f"{(clock.now_ns() - begun_ns) / 1e9:.0f} s: built, or found built", flush=True)
    print(f"drawn by chance: the same again with --seed {amounts.seed}", flush=True)
    with ThreadPoolExecutor(len(guests)) as pool:
        done = list(pool.map(lambda guest: check(guest, amounts), guests))
    return _account(done)


if __name__ == "__main__":
    sys.exit(main())
