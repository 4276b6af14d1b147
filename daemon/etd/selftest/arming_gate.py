"""Whether the last self-test allows arming now.

Owns: reading the report again only when its file has changed. Must not know: what a report must
contain.
"""

from __future__ import annotations

from pathlib import Path

from etd.selftest.report import arming_refusal
from etd.selftest.subject import Subject

#: Identifies a version of the file: reports are replaced, never modified.
_FileState = tuple[int, int, int] | int


class SelftestGate:
    """Called, it returns the reason for which arming is refused, or None."""

    def __init__(self, path: Path, now: Subject) -> None:
        self._path = path
        self._now = now
        self._seen = self._look()
        self._why = arming_refusal(path, now)

    def __call__(self) -> str | None:
        seen = self._look()
        if seen != self._seen:
            # The state is taken before reading: a change in between is detected the next time.
            self._seen = seen
            self._why = arming_refusal(self._path, self._now)
        return self._why

    def _look(self) -> _FileState:
        """The file's state; the error number if it cannot be accessed."""
        try:
            found = self._path.stat()
        except OSError as error:
            return error.errno or 0
        return found.st_ino, found.st_mtime_ns, found.st_size
