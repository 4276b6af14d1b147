"""Debian packages of other processors and of backports, without a change to this machine.

Owns: a private package index made from the machine's own package sources, and folders into which
packages are unpacked with all that they need. Must not know: what the packages are for.

Nothing is installed: the index, the packages and what is in them stay in one folder.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pieces import RigFailure, run

#: Sections, by what stands behind the release's name. Without security updates it works as well.
_SECTIONS = ("", "-updates", "-security", "-backports")
_KEYS = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
#: A package of Debian's index, as `apt-get --simulate` names one that it would install.
_WOULD_INSTALL = re.compile(r"^Inst (\S+) (?:\[\S+\] )?\((\S+) .*\[(\w+)\]\)", re.MULTILINE)


@dataclass(frozen=True)
class Index:
    """The package index below `folder`, of one release and some architectures."""

    folder: Path
    release: str

    @property
    def _environment(self) -> dict[str, str]:
        return {"APT_CONFIG": str(self.folder / "apt.conf")}

    def closure(self, packages: Sequence[str], architecture: str, *, backports: bool) -> list[str]:
        """These packages and all that they need, each as apt's NAME=VERSION. Raises: RigFailure."""
        target = f"{self.release}-backports" if backports else self.release
        told = run(
            *("apt-get", "install", "--simulate", f"--target-release={target}", *packages),
            env=self._environment,
        )
        return [
            f"{name}={version}"
            for name, version, built_for in _WOULD_INSTALL.findall(told)
            if built_for in (architecture, "all")
        ]

    def depends(self, package: str) -> str:
        """What apt says that a package depends on."""
        return run("apt-cache", "depends", package, env=self._environment)

    def unpack(self, packages: Sequence[str], into: Path) -> Path:
        """Fetch and unpack exactly these into a new folder. Raises: RigFailure."""
        fetch = into / "packages"
        fetch.mkdir(parents=True)
        run("apt-get", "download", *packages, cwd=fetch, env=self._environment)
        for package in sorted(fetch.glob("*.deb")):
            run("dpkg-deb", "-x", package, into)
        shutil.rmtree(fetch)
        return into


def make_index(folder: Path, architectures: Sequence[str]) -> Index:
    """Ask the servers that this machine asks already what they have. Raises: RigFailure."""
    release = _release()
    for name in ("lists/partial", "archives/partial"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    # Nothing counts as installed: what a package needs is then complete.
    (folder / "status").write_text("")
    (folder / "sources.list").write_text("\n".join(_sources(release, architectures)) + "\n")
    listed = "".join(f' "{architecture}";' for architecture in architectures)
    (folder / "apt.conf").write_text(
        f'Dir::State "{folder}";\n'
        f'Dir::State::status "{folder}/status";\n'
        f'Dir::Cache "{folder}";\n'
        f'Dir::Etc::sourcelist "{folder}/sources.list";\n'
        'Dir::Etc::sourceparts "/dev/null";\n'
        'Dir::Etc::preferences "/dev/null";\n'
        'Dir::Etc::preferencesparts "/dev/null";\n'
        f"APT::Architectures {{{listed} }};\n"
        'APT::Install-Recommends "false";\n'
        # Not as root's unprivileged helper, which may not write here.
        'APT::Sandbox::User "root";\n'
        'Acquire::Languages "none";\n'
    )
    index = Index(folder, release)
    run("apt-get", "update", "--error-on=any", env=index._environment)
    return index


def _release() -> str:
    """Debian's name for the release that this machine runs. Raises: RigFailure."""
    told = Path("/etc/os-release").read_text()
    found: dict[str, str] = dict(re.findall(r'^(\w+)="?([^"\n]*)"?$', told, re.MULTILINE))
    if found.get("ID") != "debian" or "VERSION_CODENAME" not in found:
        raise RigFailure(f"the Pi's packages are Debian's, and this is {found.get('ID')}")
    return found["VERSION_CODENAME"]


def _sources(release: str, architectures: Sequence[str]) -> list[str]:
    """Lines of a sources.list: the sections of this release, where this machine finds them."""
    known = _places()
    if release not in known:
        raise RigFailure(
            f"this machine knows no package source of {release}/main: run apt-get update"
        )
    # Backports lie beside the release, whether or not this machine uses them.
    known.setdefault(f"{release}-backports", known[release])
    options = f"arch={','.join(architectures)}"
    if _KEYS.exists():
        options += f" signed-by={_KEYS}"
    names = [f"{release}{section}" for section in _SECTIONS]
    return [f"deb [{options}] {known[name]} {name} main" for name in names if name in known]


def _places() -> dict[str, str]:
    """Where this machine finds the main component of each section, by the section's name."""
    told = run(
        *("apt-get", "indextargets", "--format", "$(RELEASE) $(COMPONENT) $(REPO_URI)"),
        "Created-By: Packages",
    )
    fields = [line.split() for line in told.splitlines()]
    return {line[0]: line[2] for line in fields if len(line) == 3 and line[1] == "main"}
