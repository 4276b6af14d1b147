"""How many of the lines of `hal/etd_hal/linux` ran in the guests.

Owns: how a run is measured, and the table of all runs together. Must not know: what ran.

A line that no guest can reach has a comment that begins `no guest can:` and says why; it does not
count, and neither does what only a type checker sees.
"""

from __future__ import annotations

import io
from pathlib import Path

from coverage import Coverage
from coverage.exceptions import CoverageException

from pieces import BUILD, HERE, TREE

_SETTINGS = HERE / "coverage.ini"
#: Where the settings have it put, in the guest: the shared folder knows no locks.
_IN_GUEST = "/run/lines"
_NAME = "lines"
_MEASURED = TREE / "hal/etd_hal/linux"


def command(rest: list[str], every_process: bool) -> list[str]:
    """`python REST`, measured; with `every_process`, so is every Python that it starts.

    On an emulated processor that takes too long: a process is there for a tenth of a second.
    """
    patch = "_exit,subprocess" if every_process else "_exit"
    return [
        *("sh", "-c"),
        f"sed 's/^patch = .*/patch = {patch}/' {_SETTINGS} >/run/coverage.ini; mkdir {_IN_GUEST};"
        ' python -m coverage run --rcfile=/run/coverage.ini "$@"; status=$?;'
        f" mkdir /run/rig/{_NAME}; cp {_IN_GUEST}/* /run/rig/{_NAME}; exit $status",
        *("sh", *rest),
    ]


def table(outs: list[Path]) -> str:
    """Lines by file, from the folders that the guests shared."""
    data = [path for out in outs for path in sorted((out / _NAME).glob("*"))]
    measured = Coverage(data_file=str(BUILD / "lines"), config_file=str(_SETTINGS))
    text = io.StringIO()
    try:
        measured.combine([str(path) for path in data], keep=True)
        measured.report(file=text, show_missing=True, include=[f"{_MEASURED}/*"])
    except CoverageException as error:
        return f"the lines of {_MEASURED.name} that ran: {error}"
    return text.getvalue()
