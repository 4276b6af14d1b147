"""The Makefile on machines that lack something: one sentence that says what to install."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

CLONE = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed here")


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A fresh clone, as far as setting up looks at it."""
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(CLONE / name, tmp_path)
    return tmp_path


def python(folder: Path, *, lacks: str) -> Path:
    """A Python that fails when its program mentions `lacks`, and else does nothing."""
    path = folder / "python-that-lacks"
    refuse = f'case "$*" in *{lacks}*) exit 1;; *-V*) echo Python 3.9.2;; esac\n'
    path.write_text("#!/bin/sh\n" + refuse)
    path.chmod(0o755)
    return path


def make(clone: Path, *arguments: str) -> str:
    """What a failing make says."""
    ran = subprocess.run(
        ["make", *arguments],
        cwd=clone,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
        env={"PATH": os.environ["PATH"]},
    )
    assert ran.returncode != 0
    return ran.stdout + ran.stderr


@pytest.mark.parametrize("target", ["demo", "check", "test", "bench", "format", "install"])
def test_without_python_it_names_the_package(clone: Path, target: str) -> None:
    assert "sudo apt install python3" in make(clone, target, "PYTHON=no-python-here")


def test_an_old_python_is_told_with_its_version(clone: Path) -> None:
    said = make(clone, "demo", f"PYTHON={python(clone, lacks='version_info')}")
    assert "needs Python 3.11 or newer" in said
    assert "Python 3.9.2" in said


def test_without_venv_it_names_the_package_and_makes_nothing(clone: Path) -> None:
    said = make(clone, "test", f"PYTHON={python(clone, lacks='ensurepip')}")
    assert "sudo apt install python3-venv" in said
    assert not (clone / ".venv").exists()


def test_without_headers_installing_names_the_packages(clone: Path) -> None:
    stub = python(clone, lacks="Python.h")
    said = make(clone, "install", f"PYTHON={stub}", f"DESTDIR={clone / 'out'}")
    assert "sudo apt install gcc python3-dev" in said
    assert not (clone / "out").exists()


def test_a_python_in_a_home_is_refused_for_services(clone: Path) -> None:
    stub = python(clone, lacks="base_prefix")
    said = make(clone, "install", f"PYTHON={stub}")
    wanted = "PYTHON=/usr/bin/python3" if os.getuid() == 0 else "sudo make install"
    assert wanted in said


def planned(clone: Path, *arguments: str) -> list[str]:
    """The commands that would run, in their order; nothing is run."""
    stub = python(clone, lacks="nothing")
    ran = subprocess.run(
        ["make", "-n", "install", f"PYTHON={stub}", *arguments],
        cwd=clone,
        capture_output=True,
        text=True,
        check=True,
        timeout=600,
        env={"PATH": os.environ["PATH"]},
    )
    return ran.stdout.splitlines()


def where(commands: list[str], part: str) -> int:
    return next(place for place, command in enumerate(commands) if part in command)


def test_a_running_engine_is_stopped_before_its_program_is_replaced(clone: Path) -> None:
    """Its `etd safe` runs when it ends: with the program gone the outputs stay as they are."""
    commands = planned(clone)
    assert where(commands, "systemctl stop") < where(commands, "venv --clear")


def test_what_is_laid_out_elsewhere_stops_nothing_here(clone: Path) -> None:
    assert not any("systemctl stop" in line for line in planned(clone, f"DESTDIR={clone / 'out'}"))


def test_the_services_can_read_what_is_installed_under_any_umask(clone: Path) -> None:
    commands = planned(clone)
    assert where(commands, "umask 022 && ") < where(commands, "venv --clear")
    assert "place" in commands[where(commands, "umask 022 && ")]


def test_a_long_installation_says_that_it_works(clone: Path) -> None:
    commands = planned(clone)
    assert where(commands, "takes minutes on a small machine") < where(commands, "venv --clear")


def test_help_lists_every_target() -> None:
    said = subprocess.run(
        ["make", "help"], cwd=CLONE, capture_output=True, text=True, check=True, timeout=600
    ).stdout
    for target in (
        "demo",
        "check",
        "test",
        "test-models",
        "test-pages",
        "durations",
        "bench",
        "format",
        "install",
    ):
        assert f"make {target}" in said
