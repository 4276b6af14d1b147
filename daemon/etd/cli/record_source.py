"""The record that a command reads: one of the daemon's, by its name, or a file here.

Owns: the rule which of the two is meant, and fetching. Must not know: what is in a record.

A name is of letters, digits, hyphens and underscores, so that what has a separator or a suffix is a
file (`./p01`, `p01.jsonl`), and all else is a name.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from etd.cli.given_file import check_given
from etd.client import Display
from etd.files.paths import check_name
from etd.protocol.errors import FileError

WHOSE = "the record's name"
#: For `--help`.
WHICH = (
    "the name of a record of the daemon, or a file that `etd record get` has written: a file has a"
    " separator or a suffix (./p01, p01.jsonl)"
)


def is_file(which: str) -> bool:
    separators = filter(None, ("/", os.sep, os.altsep))
    return any(separator in which for separator in separators) or "." in which


@contextlib.contextmanager
def record_file(which: str, connect: Callable[[], Display]) -> Iterator[Path]:
    """The record as a file here: fetched, unless it is one already.

    Raises: FileError, Refused (`not_found`), DaemonGone.
    """
    if is_file(which):
        yield check_given(Path(which))
        return
    check_name(which, WHOSE)
    with tempfile.TemporaryDirectory(prefix="etd-record-") as folder:
        fetched = Path(folder) / f"{which}.jsonl"
        with connect() as display:
            fetch(display, which, fetched)
        yield fetched


def fetch(display: Display, name: str, path: Path) -> int:
    """Into a new file, or none: what fails leaves nothing. Returns its length in bytes.

    Raises: FileError, Refused (`not_found`), DaemonGone, OSError (the file exists).
    """
    with path.open("xb") as file, _gone_if_it_fails(path):
        size = display.fetch_record(name, file.write)
        if not size:
            raise FileError(
                name, "", "the daemon's file is empty: nothing was recorded", "another record"
            )
        return size


@contextlib.contextmanager
def _gone_if_it_fails(path: Path) -> Iterator[None]:
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):
            path.unlink()
        raise
