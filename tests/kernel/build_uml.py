"""What the virtual-time guest is made of: User-Mode Linux from Debian's kernel source, our module.

Owns: fetching the source, configuring, compiling, and what need not be done again.
Must not know: what runs in the guest.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from build_x86 import (
    BUILD,
    HERE,
    SERIES,
    RigFailure,
    fingerprint,
    is_done,
    need,
    run,
    spidev_package,
)

_TOOLS = {
    "busybox": "busybox-static",
    "gcc": "gcc",
    "make": "make",
    "flex": "flex",
    "bison": "bison",
    "bc": "bc",
    "xz": "xz-utils",
    "dpkg-deb": "dpkg",
}


def source() -> Path:
    """Debian's kernel source, unpacked."""
    folder = BUILD / "source"
    tree = folder / f"linux-source-{SERIES}"
    if is_done(folder, SERIES):
        return tree
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    name = f"linux-source-{SERIES}"
    run("apt-get", "download", "-o", "APT::Sandbox::User=root", name, cwd=folder)
    (package,) = folder.glob("*.deb")
    run("dpkg-deb", "-x", package, folder)
    run("tar", "xf", folder / f"usr/src/{name}.tar.xz", cwd=folder)
    shutil.rmtree(folder / "usr")
    package.unlink()
    (folder / "done").write_text(SERIES)
    return tree


def kernel(tree: Path) -> Path:
    """The guest: a program. Minutes, the first time."""
    config = HERE / "uml.config"
    mark = fingerprint([config])
    folder = BUILD / "uml" / "kernel"
    if is_done(folder, mark):
        return tree / "linux"
    folder.mkdir(parents=True, exist_ok=True)
    run("make", "-s", "ARCH=um", "allnoconfig", cwd=tree, env={"KCONFIG_ALLCONFIG": str(config)})
    _check_config(config, tree / ".config")
    jobs = f"-j{os.cpu_count() or 1}"
    run("make", "-s", jobs, "ARCH=um", "linux", "modules_prepare", cwd=tree)
    (folder / "done").write_text(mark)
    return tree / "linux"


def _check_config(wanted: Path, got: Path) -> None:
    """An option that the kernel no longer knows, or whose needs are not met, vanishes silently."""
    lines = [line for line in wanted.read_text().splitlines() if line.startswith("CONFIG_")]
    missing = set(lines) - set(got.read_text().splitlines())
    if missing:
        raise RigFailure(f"the kernel does not take {', '.join(sorted(missing))}")


def module(tree: Path, built_with: Path) -> Path:
    """Our module. What it needs of the kernel is looked up when it is loaded."""
    sources = [path for path in (HERE / "modules").iterdir() if path.is_file()]
    folder = BUILD / "uml" / "module"
    mark = fingerprint([*sources, built_with])
    if is_done(folder, mark):
        return folder / "rig.ko"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for path in sources:
        shutil.copy(path, folder)
    run("make", "-s", "ARCH=um", f"M={folder}", "KBUILD_MODPOST_WARN=1", "modules", cwd=tree)
    (folder / "done").write_text(mark)
    return folder / "rig.ko"


def build(python: str) -> tuple[Path, Path]:
    """The kernel and the module. Raises: RigFailure."""
    need(_TOOLS)
    tree = source()
    linux = kernel(tree)
    spidev_package(python)
    return linux, module(tree, linux)


if __name__ == "__main__":
    try:
        for piece in build(sys.executable):
            print(piece)
    except (RigFailure, subprocess.SubprocessError) as failure:
        sys.exit(f"the kernel rig cannot be built: {failure}")
