"""The client keeps to Python 3.10.

Owns: what is checked of the modules that `client_modules.py` finds. `make types` checks the same
modules with mypy, which knows methods as well; `make test-client` runs them on a Python 3.10.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from etd import cli
from etd_hal.daemon_python import OLDEST

pytestmark = pytest.mark.slow

CLONE = Path(__file__).parents[1]
PROGRAMS = Path(sys.executable).parent
PROJECT = tomllib.loads((CLONE / "pyproject.toml").read_text("utf-8"))
KEPT_TO = PROJECT["project"]["requires-python"].removeprefix(">=")
NEWER = (
    "import tomllib",
    "from typing import Self",
    "def late():\n    from asyncio import TaskGroup",
    "import datetime\nnow = datetime.UTC",
    "import subprocess\nsubprocess.Popen(['x'], process_group=0)",
    "try:\n    pass\nexcept* ValueError:\n    pass",
)


@pytest.fixture(scope="module")
def files() -> list[str]:
    program = [sys.executable, str(CLONE / "tests" / "client_modules.py")]
    ran = subprocess.run(program, capture_output=True, text=True, check=True, timeout=300)
    return ran.stdout.split()


def vermin(files: list[str]) -> tuple[int, str]:
    """Status and output: what in the files needs a newer Python than the wheel asks for."""
    command = [str(PROGRAMS / "vermin"), "--no-config-file", "--no-eval-annotations", "--quiet"]
    command += ["--violations", f"--target={KEPT_TO}-", *files]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    return ran.returncode, ran.stdout + ran.stderr


def ruff(files: list[str]) -> tuple[int, str]:
    """Syntax that is newer, which vermin takes for older."""
    version = f"py{KEPT_TO.replace('.', '')}"
    command = [str(PROGRAMS / "ruff"), "check", "--isolated", "--no-cache", "--select=E9"]
    command += [f"--target-version={version}", *files]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    return ran.returncode, ran.stdout + ran.stderr


def test_the_wheel_asks_for_the_clients_python() -> None:
    assert KEPT_TO == "3.10"


def test_the_search_finds_the_client_what_it_loads_late_and_nothing_of_the_engine(
    files: list[str],
) -> None:
    found = {str(Path(file).relative_to(CLONE)) for file in files}
    assert {
        f"daemon/etd/cli/{verb}.py" for verb in cli.VERBS if verb not in cli.DAEMON_VERBS
    } < found
    late = {"daemon/etd/record/wall.py", "hal/etd_hal/linux/clock.py"}
    assert {"daemon/etd/client/aio.py", *late} < found
    parts = {"engine", "gateway", "fake", "etd_body", "spi.py", "gpio.py"}
    assert [path for path in found if parts & set(Path(path).parts)] == []


@pytest.mark.parametrize("check", [vermin, ruff], ids=["vermin", "ruff"])
def test_the_modules_of_the_client_keep_to_it(
    check: Callable[[list[str]], tuple[int, str]], files: list[str]
) -> None:
    status, told = check(files)
    assert status == 0, told


def test_vermin_sees_what_is_newer(tmp_path: Path) -> None:
    files = [tmp_path / f"newer_{number}.py" for number in range(len(NEWER))]
    for file, newer in zip(files, NEWER, strict=True):
        file.write_text(f"from __future__ import annotations\n{newer}\n")
    status, told = vermin([str(file) for file in files])
    assert status == 1
    assert set(re.findall(r"3\.11\s+\S*(newer_\d+\.py)", told)) == {file.name for file in files}


def test_ruff_sees_what_vermin_does_not(tmp_path: Path) -> None:
    file = tmp_path / "newer.py"
    file.write_text("def pick(a, b):\n    return a[*b]\n")
    assert vermin([str(file)])[0] == 0
    assert ruff([str(file)])[0] == 1


def test_the_daemons_python_is_everywhere_the_same() -> None:
    oldest = ".".join(map(str, OLDEST))
    assert PROJECT["tool"]["mypy"]["python_version"] == oldest
    assert PROJECT["tool"]["ruff"]["target-version"] == f"py{oldest.replace('.', '')}"
    makefile = (CLONE / "Makefile").read_text("utf-8")
    assert f"sys.version_info < ({', '.join(map(str, OLDEST))})" in makefile
    assert f"DAEMON_PYTHON = {OLDEST}" in (CLONE / "hatch_build.py").read_text("utf-8")


def test_a_program_that_awaits_nothing_loads_no_asyncio() -> None:
    program = "import sys; from etd import Display; print('asyncio' in sys.modules)"
    for asked, is_loaded in (
        (program, "False"),
        (f"import etd; etd.AsyncDisplay; {program}", "True"),
    ):
        ran = subprocess.run([sys.executable, "-c", asked], capture_output=True, check=True)
        assert ran.stdout.decode().strip() == is_loaded
