"""What the guest has above this machine's root when systemd is its first process.

Owns: three folders that are laid over the root: systemd and udev as far as this machine lacks them,
what `make install` writes, and the units that run a command. Must not know: which command.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pieces import (
    CACHE,
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

_PACKAGES = ("systemd", "udev", "kmod")
TOOLS = {"apt-get": "apt", "dpkg-deb": "dpkg", "setpriv": "util-linux", "cc": "gcc"}
#: What `make install` takes from the tree.
_INSTALLED_FROM = ("daemon", "hal", "config", "systemd", "Makefile", "pyproject.toml", "README.md")
#: What ProtectHome= hides from a service, as `make install` has it too.
_HOMES = ("/home/", "/root/")
_UNITS = HERE / "service_units"
#: Nothing of this machine's own: no clock that is set, no sweeping of its temporary files.
_MASKED = ("timesyncd", "pstore", "logind", "update-utmp", "tmpfiles-setup")


def _packages() -> Path:
    """systemd and udev with what they need, unpacked: only what this machine has not, or older."""
    status = Path("/var/lib/dpkg/status")
    folder = piece("service-packages", fingerprint([status] if status.exists() else []))
    if is_made(folder):
        return folder
    with making(folder):
        fetched = folder / "fetched"
        (fetched / "partial").mkdir(parents=True)
        run(
            *("apt-get", "install", "--download-only", "--yes", "--no-install-recommends"),
            *("-o", f"Dir::Cache::archives={fetched}", "-o", "Debug::NoLocking=1"),
            # Not as root's unprivileged helper, which may not write here.
            *("-o", "APT::Sandbox::User=root", *_PACKAGES),
        )
        (folder / "root").mkdir()
        for package in sorted(fetched.glob("*.deb")):
            _unpack(package, folder / "root")
        shutil.rmtree(fetched)
    return folder


def _unpack(package: Path, root: Path) -> None:
    """A folder in a layer would hide a link of the same name: /lib is one into /usr."""
    apart = root.parent / "apart"
    run("dpkg-deb", "-x", package, apart)
    for name in ("bin", "sbin", "lib", "lib64"):
        if (apart / name).is_dir() and Path("/", name).is_symlink():
            shutil.copytree(apart / name, root / "usr" / name, symlinks=True, dirs_exist_ok=True)
            shutil.rmtree(apart / name)
    shutil.copytree(apart, root, symlinks=True, dirs_exist_ok=True)
    shutil.rmtree(apart)


def _tree_files() -> Iterator[Path]:
    for name in _INSTALLED_FROM:
        path = TREE / name
        yield from path.rglob("*") if path.is_dir() else (path,)


def _python() -> str:
    """An interpreter that a service can see, and that spidev can be compiled for."""
    for path in ("/usr/bin/python3", "/usr/local/bin/python3", os.path.realpath(sys.executable)):
        real = os.path.realpath(path)
        if Path(real).exists() and not real.startswith(_HOMES):
            headers = run(path, "-c", "import sysconfig; print(sysconfig.get_path('include'))")
            if Path(headers.strip(), "Python.h").exists():
                return path
    raise RigFailure(
        "no Python with its headers outside of /home and /root:"
        " sudo apt-get install python3-dev python3-venv"
    )


def _installed() -> Path:
    """What `make install` writes."""
    files = [path for path in _tree_files() if path.is_file() and "__pycache__" not in path.parts]
    folder = piece("service-installed", _python() + fingerprint(files))
    if is_made(folder):
        return folder
    with making(folder):
        root = folder / "root"
        run("make", "-s", "install", f"DESTDIR={root}", f"PYTHON={_python()}", cwd=TREE)
    return folder


def _units() -> Path:
    """The units that run a command in the guest."""
    files = [path for path in _UNITS.rglob("*") if path.is_file()]
    folder = piece("service-units", fingerprint(files))
    if is_made(folder):
        return folder
    with making(folder):
        for path in files:
            copy = folder / "root/etc/systemd/system" / path.relative_to(_UNITS)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    return folder


@cache
def build() -> list[Path]:
    """The folders to lay over the root, the uppermost first; once a run. Raises: RigFailure."""
    need(TOOLS)
    before = os.umask(0o022)
    try:
        with only_builder():
            return [made / "root" for made in (_units(), _installed(), _packages())]
    finally:
        os.umask(before)


def boot_words(layers: list[Path]) -> list[str]:
    """What the guest's first program, its kernel and systemd are told."""
    return [
        f"rig.layers={':'.join(str(layer.relative_to(CACHE)) for layer in layers)}",
        "rig.first=/lib/systemd/systemd",
        *("systemd.unit=rig.target", "systemd.show_status=no", "fstab=no"),
        *(f"systemd.mask=systemd-{name}.service" for name in _MASKED),
    ]
