"""Records with one value changed, as an editor, a script or a bad disk leaves them.

Owns: that whatever is made of such a record ends in a result or in a sentence that names the line.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from etd.files.configuration import fake_config
from etd.protocol.errors import EtdError, FileError
from etd.record.events import table
from etd.record.pattern import FramesToPattern, Kind
from etd.record.reader import RecordReader
from etd.record.summary import summary_of
from etd.record.text import lines_of
from etd.replay.timeline import Timeline
from etd.report.figures import figures_of
from etd.report.recorded import recorded_sections, recorded_sentence
from whole_record import WHOLE

#: Where a value stands in a record: the line, then keys and places in it.
Place: TypeAlias = tuple[int | str, ...]


def places(value: Any, here: Place = ()) -> Iterator[Place]:
    """Of all that is within the value."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield (*here, key)
            yield from places(inner, (*here, key))


FOUND = figures_of(fake_config(), "passed on a day")
PLACES = list(places(WHOLE))
#: Of three electrodes, where the array has four.
CONTACTS = {key: [False] * 3 for key in ("is_touched", "is_shorted", "was_at_end")} | {
    key: [0] * 3
    for key in (
        *("resistance_ohm", "voltage_v", "undelivered_ua", "soft_since_ns", "commanded_ua"),
        "measured_ns",
    )
}
JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**30), 10**30)
    | st.integers(-3, 10)
    | st.sampled_from([0, -1, 2**31, 2**53, 2**63 - 1, -(2**63), 2**63, 10**400])
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=4)
    | st.sampled_from([line["kind"] for line in WHOLE] + ["frame", "mark", "stimulus", "HALTED"]),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=8,
)


def damaged(place: Place, value: Any) -> bytes:
    record = json.loads(json.dumps(WHOLE))
    *way, last = place
    within = record
    for key in way:
        within = within[key]
    within[last] = value
    return b"".join(json.dumps(line).encode() + b"\n" for line in record)


def sums(path: Path) -> None:
    summary = summary_of(RecordReader(path))
    msgspec.json.encode(summary)
    list(lines_of(summary))
    recorded_sections(summary, FOUND)
    recorded_sentence(summary, FOUND)


def events(path: Path) -> None:
    list(table(RecordReader(path)))


def pattern(path: Path) -> None:
    kinds: tuple[Kind, ...] = ("levels", "currents")
    for kind in kinds:
        made = FramesToPattern(RecordReader(path), str(path), kind)
        json.dumps((made.pattern, made.left_out))


def timeline(path: Path) -> None:
    _ = Timeline(RecordReader(path)).told


MADE = (sums, events, pattern, timeline)


def stored(folder: Path, place: Place, value: Any) -> Path:
    path = folder / "p01.jsonl"
    path.write_bytes(damaged(place, value))
    return path


def test_the_record_itself_is_whole(tmp_path: Path) -> None:
    path = stored(tmp_path, (0, "name"), "p02")
    for make in MADE:
        make(path)
    assert [told.act for told in Timeline(RecordReader(path)).told][:3] == [
        "open",
        "measure",
        "resume",
    ]


@given(place=st.sampled_from(PLACES), value=JSON)
@example(place=(14, "reply"), value={})
@example(place=(14, "reply", "marked_ns"), value="soon")
@example(place=(1, "wall_ns"), value=10**30)
@example(place=(20, "report", "t_ns"), value=10**400)
@example(place=(8, "request"), value={"op": "frame"})
@example(place=(15, "request", "current_ua"), value=["much"])
@example(place=(15, "request", "current_ua"), value=[])
@example(place=(10, "rows", 0, 2), value=1_000)
@example(place=(10, "rows", 0, 11), value=10**400)
def test_a_value_in_place_of_another_ends_in_a_result_or_a_sentence(
    place: Place, value: Any
) -> None:
    with TemporaryDirectory() as folder:
        path = stored(Path(folder), place, value)
        for make in MADE:
            with contextlib.suppress(EtdError):
                make(path)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ((8, "request", "seq"), "first"),
        ((8, "request", "seq"), None),
        ((8, "request", "level"), [0.5, "strong"]),
        ((15, "request", "current_ua"), {"1": 800}),
        ((14, "reply", "marked_ns"), None),
        ((1, "wall_ns"), 10**30),
        ((20, "report", "t_ns"), 10**30),
        ((10, "rows", 1, 2), 4),
        ((10, "rows", 1, 2), -1),
        ((4, "carried", "soft_start", "recontacts"), {"4": {}}),
        ((4, "carried", "soft_start", "were_open"), [-1]),
        ((4, "carried", "contacts"), CONTACTS),
        ((4, "frames"), [{"seq": "first"}]),
    ],
)
def test_what_cannot_be_is_told_with_its_line(tmp_path: Path, place: Place, value: Any) -> None:
    path = stored(tmp_path, place, value)
    for make in (sums, events, pattern, timeline):
        with pytest.raises(FileError, match=rf"line {int(place[0]) + 1}\b"):
            make(path)
