"""What the Pi guest is made of: an emulator, a stock Debian kernel and Python for 64-bit ARM.

Owns: fetching, unpacking, compiling and packing, and what need not be done again.
Must not know: what runs in the guest.

QEMU emulates a Pi's SPI and I2C controllers since version 9; Debian 12 has it in its backports.
It comes with all its libraries, and runs from where it is unpacked.
"""

from __future__ import annotations

import lzma
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from dataclasses import dataclass
from pathlib import Path

from build_x86 import SERIES
from debian_packages import Index, make_index
from pieces import (
    HERE,
    TREE,
    RigFailure,
    fingerprint,
    is_made,
    making,
    need,
    only_builder,
    piece,
    run,
)

_TOOLS = {
    "aarch64-linux-gnu-gcc": "gcc-aarch64-linux-gnu",
    "apt-get": "apt",
    "cpio": "cpio",
    "dpkg-deb": "dpkg",
    "dtc": "device-tree-compiler",
}
_KERNEL = f"linux-image-{SERIES}-arm64:arm64"
_DEVICE_TREE = "broadcom/bcm2837-rpi-3-b.dtb"
#: In the order in which they load; the other drivers are built in. The last one resets.
_MODULES = ("spi-bcm2835", "i2c-bcm2835", "i2c-dev", "bcm2835_wdt")
#: The interpreter of Debian 12, and what compiles an extension for it.
PYTHON = "3.11"
_RUNTIME = (f"python{PYTHON}:arm64", "libstdc++6:arm64", "busybox-static:arm64")
_HEADERS = (f"libpython{PYTHON}-dev:arm64",)
#: Of the project's requirements, what the guest needs. The versions are those that run here.
_WHEELS = (
    *("gpiod", "msgspec", "pyzmq", "rich", "smbus2"),
    *("hypothesis", "pytest", "pytest-randomly", "pytest-timeout"),
)
#: Names of the platform in wheels, for systems as old as Debian 12 and older.
_PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_26_aarch64", "manylinux_2_28_aarch64")
#: Of the packages, what no program needs.
_LEFT_OUT = ("config-3*", "idlelib", "lib2to3", "ensurepip", "*.a", "doc", "__pycache__")
_PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
_TREE_PARTS = ("config", "daemon", "hal", "tests", "pyproject.toml")


@dataclass(frozen=True)
class Pi:
    """What a run needs, built."""

    emulator: Path
    kernel: Path
    device_tree: Path
    initrd: Path


def build() -> Pi:
    """All of it. Raises: RigFailure."""
    need(_TOOLS)
    with only_builder():
        fetched = packages()
        kernel = fetched / "kernel"
        tree = device_tree(kernel / Path(_DEVICE_TREE).name)
        return Pi(fetched / "emulator", kernel / "vmlinuz", tree, initial_files(fetched))


def packages() -> Path:
    """The emulator, the kernel and what runs on it, each in a folder of its own."""
    folder = piece("pi-packages", fingerprint([Path(__file__), HERE / "debian_packages.py"]))
    if is_made(folder):
        return folder
    with making(folder):
        index = make_index(folder / "index", ("amd64", "arm64"))
        _fetch(index, folder)
        _install_wheels(folder / "site")
        _install_spidev(folder / "site", folder / "headers")
        for no_longer_needed in ("index", "headers"):
            shutil.rmtree(folder / no_longer_needed)
    return folder


def _fetch(index: Index, folder: Path) -> None:
    emulator = index.closure(["qemu-system-arm"], "amd64", backports=True)
    index.unpack(emulator, folder / "emulator")
    found = re.search(r"Depends: (linux-image-\S+)", index.depends(_KERNEL))
    if found is None:
        raise RigFailure(f"the package sources of this machine have no Linux {SERIES} for arm64")
    _keep_of_the_kernel(index.unpack([found.group(1)], folder / "unpacked"), folder / "kernel")
    for name, wanted in (("runtime", _RUNTIME), ("headers", _HEADERS)):
        index.unpack(index.closure(wanted, "arm64", backports=False), folder / name)


def _keep_of_the_kernel(unpacked: Path, folder: Path) -> None:
    """Its image, the tree of the Pi 3 and our modules: a small part of the package."""
    (folder / "modules").mkdir(parents=True)
    (image,) = unpacked.glob("boot/vmlinuz-*")
    shutil.move(image, folder / "vmlinuz")
    (tree,) = unpacked.rglob(_DEVICE_TREE)
    shutil.move(tree, folder / tree.name)
    for name in _MODULES:
        (found,) = unpacked.rglob(f"{name}.ko.xz")
        (folder / f"modules/{name}.ko").write_bytes(lzma.decompress(found.read_bytes()))
    (folder / "modules/order").write_text("".join(f"{name}.ko\n" for name in _MODULES))
    shutil.rmtree(unpacked)


