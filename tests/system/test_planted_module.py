"""A folder that others can write to, as the working folder: no module of theirs is run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from command_rig import WITHIN_S

pytestmark = pytest.mark.slow

#: What every part of the daemon imports, what Python itself looks for, and the daemon's packages.
_PLANTED = ("msgspec.py", "sitecustomize.py", "etd/__init__.py", "etd_hal/__init__.py")


@pytest.mark.parametrize("verb", [("run", "--board", "fake"), ("demo",)])
def test_no_module_of_the_working_folder_is_run(verb: tuple[str, ...], tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    planted = tmp_path / "planted"
    for name in _PLANTED:
        path = planted / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            f"import os\nopen({str(marks)!r} + '/{path.stem}-' + str(os.getpid()), 'w')\n"
        )
    etd = Path(sys.executable).with_name("etd")
    with tempfile.TemporaryDirectory(prefix="etd-") as folder:
        where = ("--folder", folder) if verb[0] == "run" else ()
        ended = subprocess.run(
            [str(etd), *verb, "--seconds", "1", *where],
            cwd=planted, capture_output=True, text=True, timeout=WITHIN_S, check=False,
        )  # fmt: skip
    assert [mark.name for mark in marks.iterdir()] == []
    assert ended.returncode == 0, ended.stderr
