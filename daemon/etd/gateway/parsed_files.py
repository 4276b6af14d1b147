"""Calibration files as they were parsed, until they change on disk.

Owns: when a file is the same as before, and how many are kept. Must not know: names, folders, what
a calibration allows.

A large one takes tens of milliseconds to parse, in which the gateway answers no client.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from etd.files.calibration import calibration_of_bytes
from etd.files.calibration_reading import bytes_of
from etd.files.trust import open_own
from etd.protocol.calibration import Calibration
from etd.protocol.errors import FileError

#: A few hundred kilobytes each.
MOST: Final = 32


class ParsedFiles:
    def __init__(self) -> None:
        #: The one that was asked for last is the last one.
        self._kept: dict[Path, tuple[tuple[int, int, int], Calibration]] = {}

    def calibration(self, path: Path) -> Calibration:
        """Raises: FileError."""
        seen = _seen(path)
        kept = self._kept.pop(path, None)
        if kept is None or seen is None or kept[0] != seen:
            kept = (seen or (0, 0, 0), _read(path))
        if seen is not None:
            self._kept[path] = kept
            if len(self._kept) > MOST:
                del self._kept[next(iter(self._kept))]
        return kept[1]


def _read(path: Path) -> Calibration:
    """As the engine opens it: past no link, and no larger than it takes. Raises: FileError."""
    try:
        data = bytes_of(path, open_own(path, os.O_RDONLY))
    except OSError as error:
        raise FileError(
            str(path), "", f"it cannot be read: {error.strerror}", "a calibration file"
        ) from error
    return calibration_of_bytes(path, data)


def _seen(path: Path) -> tuple[int, int, int] | None:
    """What differs where the file is another one, or was written again."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns, found.st_size
