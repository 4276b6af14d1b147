"""Whether the last self-test lets a board be armed now, asked again and again.

Owns: reading the report only when it is another than the last time. Must not know: who asks, what
a report must say.
"""

from __future__ import annotations

from pathlib import Path

from etd.selftest.report import arming_refusal
from etd.selftest.subject import Subject

#: What tells a file from the one before it: reports are replaced, never written into.
_FileState = tuple[int, int, int] | int


class SelftestGate:
    """Called, it answers the sentence for which arming is refused; None where nothing is."""

    def __init__(self, path: Path, now: Subject) -> None:
        self._path = path
        self._now = now
        self._seen = self._look()
        self._why = arming_refusal(path, now)

    def __call__(self) -> str | None:
        seen = self._look()
        if seen != self._seen:
            # Looked at before it is read: what comes in between is seen the next time.
            self._seen = seen
            self._why = arming_refusal(self._path, self._now)
        return self._why

    def _look(self) -> _FileState:
        """The file as it lies there; the error's number where there is none, or no way to it."""
        try:
            found = self._path.stat()
        except OSError as error:
            return error.errno or 0
        return found.st_ino, found.st_mtime_ns, found.st_size
