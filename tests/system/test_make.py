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


def test_help_lists_every_target() -> None:
    said = subprocess.run(
        ["make", "help"], cwd=CLONE, capture_output=True, text=True, check=True, timeout=600
    ).stdout
    for target in (
        "demo",
        "check",
        "test",
        "test-models",
        "durations",
        "bench",
        "format",
        "install",
    ):
        assert f"make {target}" in said
