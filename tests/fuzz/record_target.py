"""Target: a record as another program, or a bad disk, has left it.

Owns: that whatever is made of one ends in a result or in a sentence. Must not know: what records
are for.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from etd.protocol.errors import EtdError
from etd.record.events import table
from etd.record.pattern import FramesToPattern
from etd.record.reader import RecordReader
from etd.record.summary import summary_of
from etd.record.text import lines_of
from etd.replay.timeline import Timeline
from fuzz.file_targets import stored
from fuzz.sentences import check_error
from fuzz.target import Target
from whole_record import WHOLE


def _sums(path: Path) -> None:
    summary = summary_of(RecordReader(path))
    msgspec.json.encode(summary)
    list(lines_of(summary))


def _events(path: Path) -> None:
    list(table(RecordReader(path)))


def _pattern(path: Path) -> None:
    for kind in ("levels", "currents"):
        made = FramesToPattern(RecordReader(path), str(path), kind)
        json.dumps((made.pattern, made.left_out))


def _timeline(path: Path) -> None:
    _ = Timeline(RecordReader(path)).told


_MADE: tuple[Callable[[Path], None], ...] = (_sums, _events, _pattern, _timeline)


def _play(data: bytes) -> None:
    path = stored("p01.jsonl", data)
    for make in _MADE:
        try:
            make(path)
        except EtdError as error:
            check_error(error)


def _seeds() -> Iterator[bytes]:
    lines = [json.dumps(line).encode() + b"\n" for line in WHOLE]
    yield b"".join(lines)
    for line in lines[1:]:
        yield lines[0] + line


TARGETS = (
    Target(
        "records",
        "a record: its sums, its events, as a pattern, as what is replayed",
        _play,
        _seeds,
        ("daemon/etd/record/*.py", "daemon/etd/replay/timeline.py", "daemon/etd/protocol/*.py"),
        most_bytes=16_384,
    ),
)
