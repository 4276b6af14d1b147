"""The board's file as the engine was started with it: a copy for `etd safe`.

Owns: the copy, and when it still counts. Must not know: what a board is, what is made of the copy.

A file, or settings, that were edited while the engine ran may be such as cannot be read, or name
other lines. Those of the board that the engine had must be made safe all the same. Each start of an
engine makes it anew, and it counts until the computer is started again.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

from etd.files.atomic_file import write_atomically
from etd.files.paths import board_as_started_file
from etd.protocol.errors import FileError
from etd_hal.bounded_file import read_bounded
from etd_hal.tomlfile import MOST_BYTES

_BOOT = Path("/proc/sys/kernel/random/boot_id")
_HEAD = "# etd: "
#: A board's file, and the line before it.
_MOST_BYTES = 2 * MOST_BYTES
#: What is in the place of a copy and is none: there is none then, and nothing waits for it.
_NONE = (OSError, ValueError, KeyError, TypeError, RecursionError, FileError)


def keep_as_started(copy: Path, file: Path) -> None:
    """By the one engine that has this folder, before it has a line. The copy of an earlier start
    stays until this one is there whole: its lines were moved too.

    Raises: OSError.
    """
    of = json.dumps({"boot": _boot(), "file": str(file.resolve())})
    write_atomically(copy, f"{_HEAD}{of}\n".encode() + file.read_bytes(), mode=0o600)


def as_started(name: str, file: Path | None, given: Path | None) -> Path | None:
    """The copy, if it is of this boot, and of this `file` (None: of any). `given`: the daemon's own
    folder, if it has one.
    """
    with contextlib.suppress(*_NONE):
        copy = board_as_started_file(name, "linux", given)
        head, _, _ = read_bounded(copy, _MOST_BYTES).partition(b"\n")
        of = json.loads(head.decode().removeprefix(_HEAD))
        if of["boot"] == _boot() and (file is None or of["file"] == str(file)):
            return copy
    return None


def _boot() -> str:
    return _BOOT.read_text(encoding="ascii").strip()
