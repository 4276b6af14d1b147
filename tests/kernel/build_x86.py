"""What the x86 guest is made of: a stock Debian kernel, our module, an initial file system.

Owns: fetching, unpacking, compiling and packing, and what need not be done again.
Must not know: what runs in the guest.

Everything comes from the package sources that this machine already has, is only unpacked (see
pieces.py), and nothing of it is installed.
"""

from __future__ import annotations

import lzma
import re
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pieces import HERE, RigFailure, fingerprint, is_made, making, need, only_builder, piece, run

#: What the module is written for: the kernel's internal interfaces move.
SERIES = "6.12"
#: The kernel's own modules that the guest needs; what they need is found.
_STOCK_MODULES = ("9pnet_virtio", "9p", "overlay", "i2c-dev", "virtio_pci")
TOOLS = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "cpio": "cpio",
    "gcc-12": "gcc-12",
    "make": "make",
    "xz": "xz-utils",
    "dpkg-deb": "dpkg",
    "modinfo": "kmod",
}


def kernel_release() -> str:
    """The newest kernel of the series, as the package sources know it: 6.12.117+deb12."""
    for name in (f"linux-headers-{SERIES}-amd64", "linux-headers-amd64"):
        shown = subprocess.run(
            ["apt-cache", "depends", name], capture_output=True, text=True, check=False
        ).stdout
        found = re.search(rf"linux-headers-({re.escape(SERIES)}\.[^ ]*)-amd64\b", shown)
        if found:
            return found.group(1)
    raise RigFailure(
        f"the package sources of this machine have no Linux {SERIES} for amd64:"
        " run apt-get update, or add Debian's security or backports section"
    )


def unpacked(release: str) -> Path:
    """The kernel's packages, unpacked: /boot, /lib/modules and /usr/src below one folder."""
    root = piece("debian", release)
    packages = (
        f"linux-image-{release}-amd64",
        f"linux-headers-{release}-amd64",
        f"linux-headers-{release}-common",
        f"linux-kbuild-{release}",
    )
    if is_made(root):
        return root
    with making(root):
        fetch = root / "packages"
        fetch.mkdir()
        # Not as root's unprivileged helper, which may not write here.
        run("apt-get", "download", "-o", "APT::Sandbox::User=root", *packages, cwd=fetch)
        for package in fetch.glob("*.deb"):
            run("dpkg-deb", "-x", package, root)
        shutil.rmtree(fetch)
        _mend_headers(root, release)
    return root


def _mend_headers(root: Path, release: str) -> None:
    """The headers expect to be installed; and with a vmlinux they would want type information."""
    headers = root / f"usr/src/linux-headers-{release}-amd64"
    common = root / f"usr/src/linux-headers-{release}-common"
    (headers / "vmlinux").unlink(missing_ok=True)
    (headers / "Makefile").write_text(f"include {common}/Makefile\n")


def module(root: Path, release: str) -> Path:
    """Our module, compiled against the headers."""
    sources = [path for path in (HERE / "modules").iterdir() if path.is_file()]
    folder = piece("x86-module", release + fingerprint(sources))
    if is_made(folder):
        return folder / "rig.ko"
    with making(folder):
        for source in sources:
            shutil.copy(source, folder)
        headers = root / f"usr/src/linux-headers-{release}-amd64"
        run("make", "-s", "-C", headers, f"M={folder}", "modules")
        run("strip", "--strip-debug", folder / "rig.ko")
    return folder / "rig.ko"


def _with_dependencies(name: str, known: dict[str, Path]) -> Iterator[Path]:
    """A module's files in the order in which they load; built-in ones are not known."""
    path = known.get(name.replace("-", "_"))
    if path is None:
        return
    for needed in run("modinfo", "-F", "depends", path).strip().split(","):
        if needed:
            yield from _with_dependencies(needed, known)
    yield path


def _stock_modules(root: Path, release: str) -> list[Path]:
    folder = root / f"lib/modules/{release}-amd64/kernel"
    known = {path.name.split(".")[0].replace("-", "_"): path for path in folder.rglob("*.ko*")}
    found: list[Path] = []
    for name in _STOCK_MODULES:
        found += [path for path in _with_dependencies(name, known) if path not in found]
    return found


def initial_files(root: Path, release: str, ours: Path) -> Path:
    """The initial file system, packed."""
    init = HERE / "guest_init.sh"
    folder = piece("x86-initrd", release + fingerprint([init, ours, Path(__file__)]))
    packed = folder / "initrd.img"
    if is_made(folder):
        return packed
    with making(folder):
        files = folder / "files"
        for name in ("bin", "modules"):
            (files / name).mkdir(parents=True)
        shutil.copy(str(shutil.which("busybox")), files / "bin/busybox")
        shutil.copy(init, files / "init")
        (files / "init").chmod(stat.S_IRWXU)
        _put_modules(files / "modules", [*_stock_modules(root, release), ours])
        packed.write_bytes(_archive(files))
        shutil.rmtree(files)
    return packed


def _put_modules(folder: Path, modules: list[Path]) -> None:
    """The modules, unpacked, and a list of the order in which they are loaded."""
    order = []
    for path in modules:
        name = path.name.removesuffix(".xz")
        data = path.read_bytes()
        (folder / name).write_bytes(lzma.decompress(data) if path.suffix == ".xz" else data)
        order.append(name)
    (folder / "order").write_text("\n".join(order) + "\n")


def _archive(files: Path) -> bytes:
    """The folder as the kernel wants its initial file system."""
    listed = "\n".join(str(path.relative_to(files)) for path in files.rglob("*"))
    return subprocess.run(
        ["cpio", "--quiet", "-o", "-H", "newc"],
        input=listed.encode(),
        cwd=files,
        capture_output=True,
        check=True,
    ).stdout


def spidev_package(python: str) -> Path:
    """The spidev package, compiled for the interpreter that runs in the guest."""
    folder = piece("python", run(python, "-c", "import sys; print(sys.version)"))
    if not is_made(folder):
        with making(folder):
            pip = (python, "-m", "pip", "--disable-pip-version-check", "--quiet")
            run(*pip, "install", "--no-deps", "--target", folder, "spidev>=3.6")
    return folder


@cache
def build(python: str) -> tuple[Path, Path]:
    """The kernel and the initial file system, looked up once a run. Raises: RigFailure."""
    need(TOOLS)
    release = kernel_release()
    with only_builder():
        root = unpacked(release)
        initrd = initial_files(root, release, module(root, release))
        spidev_package(python)
    return root / f"boot/vmlinuz-{release}-amd64", initrd


if __name__ == "__main__":
    try:
        for built in build(sys.executable):
            print(built)
    except RigFailure as failure:
        sys.exit(f"the kernel rig cannot be built: {failure}")
