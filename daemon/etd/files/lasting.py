"""Whether what is written to a folder is still there after the next boot.

Owns: which file systems forget. Must not know: what is written.

A Raspberry Pi with a read-only root has an overlay in memory on it: all can be written, and nothing
of it stays.
"""

from __future__ import annotations

import os
from pathlib import Path

_FORGET = {
    "tmpfs": "is in memory",
    "ramfs": "is in memory",
    "overlay": "is on an overlay, as that of a read-only root",
}
_MOUNTS = Path("/proc/self/mounts")


def why_forgotten(path: Path, mounts: Path = _MOUNTS) -> str | None:
    """Why this file may be gone after a boot, as a clause; None if nothing says so."""
    try:
        lines = mounts.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    real = Path(os.path.realpath(path))
    at, kind = "", ""
    for line in lines:
        point, found = _unescaped(line.split(" ")[1]), line.split(" ")[2]
        if real.is_relative_to(point) and len(point) >= len(at):
            at, kind = point, found
    return _FORGET.get(kind)


def _unescaped(point: str) -> str:
    """The kernel writes a space as \\040."""
    return point.encode().decode("unicode_escape")
