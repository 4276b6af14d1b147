"""The bytes of a file that is named from outside, without waiting and without an end in sight.

Owns: that it is a regular file, and that no more is read than such a file may have. Must not know:
what is in it.

A pipe to which nothing is written would be waited for without an end, and a device may have none.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from etd_hal.errors import FileError

#: Windows, where the client runs too, has no pipes among its files.
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0)


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Raises: FileError (no regular file, or a longer one), OSError."""
    with open(path, "rb", opener=_opened) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise FileError(str(path), "", "it is a pipe, a device or a socket", "name a file")
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise FileError(
            str(path),
            "",
            f"it has more than {most_bytes} bytes",
            "no file of this kind has so many",
        )
    return data


def _opened(path: str, flags: int) -> int:
    return os.open(path, flags | _WITHOUT_WAITING)
