"""Built pieces of the guests: where they are kept, when they are still good, who makes them.

Owns: the folder outside the clone, names by content, one builder at a time, forgetting.
Must not know: what a piece is made of.

A piece lies in `$XDG_CACHE_HOME/etd-kernel` (or `~/.cache/etd-kernel`), in a folder named after
all that it was made from: a fresh clone finds it there, and two clones that differ do not undo one
another's work. What a run leaves behind lies in the clone, in `build/kernel`.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).parent
TREE = HERE.parent.parent
BUILD = TREE / "build" / "kernel"
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "etd-kernel"
#: So many of a kind stay: of a few clones, or of before an update.
_KEPT = 4


class RigFailure(Exception):
    """The rig cannot be built or started: why, and what to do."""


def run(*command: str | Path, cwd: Path | None = None, env: dict[str, str] | None = None) -> str:
    """Run a program to its end. Raises: RigFailure with what it said."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=None if env is None else os.environ | env,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        said = (done.stdout + done.stderr).strip()[-3000:]
        raise RigFailure(f"{' '.join(map(str, command))} failed ({done.returncode}):\n{said}")
    return done.stdout


def need(tools: dict[str, str]) -> None:
    """Raises: RigFailure that names all packages that are missing."""
    missing = sorted({package for tool, package in tools.items() if shutil.which(tool) is None})
    if missing:
        raise RigFailure(f"packages are missing: sudo apt-get install {' '.join(missing)}")


def fingerprint(paths: Sequence[Path]) -> str:
    """Of the names and the contents of files."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def piece(name: str, made_from: str) -> Path:
    """The folder of a piece; whether it is there is another matter."""
    return CACHE / name / hashlib.sha256(made_from.encode()).hexdigest()[:16]


def is_made(folder: Path) -> bool:
    """Whether the piece is there, whole. Asking counts as using it."""
    done = folder / "made"
    if not done.exists():
        return False
    os.utime(done)
    return True


@contextmanager
def making(folder: Path) -> Iterator[Path]:
    """An empty folder for the piece, which is good once this ends without an error."""
    told = f"kernel rig: making {folder.parent.name}, once; a kernel takes many minutes"
    print(told, file=sys.stderr, flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    yield folder
    (folder / "made").touch()
    _forget_older(folder.parent)


def _forget_older(kind: Path) -> None:
    """Of each kind the last used stay."""
    used = sorted(kind.glob("*/made"), key=lambda made: made.stat().st_mtime)
    for made in used[:-_KEPT]:
        shutil.rmtree(made.parent)


@contextmanager
def only_builder() -> Iterator[None]:
    """Wait until nobody else builds: two at once would write into the same folders."""
    CACHE.mkdir(parents=True, exist_ok=True)
    with (CACHE / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
