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
from dataclasses import dataclass
from pathlib import Path

from build_x86 import BUILD, HERE, SERIES, TREE, RigFailure, fingerprint, is_done, need, run
from debian_packages import Index, make_index

PI = BUILD / "pi"
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
_PYTHON = "3.11"
_RUNTIME = (f"python{_PYTHON}:arm64", "libstdc++6:arm64", "busybox-static:arm64")
_HEADERS = (f"libpython{_PYTHON}-dev:arm64",)
#: Of the project's requirements, what the guest needs. The versions are those that run here.
_WHEELS = (
    *("gpiod", "msgspec", "pyzmq", "rich", "smbus2"),
    *("hypothesis", "pytest", "pytest-randomly", "pytest-timeout"),
)
#: Names of the platform in wheels, for systems as old as Debian 12 and older.
_PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_26_aarch64", "manylinux_2_28_aarch64")
_LEFT_OUT = ("config-*", "test", "idlelib", "lib2to3", "ensurepip", "*.a", "__pycache__")
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
    PI.mkdir(parents=True, exist_ok=True)
    mark = fingerprint([Path(__file__), HERE / "debian_packages.py"])
    folders = [PI / name for name in ("emulator", "kernel", "runtime", "headers", "site")]
    if not is_done(PI, mark):
        _fetch(make_index(PI / "index", ("amd64", "arm64")))
        _wheels(PI / "site")
        (PI / "done").write_text(mark)
    emulator, kernel, _, _, _ = folders
    (image,) = (kernel / "boot").glob("vmlinuz-*")
    return Pi(emulator, image, device_tree(kernel), initial_files(mark))


def _fetch(index: Index) -> None:
    # qemu-system-arm of backports; its libraries come from wherever they are.
    emulator = index.closure(["qemu-system-arm"], "amd64", backports=True)
    index.unpacked(emulator, PI / "emulator")
    found = re.search(r"Depends: (linux-image-\S+)", index.depends(_KERNEL))
    if found is None:
        raise RigFailure(f"the package sources of this machine have no Linux {SERIES} for arm64")
    index.unpacked([found.group(1)], PI / "kernel")
    index.unpacked(index.closure(_RUNTIME, "arm64", backports=False), PI / "runtime")
    index.unpacked(index.closure(_HEADERS, "arm64", backports=False), PI / "headers")


def _wheels(site: Path) -> None:
    """The Python packages for the guest; spidev, which has no wheel, is compiled."""
    shutil.rmtree(site, ignore_errors=True)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
    platforms = [f"--platform={name}" for name in _PLATFORMS]
    run(
        *(*pip, "install", "--target", site, "--no-compile", "--only-binary=:all:"),
        *("--implementation=cp", f"--python-version={_PYTHON}", *platforms, *_WHEELS),
    )
    fetch = PI / "spidev"
    shutil.rmtree(fetch, ignore_errors=True)
    run(*pip, "download", "--no-deps", "--no-binary=:all:", "--dest", fetch, "spidev>=3.6")
    (archive,) = fetch.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(fetch, filter="data")
    (source,) = fetch.rglob("spidev_module.c")
    headers = PI / "headers"
    run(
        *("aarch64-linux-gnu-gcc", f"--sysroot={headers}", "-shared", "-fPIC", "-O2"),
        f"-I{headers}/usr/include/python{_PYTHON}",
        *("-o", site / "spidev.so", source),
    )
    # What makes it an installed package: its name and version, as every source archive has them.
    about = site / f"{archive.name.removesuffix('.tar.gz')}.dist-info"
    about.mkdir()
    shutil.copy(source.parent / "PKG-INFO", about / "METADATA")


def device_tree(kernel: Path) -> Path:
    """Debian's tree of the Pi 3 with our changes behind it, compiled."""
    (original,) = kernel.rglob(_DEVICE_TREE)
    changes = HERE / "pi.dts"
    folder = PI / "device-tree"
    mark = fingerprint([original, changes])
    compiled = folder / "pi.dtb"
    if is_done(folder, mark):
        return compiled
    folder.mkdir(exist_ok=True)
    # -q: warnings are about the tree that we were given.
    text = run("dtc", "-q", "-I", "dtb", "-O", "dts", original)
    source = folder / "pi.dts"
    source.write_text(text + "\n" + changes.read_text())
    run("dtc", "-q", "-I", "dts", "-O", "dtb", "-o", compiled, source)
    (folder / "done").write_text(mark)
    return compiled


def initial_files(mark: str) -> Path:
    """What does not change between runs, packed: interpreter, packages, modules, first process."""
    init = HERE / "pi_init.sh"
    folder = PI / "initrd"
    packed = folder / "initrd.img"
    mark += fingerprint([init])
    if is_done(folder, mark):
        return packed
    shutil.rmtree(folder, ignore_errors=True)
    files = folder / "files"
    shutil.copytree(
        PI / "runtime",
        files,
        symlinks=True,
        ignore=shutil.ignore_patterns(*_LEFT_OUT, "doc", "done"),
    )
    shutil.copytree(PI / "site", files / "site", ignore=shutil.ignore_patterns("__pycache__"))
    (files / "usr/bin/python").symlink_to(f"python{_PYTHON}")
    (files / "bin/sh").symlink_to("busybox")
    shutil.copy(init, files / "init")
    _copy_modules(files / "modules")
    pack(files, packed)
    shutil.rmtree(files)
    (folder / "done").write_text(mark)
    return packed


def _copy_modules(folder: Path) -> None:
    folder.mkdir()
    for name in _MODULES:
        (found,) = (PI / "kernel").rglob(f"{name}.ko.xz")
        (folder / f"{name}.ko").write_bytes(lzma.decompress(found.read_bytes()))
    (folder / "order").write_text("".join(f"{name}.ko\n" for name in _MODULES))


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
