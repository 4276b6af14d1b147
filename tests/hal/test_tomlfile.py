"""What a file says that cannot be, in the words of whoever edits it."""

from __future__ import annotations

import datetime
import os
import socket
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest
from msgspec import Meta

from etd_hal import tomlfile
from etd_hal.errors import FileError
from etd_hal.tomlfile import convert, load_toml, read_toml


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    least: float = 0.0
    kind: Literal["thick", "thin"] = "thick"


class Lamp(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="lamp", tag_field="sort"):
    watt: Annotated[int, Meta(ge=1)]


class Motor(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="motor", tag_field="sort"):
    turns_hz: Annotated[float, Meta(gt=0.0, le=50.0)]


class Example(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    whole: Annotated[int, Meta(ge=50, le=200)] = 50
    least: Annotated[int, Meta(ge=50)] = 50
    part: Annotated[float, Meta(gt=0.0, lt=1.5)] = 1.0
    text: Annotated[str, Meta(pattern="^[a-z]+$")] = "a"
    note: Annotated[str, Meta(min_length=1)] = "a"
    flag: bool = False
    many: tuple[int, ...] = ()
    some: Annotated[tuple[Part, ...], Meta(max_length=3)] = ()
    day: datetime.date = datetime.date(2025, 1, 15)
    way: Literal["up", "down", "sideways"] = "up"
    ways: tuple[Literal["up", "down"], ...] = ()
    bit: Literal[0, 1] = 0
    line: Annotated[int, Meta(ge=2, le=27)] | Literal["absent"] = 2
    inner: Part | None = None
    thing: Lamp | Motor | None = None


def refused(content: dict[str, Any]) -> FileError:
    with pytest.raises(FileError) as told:
        convert(content, Example, "a.toml")
    return told.value


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("whole", 7, "give a whole number from 50 to 200"),
        ("whole", 201, "give a whole number from 50 to 200"),
        ("whole", "7", "give a whole number from 50 to 200, not text in quotes"),
        ("whole", 60.5, "give a whole number from 50 to 200, not a number with a point"),
        ("least", 7, "give a whole number of at least 50"),
        ("part", 0.0, "give a number above 0 and below 1.5"),
        ("text", 3, "give text in quotes that fits ^[a-z]+$, not a whole number"),
        ("text", "A", "give text in quotes that fits ^[a-z]+$"),
        ("note", "", "give text in quotes of at least 1 characters"),
        ("flag", 1, "give true or false, not a whole number"),
        ("many", {}, "give a list, not a table"),
        ("some", {}, "give a list of tables of at most 3 entries, not a table"),
        ("day", "yesterday", "give a date such as 2025-01-15"),
        ("way", "left", 'give "down", "sideways" or "up"'),
        ("way", "sidewards", 'give "down", "sideways" or "up" (is sideways meant?)'),
        ("way", True, 'give "down", "sideways" or "up", not true or false'),
        ("bit", 2, "give 0 or 1"),
        ("line", "absnet", 'give a whole number from 2 to 27 or "absent" (is absent meant?)'),
        ("line", 28, 'give a whole number from 2 to 27 or "absent"'),
        ("inner", 3, "give a table of least and kind, not a whole number"),
    ],
)
def test_what_is_allowed_is_said_in_words(key: str, value: object, allowed: str) -> None:
    told = refused({key: value})
    assert (told.key, told.allowed) == (key, allowed)


@pytest.mark.parametrize(
    ("content", "key", "allowed"),
    [
        ({"ways": ["up", "dawn"]}, "ways[1]", 'give "down" or "up" (is down meant?)'),
        ({"some": [{}, {"kind": "thinn"}]}, "some[1].kind",
         'give "thick" or "thin" (is thin meant?)'),
        ({"inner": {"least": "x"}}, "inner.least", "give a number, not text in quotes"),
        ({"thing": {"sort": "moter"}}, "thing.sort", 'give "lamp" or "motor" (is motor meant?)'),
        ({"thing": {"sort": "motor", "turns_hz": 0.0}}, "thing.turns_hz",
         "give a number above 0 and at most 50"),
    ],
)  # fmt: skip
def test_it_is_said_of_what_lies_within(content: dict[str, Any], key: str, allowed: str) -> None:
    told = refused(content)
    assert (told.key, told.allowed) == (key, allowed)


