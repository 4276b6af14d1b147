"""The files of a folder that are called by a name of the protocol, and how large they are.

Owns: which these are. Must not know: what is in them, who asks.

A file can have any name that the file system takes. One that no request can name is left out: it
would stand in replies and in logs, and bytes that are no UTF-8 cannot be encoded there.
"""

from __future__ import annotations

import os
import re
from itertools import islice
from pathlib import Path

from etd.protocol.text import NAME_PATTERN

_NAME = re.compile(NAME_PATTERN)


def names_in(folder: Path, suffix: str, most_looked_at: int | None = None) -> list[str]:
    """Sorted, without the suffix. Empty for a folder that is not there or cannot be read."""
    try:
        with os.scandir(folder) as entries:
            files = [entry.name for entry in islice(entries, most_looked_at)]
    except OSError:
        return []
    names = [file.removesuffix(suffix) for file in files if file.endswith(suffix)]
    return sorted(filter(_NAME.fullmatch, names))


def size_of(path: Path) -> int:
    """Of a link its own. 0, if it has been deleted meanwhile."""
    try:
        return path.lstat().st_size
    except FileNotFoundError:
        return 0
