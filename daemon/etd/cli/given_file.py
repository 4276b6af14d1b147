"""A file that a command is given to read.

Owns: that it is a regular one. Must not know: what is in it.

A pipe would be waited at for ever, without a word, and a device has no end.
"""

from __future__ import annotations

from pathlib import Path

from etd.protocol.errors import FileError


def check_given(path: Path, advice: str = "name a file") -> Path:
    """What is not there is left to who reads it. Raises: FileError."""
    if path.exists() and not path.is_file():
        what = "it is a folder" if path.is_dir() else "it is a pipe, a device or a socket"
        raise FileError(str(path), "", what, advice)
    return path
