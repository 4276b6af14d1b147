"""Breaks the drivers one line at a time, and shows that a kernel test fails for each.

    .venv/bin/python tests/kernel/mutants.py

Owns: the list of breaks, and the table. The tree itself is not touched: a copy of `hal` is broken,
and comes first in the guest's path. Must not know: what the checks look at.
"""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from pieces import BUILD, TREE, RigFailure
from run import boot

_COPY = BUILD / "mutant"
_CHECKS = ("check_lines.py", "check_pulse.py", "check_width.py")


@dataclass(frozen=True)
class Mutant:
    """One line of one file, broken."""

    what: str
    file: str
    old: str
    new: str


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


def break_copy(mutant: Mutant) -> None:
    """A fresh copy of `hal` with this break. Raises: RigFailure if its line is not there once."""
    shutil.rmtree(_COPY, ignore_errors=True)
    shutil.copytree(TREE / "hal", _COPY, ignore=shutil.ignore_patterns("__pycache__"))
    path = _COPY / "etd_hal" / mutant.file
    text = _text_of(path, mutant)
    path.write_text(text.replace(mutant.old, mutant.new))


def command() -> list[str]:
    checks = " ".join(str(TREE / "tests/kernel/in_guest" / name) for name in _CHECKS)
    return [
        *("sh", "-c"),
        f"PYTHONPATH={_COPY}:$PYTHONPATH exec python -m pytest -q --color=no --tb=no -x"
        f" -p no:cacheprovider -o python_files='check_*.py' {checks}",
    ]


def main() -> int:
    table = []
    survived = 0
    try:
        for mutant in MUTANTS:
            break_copy(mutant)
            status = boot("uml", command(), 120.0)
            survived += status == 0
            table.append(f"{'SURVIVED' if status == 0 else 'found':10} {mutant.what}")
    except RigFailure as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        return 3
    print("\n".join(["", *table]))
    return 1 if survived else 0


if __name__ == "__main__":
    sys.exit(main())
