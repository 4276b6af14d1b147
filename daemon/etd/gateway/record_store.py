"""The records on disk, each a file of JSON lines with the record's name.

Owns: their folder, names, sizes and owners, what all of them may take, and reading a piece of one.
Must not know: what else is in a record, who asks.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

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
        path = self._folder / f"{name}{_SUFFIX}"
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
            return RecordFile(path, self._disk)
        except FileExistsError:
            why = f"there is a record {name!r} already: choose another name, or delete that one"
        except OSError as error:
            why = f"{path} cannot be written: {error.strerror}"
        raise Refused("record_failed", why)

    def facts(self, running: str | None) -> tuple[RecordFacts, ...]:
        """All records, by name. `running`: the one that is being written."""
        found: list[RecordFacts] = []
        for path in sorted(self._folder.glob(f"*{_SUFFIX}")):
            try:
                size = path.stat().st_size
            except OSError:
                continue  # deleted meanwhile
            name = path.name.removesuffix(_SUFFIX)
            found.append(RecordFacts(name=name, bytes=size, is_running=name == running))
        return tuple(found)

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
            return os.pread(number, PIECE_BYTES, offset)
        except OSError as error:
            raise Refused("record_failed", f"{path} cannot be read: {error.strerror}") from error
        finally:
            os.close(number)

    def delete(self, name: str) -> None:
        """Raises: Refused (`not_found`, `record_failed`)."""
        path = self._found(name)
        try:
            path.unlink()
        except OSError as error:
            raise Refused("record_failed", f"{path} cannot be deleted: {error.strerror}") from error

    def _found(self, name: str) -> Path:
        path = self._folder / f"{name}{_SUFFIX}"
        if path.is_file():
            return path
        names = ", ".join(facts.name for facts in self.facts(None)) or "none"
        raise Refused("not_found", f"there is no record {name!r}; there are: {names}")