@pytest.mark.parametrize(
    ("content", "key", "allowed"),
    [
        ({"inner": {"knd": "thin"}}, "inner",
         "remove it, or correct its name (is kind meant?): least, kind"),
        ({"thing": {"sort": "lamp", "watt": 1, "x": 1}}, "thing",
         "remove it, or correct its name: sort, watt"),
        ({"thing": {"sort": "motor"}}, "thing",
         "write it, a number above 0 and at most 50: nothing here has a default"),
        ({"thing": {"watt": 3}}, "thing",
         'write it, "lamp" or "motor": nothing here has a default'),
    ],
)  # fmt: skip
def test_a_key_that_is_wrong_or_missing_is_told_with_those_that_there_are(
    content: dict[str, Any], key: str, allowed: str
) -> None:
    told = refused(content)
    assert (told.key, told.allowed) == (key, allowed)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"whole": True}, "it says true"),
        ({"whole": datetime.date(2025, 2, 1)}, "it says 2025-02-01"),
        ({"text": "A" * 100}, f"it says '{'A' * 56}..."),
        ({"whole": dict.fromkeys("abcdefghijklmnop", 1)}, "the table there"),
    ],
)
def test_what_the_file_says_is_told_as_it_stands_there(content: dict[str, Any], said: str) -> None:
    assert refused(content).value == said


@pytest.mark.parametrize(
    "text", ["x = " + "[" * 5_000, "x = " + "{a=" * 5_000, "part" + ".a" * 2_000 + " = 1"]
)
def test_a_file_that_is_nested_too_deep_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError) as told:
        load_toml(path, Example)
    assert told.value.file == str(path)
    assert "nested" in told.value.value


@pytest.mark.parametrize(
    "number", [str(2**63), f"-{2**63 + 1}", "9" * 4_300, "9" * 4_301, "0x" + "f" * 4_000]
)
@pytest.mark.parametrize("where", ["whole = {}", "inner = {{ least = {} }}", "ways = [{}]"])
def test_a_number_longer_than_those_of_toml_is_refused_wherever_it_stands(
    tmp_path: Path, number: str, where: str
) -> None:
    path = tmp_path / "a.toml"
    path.write_text(where.format(number), encoding="utf-8")
    with pytest.raises(FileError) as told:
        read_toml(path)
    assert told.value.value == "a whole number in it has more than 64 bits"


@pytest.mark.parametrize("of", ["pipe", "device", "socket"])
def test_what_has_no_end_is_refused_without_waiting_for_it(tmp_path: Path, of: str) -> None:
    path = tmp_path / "a.toml"
    with socket.socket(socket.AF_UNIX) as listening:
        if of == "pipe":
            os.mkfifo(path)
        elif of == "device":
            path.symlink_to("/dev/zero")
        else:
            listening.bind(str(path))
        with pytest.raises(FileError) as told:
            read_toml(path)
    words = "it cannot be read" if of == "socket" else "it is a pipe, a device or a socket"
    assert told.value.value.startswith(words)


def test_a_file_may_have_so_many_bytes_and_no_more(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"#" * tomlfile.MOST_BYTES)
    assert read_toml(path) == {}
    path.write_bytes(b"#" * (tomlfile.MOST_BYTES + 1))
    with pytest.raises(FileError, match="it has more than 1048576 bytes"):
        read_toml(path)


def test_the_longest_numbers_of_toml_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(f"most = {2**63 - 1}\nleast = [-{2**63}]\n", encoding="utf-8")
    assert read_toml(path) == {"most": 2**63 - 1, "least": [-(2**63)]}
