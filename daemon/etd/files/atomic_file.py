"""A file that is written whole or not at all.

Owns: the temporary file, the rename, that both are on the disk, and whether a folder takes one.
Must not know: what is in it.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path


def check_folder(folder: Path) -> None:
    """A new file could be written there now; none is left. Raises: OSError."""
    with tempfile.TemporaryFile(dir=folder):
        pass


def write_atomically(path: Path, data: bytes, mode: int) -> None:
    """A power cut leaves the old file or the new one. Raises: OSError."""
    fd, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-")
    try:
        with os.fdopen(fd, "wb") as file:
            file.write(data)
            file.flush()
            os.fchmod(file.fileno(), mode)
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
