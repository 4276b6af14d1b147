"""`make kernel-mutants`: breaks the drivers one line at a time, and a kernel test must see each.

Owns: the list of breaks, which of them were found and by what, and the table. The tree itself is
not touched: copies of `hal` are broken, and each comes first in the path of a run of its own.
Must not know: what the checks look at.

An unbroken copy is run first, and must pass: else a failure would tell nothing. A break counts as
found only where a check says so; a copy that cannot be imported, or a run without a report, is a
defect of the list.
"""

from __future__ import annotations

import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from pieces import BUILD, TREE, RigFailure
from run import boot

_COPIES = BUILD / "mutants"
_REPORTS = BUILD / "uml" / "out"
_CHECKS = ("check_lines.py", "check_pulse.py", "check_width.py")
_CONTROL = "unbroken"
_TIMEOUT_S = 300.0


@dataclass(frozen=True)
class Mutant:
    """One line of one file, broken."""

    what: str
    file: str
    old: str
    new: str

    @property
    def name(self) -> str:
        """Of its copy and its report."""
        return self.what.replace(" ", "-").lower()


MUTANTS = (
    Mutant("a bit of a line's register", "linux/uapi.py", "mask |= 1 << bit", "mask |= 2 << bit"),
    Mutant("the SPI mode", "linux/spi.py", "device.mode = setup.mode", "device.mode = 3"),
    Mutant("the word mask", "chips/ad5452.py", "_MASK = 0x3FFC", "_MASK = 0x3FF8"),
    Mutant(
        "the place of the delays",
        "timing.py",
        "            on,\n            *_holds(shape.delays_us),\n",
        "            *_holds(shape.delays_us),\n            on,\n",
    ),
    Mutant("a delay left out", "linux/spi.py", "delay_us=transfer.delay_us", "delay_us=0"),
    Mutant(
        "chip select not raised", "linux/spi.py", "cs_change=transfer.cs_change", "cs_change=False"
    ),
    Mutant(
        "DATA and CLK swapped",
        "chips/hv507.py",
        "outputs, lines.DATA, lines.CLK,",
        "outputs, lines.CLK, lines.DATA,",
    ),
    Mutant(
        "two calls merged",
        "chips/hv507.py",
        "self._gpio.set(self._close_and_unblank if self._is_latch_open else self._unblank)",
        "self._gpio.set((*self._close_and_unblank, *(() if is_anodic else self._inverse)))",
    ),
    Mutant(
        "initial levels in the order of the lines",
        "linux/gpio.py",
        "for line, level in setup.outputs",
        "for line, level in sorted(setup.outputs)",
    ),
)


def check_places() -> None:
    """Raises: RigFailure if a line that is to be broken is not there once: it was changed."""
    for mutant in MUTANTS:
        _text_of(TREE / "hal" / "etd_hal" / mutant.file, mutant)


def _text_of(path: Path, mutant: Mutant) -> str:
    text = path.read_text()
    if text.count(mutant.old) != 1:
        raise RigFailure(
            f"{mutant.file} has {mutant.old!r} {text.count(mutant.old)} times: mend mutants.py"
        )
    return text


def _copy(name: str) -> Path:
    copy = _COPIES / name
    shutil.copytree(TREE / "hal", copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def make_copies() -> list[str]:
    """A copy of `hal` for each break, and the unbroken one; their names, that one first."""
    shutil.rmtree(_COPIES, ignore_errors=True)
    _copy(_CONTROL)
    for mutant in MUTANTS:
        path = _copy(mutant.name) / "etd_hal" / mutant.file
        path.write_text(_text_of(path, mutant).replace(mutant.old, mutant.new))
    return [_CONTROL, *(mutant.name for mutant in MUTANTS)]


def command(names: list[str]) -> list[str]:
    """One boot for all: the checks on one copy after another, each up to its first failure."""
    checks = shlex.join(str(TREE / "tests/kernel/in_guest" / name) for name in _CHECKS)
    text = (
        f"PYTHONPATH={shlex.quote(str(_COPIES))}/$name:$PYTHONPATH ETD_PULSES=200 python -m pytest"
        " -q --color=no --tb=no -x -p no:cacheprovider -p no:randomly"
        f" -o python_files='check_*.py' --junitxml=/run/rig/mutant-$name.xml {checks}"
    )
    return ["sh", "-c", f"for name in {shlex.join(names)}; do {text}; done; exit 0"]


def found_by(name: str) -> str | None:
    """The check that failed on this copy; None if all of them passed. Raises: RigFailure."""
    report = _REPORTS / f"mutant-{name}.xml"
    if not report.exists():
        raise RigFailure(f"the checks on '{name}' left no report")
    cases = list(ElementTree.parse(report).iter("testcase"))
    for case in cases:
        if any(child.tag in ("failure", "error") for child in case):
            # What cannot be imported is a case without a test's name.
            if not case.get("name", "").startswith("test_"):
                raise RigFailure(f"the checks on '{name}' could not be begun: mend mutants.py")
            return case.get("name")
    if not cases:
        raise RigFailure(f"no check ran on '{name}'")
    return None


def main() -> int:
    try:
        boot("uml", command(make_copies()), _TIMEOUT_S)
        failed = found_by(_CONTROL)
        if failed is not None:
            raise RigFailure(f"{failed} fails on the unbroken copy: nothing can be told")
        found = {mutant.what: found_by(mutant.name) for mutant in MUTANTS}
    except RigFailure as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        return 3
    print(f"\nunbroken: all checks of {', '.join(_CHECKS)} passed")
    for what, check in found.items():
        print(f"{what:42} {'SURVIVED' if check is None else f'found by {check}'}")
    survived = sum(check is None for check in found.values())
    print(f"mutants: {len(found) - survived} passed, {survived} failed")
    return 1 if survived else 0


if __name__ == "__main__":
    sys.exit(main())
