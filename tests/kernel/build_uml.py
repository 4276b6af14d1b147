"""What the virtual-time guest is made of: User-Mode Linux from Debian's kernel source, our module.

Owns: fetching the source, configuring, compiling, and what need not be done again.
Must not know: what runs in the guest.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

from build_x86 import SERIES, spidev_package
from pieces import HERE, RigFailure, fingerprint, is_made, making, need, only_builder, piece, run

TOOLS = {
    "busybox": "busybox-static",
    "gcc": "gcc",
    "make": "make",
    "flex": "flex",
    "bison": "bison",
    "bc": "bc",
    "xz": "xz-utils",
    "dpkg-deb": "dpkg",
}


#: What is not needed once the kernel is built: most of 1.7 GB. Modules of our own need the rest.
_NOT_KEPT = ("Documentation", "crypto", "drivers", "fs", "net", "samples", "sound", "tools")


#: The source reckons with so many bytes of a processor's registers. Where it has AMX they are
#: 11008, and the kernel below takes them back whole or not at all.
_REGISTERS = "DEFINE_LONGS(HOST_FP_SIZE, {});"
_REGISTER_BYTES, _MOST_REGISTER_BYTES = 2696, 11264


def source_version() -> str:
    """Of the kernel's source, as the package sources of this machine know it."""
    told = run("apt-cache", "show", "--no-all-versions", f"linux-source-{SERIES}")
    (version,) = (line for line in told.splitlines() if line.startswith("Version: "))
    return version.removeprefix("Version: ")


def unpacked_source(folder: Path) -> Path:
    """Debian's kernel source, below `folder`."""
    name = f"linux-source-{SERIES}"
    run("apt-get", "download", "-o", "APT::Sandbox::User=root", name, cwd=folder)
    (package,) = folder.glob("*.deb")
    run("dpkg-deb", "-x", package, folder)
    run("tar", "xf", folder / f"usr/src/{name}.tar.xz", cwd=folder)
    shutil.rmtree(folder / "usr")
    package.unlink()
    return folder / name


def kernel() -> Path:
    """The folder of the kernel, built: the guest is the program `linux` in it.

    Minutes, the first time.
    """
    config = HERE / "uml.config"
    wide = _REGISTERS.format(_MOST_REGISTER_BYTES)
    folder = piece("uml", source_version() + fingerprint([config]) + wide)
    tree = folder / f"linux-source-{SERIES}"
    if is_made(folder):
        return tree
    with making(folder):
        unpacked_source(folder)
        _widen_registers(tree)
        asked = {"KCONFIG_ALLCONFIG": str(config)}
        run("make", "-s", "ARCH=um", "allnoconfig", cwd=tree, env=asked)
        _check_config(config, tree / ".config")
        jobs = f"-j{os.cpu_count() or 1}"
        run("make", "-s", jobs, "ARCH=um", "linux", "modules_prepare", cwd=tree)
        _thin_out(tree)
    return tree


def _widen_registers(tree: Path) -> None:
    """Raises: RigFailure, if the source has changed in this."""
    sizes = tree / "arch/x86/um/user-offsets.c"
    text, known = sizes.read_text(), _REGISTERS.format(_REGISTER_BYTES)
    if known not in text:
        raise RigFailure(f"{sizes} has no {known}: look whether it still bounds the registers")
    sizes.write_text(text.replace(known, _REGISTERS.format(_MOST_REGISTER_BYTES)))


def _thin_out(tree: Path) -> None:
    for name in _NOT_KEPT:
        shutil.rmtree(tree / name)
    for arch in (tree / "arch").iterdir():
        if arch.is_dir() and arch.name not in ("um", "x86"):
            shutil.rmtree(arch)


def _check_config(wanted: Path, got: Path) -> None:
    """An option that the kernel no longer knows, or whose needs are not met, vanishes silently."""
    lines = [line for line in wanted.read_text().splitlines() if line.startswith("CONFIG_")]
    missing = set(lines) - set(got.read_text().splitlines())
    if missing:
        raise RigFailure(f"the kernel does not take {', '.join(sorted(missing))}")


def module(tree: Path) -> Path:
    """Our module. What it needs of the kernel is looked up when it is loaded."""
    sources = [path for path in (HERE / "modules").iterdir() if path.is_file()]
    folder = piece("uml-module", str(tree) + fingerprint(sources))
    if is_made(folder):
        return folder / "rig.ko"
    with making(folder):
        for path in sources:
            shutil.copy(path, folder)
        run("make", "-s", "ARCH=um", f"M={folder}", "KBUILD_MODPOST_WARN=1", "modules", cwd=tree)
    return folder / "rig.ko"


@cache
def build(python: str) -> tuple[Path, Path]:
    """The kernel and the module, looked up once a run. Raises: RigFailure."""
    need(TOOLS)
    with only_builder():
        tree = kernel()
        spidev_package(python)
        return tree / "linux", module(tree)


if __name__ == "__main__":
    try:
        for built in build(sys.executable):
            print(built)
    except (RigFailure, subprocess.SubprocessError) as failure:
        sys.exit(f"the kernel rig cannot be built: {failure}")
