"""The records on disk, each a file of JSON lines with the record's name.

Owns: their folder, names, sizes and owners, what all of them may take, and reading a piece of one.
Must not know: what else is in a record, who asks.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from etd.files.named_files import names_in, size_of
from etd.files.paths import make_own
from etd.files.trust import open_own
from etd.gateway.record_file import DISK_SHORT, MOST_BYTES, RESERVE_BYTES, Disk, RecordFile
from etd.protocol.errors import FileError, Refused
from etd.protocol.facts import RecordFacts
from etd.record import lines

#: All records together.
MOST_IN_ALL_BYTES = 4 * MOST_BYTES
#: However short: their list is one reply.
MOST_RECORDS = 1_000
#: A reply of 48 KiB with the rest of its keys stays within the size of a message.
PIECE_BYTES = 36 * 1024
_SUFFIX = ".jsonl"


class RecordStore:
    def __init__(self, state_dir: Path, disk: Disk | None = None) -> None:
        self._folder = state_dir / "records"
        self._disk = disk or Disk()
        self._sizes: dict[str, int] = {}
        #: When the folder had changed that these are of; None: look again.
        self._listed_ns: int | None = None
        #: The one that was begun last.
        self._last = ""

    def create(self, name: str) -> RecordFile:
        """Raises: Refused (`record_failed`)."""
        there = self.facts(None)
        if len(there) >= MOST_RECORDS:
            raise Refused(
                "record_failed",
                f"there are {len(there)} records in {self._folder}, and no more are kept: fetch"
                " some (`etd record get`), then delete them (`etd record delete`)",
            )
        taken_bytes = sum(facts.bytes for facts in there)
        if taken_bytes + MOST_BYTES > MOST_IN_ALL_BYTES:
            raise Refused(
                "record_failed",
                f"the records in {self._folder} take {taken_bytes / 1e6:.0f} MB: fetch some (`etd"
                " record get`), then delete them (`etd record delete`)",
            )
        path = self._path(name)
        try:
            make_own(self._folder, 0o750)
        except FileError as error:
            raise Refused("record_failed", str(error)) from error
        except OSError as error:
            raise Refused(
                "record_failed", f"{self._folder} cannot be a folder: {error.strerror}"
            ) from error
        try:
            if self._disk.free_bytes(self._folder) < RESERVE_BYTES:
                raise Refused("record_failed", f"{DISK_SHORT} of {self._folder}: make room first")
            begun = RecordFile(path, self._disk)
        except FileExistsError:
            why = f"there is a record {name!r} already: choose another name, or delete that one"
        except OSError as error:
            why = f"{path} cannot be written: {error.strerror}"
        else:
            self._last, self._listed_ns = name, None
            return begun
        raise Refused("record_failed", why)

    def facts(self, running: str | None) -> tuple[RecordFacts, ...]:
        """All records, by name. `running`: the one that is being written."""
        sizes = dict(self._listed())
        if self._last in sizes:
            sizes[self._last] = size_of(self._path(self._last))
        return tuple(
            [
                RecordFacts(name=name, bytes=size, is_running=name == running)
                for name, size in sizes.items()
            ]
        )

    def _listed(self) -> dict[str, int]:
        """Sizes by name, in order. Looked at anew where the folder has changed, since a thousand
        records take as long as a stop may wait. Of all of them only the last one that was begun
        grows. The folder's clock has ticks of milliseconds: what is changed here says so itself.
        """
        try:
            changed_ns = self._folder.stat().st_mtime_ns
        except OSError:
            return {}
        if changed_ns != self._listed_ns:
            self._sizes = {
                name: size_of(self._path(name)) for name in names_in(self._folder, _SUFFIX)
            }
            self._listed_ns = changed_ns
        return self._sizes

    def owner(self, name: str) -> int | None:
        """The user who began it; None where its first line does not say so.

        Raises: Refused (`not_found`, `record_failed`).
        """
        first, _, _ = self.piece(name, 0).partition(b"\n")
        try:
            header = lines.decoded(first)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return None
        return header.uid if isinstance(header, lines.Header) else None

    def piece(self, name: str, offset: int) -> bytes:
        """From `offset` on; empty at the end. Raises: Refused (`not_found`, `record_failed`)."""
        path = self._found(name)
        try:
            number = open_own(path, os.O_RDONLY)
        except FileError as error:
            raise Refused("record_failed", str(error)) from error
        except OSError as error:
            raise Refused("record_failed", f"{path} cannot be read: {error.strerror}") from error
        try:
            # No record is longer; a file system has a largest offset of its own.
            return os.pread(number, PIECE_BYTES, offset) if offset <= MOST_BYTES else b""
        except OSError as error:
            raise Refused("record_failed", f"{path} cannot be read: {error.strerror}") from error
        finally:
            os.close(number)

    def delete(self, name: str) -> None:
        """Raises: Refused (`not_found`, `record_failed`)."""
        path, self._listed_ns = self._found(name), None
        try:
            path.unlink()
        except OSError as error:
            raise Refused("record_failed", f"{path} cannot be deleted: {error.strerror}") from error

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}{_SUFFIX}"

    def _found(self, name: str) -> Path:
        path = self._path(name)
        # Whatever it is, and wherever a link leads: who opens it refuses what is no file.
        if os.path.lexists(path):
            return path
        names = ", ".join(facts.name for facts in self.facts(None)) or "none"
        raise Refused("not_found", f"there is no record {name!r}; there are: {names}")
