"""Calibration files as they were read, until they change on disk.

Owns: when a file is the same as before, and how many are kept. Must not know: names, folders, how a
file is read, what a calibration allows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from etd.protocol.calibration import Calibration

#: A few hundred kilobytes each.
MOST: Final = 32
#: What differs where the file is another one, or was written again.
Seen = tuple[int, int, int, int]


class ParsedFiles:
    def __init__(self) -> None:
        #: The one that was asked for last is the last one.
        self._kept: dict[Path, tuple[Seen, Calibration]] = {}

    def get(self, path: Path) -> Calibration | None:
        """What it held, or None where it is to be read."""
        kept = self._kept.pop(path, None)
        if kept is None or kept[0] != seen(path):
            return None
        self._kept[path] = kept
        return kept[1]

    def keep(self, path: Path, as_seen: Seen | None, found: Calibration) -> None:
        """`as_seen`: before it was read; nothing is kept of what was not there."""
        self._kept.pop(path, None)
        if as_seen is not None:
            self._kept[path] = as_seen, found
        if len(self._kept) > MOST:
            del self._kept[next(iter(self._kept))]


def seen(path: Path) -> Seen | None:
    """None: it is not there."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns, found.st_ctime_ns, found.st_size
