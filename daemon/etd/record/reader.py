"""Reads a record, line by line, up to where it ends.

Owns: what is a record and what is not, and the one line that may be torn: the last. Must not know:
what is made of the lines.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from etd.protocol.errors import FileError
from etd.record.consistency import Consistency
from etd.record.lines import FORMAT, End, Header, Line, Lost, decoded

#: In bytes. No line of a record is as long: what is longer is something else, and read no further.
MAX_LINE_BYTES: Final = 16_000_000


class RecordReader:
    """Iterate once: the lines in their order, the header first.

    Raises, while iterating: FileError, for what is no record, or a line that is none.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        #: How the record ended; None while it is read, and for a record that was cut off.
        self.end: End | None = None
        self.header: Header | None = None
        self._lost_pulses = self._lost_lines = 0
        self._consistency = Consistency()

    @property
    def missing(self) -> tuple[str, ...]:
        """What it lacks, as far as it was read: a sentence each; none for a whole record."""
        sentences = []
        if self.end is None:
            sentences.append(
                "the record is cut off: it is still being written, or the gateway was killed or"
                " could not write; what came later is not in it"
            )
        elif self.end.why == "full":
            bound = self.end.detail or "it ended at its bound"
            sentences.append(f"the record was full: {bound}, and what came later is not in it")
        if self._lost_pulses or self._lost_lines:
            sentences.append(
                f"{self._lost_pulses} pulses and {self._lost_lines} lines were lost within the"
                " record: its doses and events are not whole"
            )
        return tuple(sentences)

    def __iter__(self) -> Iterator[Line]:
        read_bytes = 0
        try:
            with self.path.open("rb") as file:
                for number, data in enumerate(
                    iter(lambda: file.readline(MAX_LINE_BYTES), b""), start=1
                ):
                    read_bytes += len(data)
                    if len(data) == MAX_LINE_BYTES:
                        raise self._no_line(number, f"it has {MAX_LINE_BYTES} bytes and no end")
                    if not data.endswith(b"\n"):
                        break  # torn: it was being written
                    yield self._noted(self._line(number, data), number)
        except OSError as error:
            raise FileError(
                str(self.path), "", f"cannot be read: {error.strerror}", "a record's file"
            ) from error
        if self.header is None:
            raise FileError(
                str(self.path),
                "",
                _why_no_header(read_bytes),
                "a record's file",
            )

    def _line(self, number: int, data: bytes) -> Line:
        try:
            line = decoded(data)
            self._consistency.check(line)
            return line
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise self._no_line(number, str(error)) from None

    def _no_line(self, number: int, why: str) -> FileError:
        return FileError(
            str(self.path),
            f"line {number}",
            f"it is no line of a record ({why})",
            "a file that `etd record get` has written, unchanged",
        )

    def _noted(self, line: Line, number: int) -> Line:
        if number == 1:
            if not isinstance(line, Header):
                raise FileError(
                    str(self.path), "line 1", "it is no header", "a record's file from its start"
                )
            if line.format > FORMAT:
                raise FileError(
                    str(self.path),
                    "format",
                    f"it is {line.format}, written by etd {line.etd}",
                    f"at most {FORMAT}: read it with that version",
                )
            self.header = line
        elif isinstance(line, End):
            self.end = line
        elif isinstance(line, Lost):
            self._lost_pulses += line.pulses
            self._lost_lines += line.lines
        return line


def _why_no_header(read_bytes: int) -> str:
    """Of a file without a whole first line."""
    if not read_bytes:
        return "it is empty: nothing was recorded"
    return (
        f"its {read_bytes} bytes have no line break: it is no record, or was cut off within its"
        " first line, before anything was recorded"
    )
