"""Checks, before the work begins, that a file can be written at its end.

Owns: that it takes no other file's place, and that its folder is there and takes it. Must not
know: what is written into it.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile

from etd.protocol.errors import FileError


def check_new_file(path: Path | None) -> None:
    """An existing file is never overwritten. Raises: FileError."""
    if path is None:
        return
    try:
        is_there = path.exists() or path.is_symlink()
    except OSError as error:
        why = f"it cannot be a file ({error.strerror})"
        raise FileError(str(path), "", why, "choose another name") from error
    if is_there:
        raise FileError(
            str(path), "", "it is there already, and is not written over", "choose another name"
        )
    if not path.parent.is_dir():
        raise FileError(str(path.parent), "", "there is no such folder", "make it first")
    try:
        with TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        why = f"nothing can be written there ({error.strerror})"
        raise FileError(str(path.parent), "", why, "choose another folder") from error
