"""Compiles the code that runs for each pulse with mypyc, where there is a C compiler.

Owns: the flags, the hook of the wheel, and `python hatch_build.py FOLDER`, which puts the packages
with their compiled modules into a folder of its own (`make compiled`). Must not know: which modules
these are: pyproject.toml lists them.

The sources are the fallback: without a compiler the wheel holds them alone, and says so. An
editable installation is never compiled: a change would not show.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
#: Before it a wheel can be built as well: of the sources, for the client.
DAEMON_PYTHON = (3, 11)
PACKAGES = ("daemon/etd", "hal/etd_hal", "hal/etd_body")
DATA = ("config", "systemd")
#: What mypyc needs; with msgspec it knows the types of messages.
NEEDS = ["mypy>=2,<3", "setuptools>=68", "msgspec>=0.19"]
#: In a folder that was made here, and may be made again.
MARK = ".made-by-hatch-build"
#: Multiply and add are rounded one after the other, as interpreted: arm64 would fuse them.
FLAGS = ["-ffp-contract=off"]


def why_not() -> str | None:
    """Why nothing can be compiled here; None if it can."""
    if os.environ.get("ETD_INTERPRETED"):
        return "ETD_INTERPRETED is set"
    if sys.version_info < DAEMON_PYTHON:
        return "this Python runs etd's client only; the daemon needs 3.11 or newer"
    compiler = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
    if shutil.which(compiler) is None:
        return f"there is no C compiler ({compiler}): sudo apt install gcc python3-dev"
    if not Path(sysconfig.get_path("include"), "Python.h").exists():
        return "Python's headers are missing: sudo apt install python3-dev"
    return None


def compile_into(folder: Path) -> None:
    """The compiled modules, each in the folder of its package. Several C files, one after the
    other: a small Raspberry Pi has not the memory for all in one.
    """
    import tomllib

    from mypyc.build import mypycify
    from setuptools import Distribution
    from setuptools.command.build_ext import build_ext

    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    modules = project["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]["modules"]
    # mypy reads its own part of pyproject.toml in the working directory.
    os.chdir(ROOT)
    made = folder / "made"
    extensions = mypycify(
        ["--follow-imports=silent", "--no-warn-unused-ignores", *modules],
        opt_level="3",
        debug_level="0",
        multi_file=True,
        target_dir=str(made),
        group_name="etd",
    )
    for extension in extensions:
        extension.extra_compile_args += FLAGS
    command = build_ext(Distribution({"name": "etd", "ext_modules": extensions}))
    command.build_lib, command.build_temp = str(folder), str(made)
    command.ensure_finalized()
    command.run()
    shutil.rmtree(made)


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Of the wheel; see the module."""

    def dependencies(self) -> list[str]:
        return [] if why_not() else NEEDS

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        why = why_not()
        if version == "editable" or why is not None:
            if why is not None:
                self._warn(why)
            return
        self._folder = Path(tempfile.mkdtemp())
        # In a process of its own: mypyc's work ends with it, and so does its memory.
        ran = subprocess.run(
            [sys.executable, __file__, "--modules", str(self._folder)], check=False
        )
        if ran.returncode:
            self._warn(f"compiling ended with status {ran.returncode}, see above")
            return
        for found in self._folder.rglob("*.so"):
            build_data["force_include"][str(found)] = str(found.relative_to(self._folder))
        build_data["pure_python"], build_data["infer_tag"] = False, True

    def _warn(self, why: str) -> None:
        self.app.display_warning(
            f"etd is not compiled, and needs three times the processor's time for a pulse: {why}"
        )

    def finalize(self, *_: object) -> None:
        if hasattr(self, "_folder"):
            shutil.rmtree(self._folder)


def main() -> int:
    *flags, folder = sys.argv[1:]
    into = Path(folder).resolve()
    if not flags:
        why = why_not()
        if why is not None:
            print(f"etd is not compiled here: {why}")
            return 1
        made = into / MARK
        if into.exists() and not made.exists():
            print(f"{into} exists, and this program did not make it: name another folder")
            return 2
        shutil.rmtree(into, ignore_errors=True)
        into.mkdir(parents=True)
        made.touch()
        for package in PACKAGES:
            left_out = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / package, into / Path(package).name, ignore=left_out)
        (into / "etd" / "data").mkdir()
        for data in DATA:
            (into / "etd" / "data" / data).symlink_to(ROOT / data)
    compile_into(into)
    return 0


if __name__ == "__main__":
    sys.exit(main())
