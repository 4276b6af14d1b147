"""Checks before the work begins that the result file can be written at the end.

Owns: the check that no file is overwritten, that the folder is writable, and writing one that has
not come meanwhile. Must not know: what is written.
"""

from __future__ import annotations

from pathlib import Path

from etd.files.atomic_file import check_folder
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
        raise FileError(str(path), "", "it exists, and is not overwritten", "choose another name")
    if not path.parent.is_dir():
        raise FileError(str(path.parent), "", "there is no such folder", "create it first")
    try:
        check_folder(path.parent)
    except OSError as error:
        why = f"the folder is not writable ({error.strerror})"
        raise FileError(str(path.parent), "", why, "choose another folder") from error


def write_new_file(path: Path, text: str) -> None:
    """A file or a link that is there by now is not written to. Raises: FileError, OSError."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise FileError(
            str(path), "", "it exists, and is not overwritten", "choose another name"
        ) from error