def _install_wheels(site: Path) -> None:
    platforms = [f"--platform={name}" for name in _PLATFORMS]
    run(
        *(*_PIP, "install", "--target", site, "--no-compile", "--only-binary=:all:"),
        *("--implementation=cp", f"--python-version={PYTHON}", *platforms, *_WHEELS),
    )


def _install_spidev(site: Path, headers: Path) -> None:
    """spidev has no wheel: it is one file of C, compiled here for there."""
    with tempfile.TemporaryDirectory() as fetch:
        run(*_PIP, "download", "--no-deps", "--no-binary=:all:", "--dest", fetch, "spidev>=3.6")
        (archive,) = Path(fetch).glob("*.tar.gz")
        with tarfile.open(archive) as packed:
            packed.extractall(fetch, filter="data")
        (source,) = Path(fetch).rglob("spidev_module.c")
        run(
            *("aarch64-linux-gnu-gcc", f"--sysroot={headers}", "-shared", "-fPIC", "-O2"),
            f"-I{headers}/usr/include/python{PYTHON}",
            *("-o", site / "spidev.so", source),
        )
        # What makes it an installed package: its name and version, as source archives have them.
        about = site / f"{archive.name.removesuffix('.tar.gz')}.dist-info"
        about.mkdir()
        shutil.copy(source.parent / "PKG-INFO", about / "METADATA")


def device_tree(original: Path) -> Path:
    """Debian's tree of the Pi 3 with our changes behind it, compiled."""
    changes = HERE / "pi.dts"
    folder = piece("pi-device-tree", fingerprint([original, changes]))
    compiled = folder / "pi.dtb"
    if is_made(folder):
        return compiled
    with making(folder):
        # -q: warnings are about the tree that we were given.
        text = run("dtc", "-q", "-I", "dtb", "-O", "dts", original)
        source = folder / "pi.dts"
        source.write_text(text + "\n" + changes.read_text())
        run("dtc", "-q", "-I", "dts", "-O", "dtb", "-o", compiled, source)
    return compiled


def initial_files(fetched: Path) -> Path:
    """What does not change between runs, packed: interpreter, packages, modules, first process."""
    init = HERE / "pi_init.sh"
    folder = piece("pi-initrd", fetched.name + fingerprint([init]))
    packed = folder / "initrd.img"
    if is_made(folder):
        return packed
    with making(folder):
        files = folder / "files"
        left_out = shutil.ignore_patterns(*_LEFT_OUT)
        shutil.copytree(fetched / "runtime", files, symlinks=True, ignore=left_out)
        shutil.copytree(fetched / "site", files / "site", ignore=left_out)
        (files / "usr/bin/python").symlink_to(f"python{PYTHON}")
        (files / "bin/sh").symlink_to("busybox")
        _compile(files / f"usr/lib/python{PYTHON}", files / "site")
        shutil.copy(init, files / "init")
        shutil.copytree(fetched / "kernel/modules", files / "modules")
        pack(files, packed)
        shutil.rmtree(files)
    return packed


def _compile(*folders: Path) -> None:
    """Bytecode for all modules, or an emulated processor makes it at every start of Python.

    Only the same version of Python makes the right one; another one's is of no use there.
    """
    if sys.version_info[:2] == tuple(map(int, PYTHON.split("."))):
        quietly = ("-m", "compileall", "-q", "--invalidation-mode=unchecked-hash")
        subprocess.run([sys.executable, *quietly, *folders], capture_output=True, check=False)


def tree_files(folder: Path, command: str) -> Path:
    """The working tree as it is now, and the command, packed."""
    files = folder / "files"
    left_out = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in _TREE_PARTS:
        part = TREE / name
        if part.is_dir():
            shutil.copytree(part, files / "etd" / name, ignore=left_out)
        else:
            shutil.copy(part, files / "etd" / name)
    (files / "command").write_text(command)
    packed = folder / "tree.img"
    pack(files, packed)
    shutil.rmtree(files)
    return packed


def pack(files: Path, packed: Path) -> None:
    """An archive as the kernel unpacks it into memory. Several, one behind the other, are one."""
    listed = "\n".join(str(path.relative_to(files)) for path in sorted(files.rglob("*")))
    with packed.open("wb") as archive:
        subprocess.run(
            ["cpio", "--quiet", "-o", "-H", "newc", "--owner=0:0"],
            input=listed.encode(),
            cwd=files,
            stdout=archive,
            stderr=subprocess.PIPE,
            check=True,
        )


if __name__ == "__main__":
    try:
        print(build())
    except (RigFailure, subprocess.SubprocessError) as failure:
        sys.exit(f"the kernel rig cannot be built: {failure}")
