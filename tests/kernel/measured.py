"""How many of the lines of `hal/etd_hal/linux` ran in the guests.

Owns: how a run is measured, and the table of all runs together. Must not know: what ran.

A line that no guest can reach stands in `unreached.toml`, with its reason. Every other one must
have run.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from coverage import Coverage
from coverage.exceptions import CoverageException

from pieces import BUILD, HERE, TREE

_SETTINGS = HERE / "coverage.ini"
#: Where the settings have it put, in the guest: the shared folder knows no locks.
_IN_GUEST = "/run/lines"
_NAME = "lines"
_MEASURED = TREE / "hal/etd_hal/linux"


def command(rest: list[str]) -> list[str]:
    """`python REST`, measured, and so is every Python that it starts."""
    return [
        *("sh", "-c"),
        f'mkdir {_IN_GUEST}; python -m coverage run --rcfile={_SETTINGS} "$@"; status=$?;'
        f" mkdir /run/rig/{_NAME}; cp {_IN_GUEST}/* /run/rig/{_NAME}; exit $status",
        *("sh", *rest),
    ]


@dataclass
class Lines:
    """What became of the statements of one file."""

    name: str
    count: int
    excused: int = 0
    #: Neither run nor excused, each as "number: text".
    missed: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        ran = self.count - self.excused - len(self.missed)
        told = [f"  {self.name:14} {ran:4} of {self.count} ran, {self.excused} cannot"]
        return "\n".join([*told, *(f"    NOT RUN {text}" for text in self.missed)])


def table(outs: list[Path]) -> tuple[str, bool]:
    """Lines by file, from the folders that the guests shared; and whether all is as it must be."""
    data = [path for out in outs for path in sorted((out / _NAME).glob("*"))]
    measured = Coverage(data_file=str(BUILD / "lines"), config_file=str(_SETTINGS))
    try:
        measured.combine([str(path) for path in data], keep=True)
        excuses = tomllib.loads((HERE / "unreached.toml").read_text("utf-8"))
        found = [_lines(measured, path, excuses) for path in sorted(_MEASURED.glob("*.py"))]
    except CoverageException as error:
        return f"which lines of {_MEASURED.name} ran: {error}", False
    ran = sum(lines.count - lines.excused - len(lines.missed) for lines in found)
    cannot = sum(lines.excused for lines in found)
    head = (
        f"statements of hal/etd_hal/linux: {ran} of {sum(lines.count for lines in found)} ran in a"
        f" guest, {cannot} cannot (tests/kernel/unreached.toml)"
    )
    return "\n".join([head, *map(str, found)]), not any(lines.missed for lines in found)


def _lines(measured: Coverage, path: Path, excuses: dict[str, list[dict[str, str]]]) -> Lines:
    text = path.read_text("utf-8").splitlines()
    _, statements, _, missing, _ = measured.analysis2(str(path))
    lines = Lines(path.name, len(statements))
    excused = {entry["line"] for entry in excuses.get(path.name, [])}
    used: set[str] = set()
    for number in missing:
        found = {text[number - 1].strip()} & excused
        if found:
            lines.excused += 1
            used.update(found)
        else:
            lines.missed.append(f"{number}: {text[number - 1].strip()}")
    lines.missed += [f"excused, but it ran or is gone: {text}" for text in sorted(excused - used)]
    return lines
