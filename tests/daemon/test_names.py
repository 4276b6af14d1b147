"""Names: letters, digits and a few signs, and nothing before, between or after them.

Owns: that every pattern of every struct, and the daemon's own check, holds for the whole name.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import inspect

import etd.files
import etd.protocol
import etd_hal
from etd.files.array import Array
from etd.files.body_site import BodySite
from etd.files.check import check_file
from etd.files.paths import calibrating_file, check_name
from etd.protocol.errors import FileError
from etd.protocol.frame import ClientName, Name, PlainText
from etd_hal.boardfile import BoardFile, MachineFile
from etd_hal.tomlfile import convert
from files_by_hand import ARRAY, write

CONTROLS = st.sampled_from("\n\r\x1b\x85") | st.characters(categories=["Cc"])
LETTERS = st.just("") | st.text("abcdefgh01", max_size=8)


def structs() -> Iterator[type[msgspec.Struct]]:
    """All that are defined in the modules that read bytes or files."""
    for package in (etd_hal, etd.files, etd.protocol):
        for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
            for found in vars(importlib.import_module(module.name)).values():
                if isinstance(found, type) and issubclass(found, msgspec.Struct):
                    yield found


def patterns() -> set[str]:
    """The pattern of every text in every struct, however deep."""
    found: set[str] = set()

    def look(kind: object) -> None:
        if isinstance(kind, inspect.StrType) and kind.pattern is not None:
            found.add(kind.pattern)
        if isinstance(kind, inspect.StructType):
            for field in kind.fields:
                look(field.type)
        for inner in ("type", "item_type", "value_type", "key_type"):
            if hasattr(kind, inner):
                look(getattr(kind, inner))
        for several in ("types", "item_types"):
            for one in getattr(kind, several, ()):
                look(one)

    for struct in structs():
        look(inspect.type_info(struct))
    return found


PATTERNS = sorted(patterns())


def test_the_structs_were_found() -> None:
    assert len(PATTERNS) >= 4


@pytest.mark.parametrize("pattern", PATTERNS)
@settings(max_examples=50)
@given(before=LETTERS, control=CONTROLS, after=LETTERS)
def test_no_pattern_takes_a_control_character_at_any_place(
    pattern: str, before: str, control: str, after: str
) -> None:
    assert re.search(pattern, f"{before}{control}{after}") is None


@pytest.mark.parametrize("kind", [Name, ClientName, PlainText])
@settings(max_examples=50)
@given(before=LETTERS, control=CONTROLS, after=LETTERS)
def test_no_name_of_the_protocol_takes_one(
    kind: type[str], before: str, control: str, after: str
) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(f"{before}{control}{after}", kind)


@settings(max_examples=50)
@given(before=LETTERS, control=CONTROLS, after=LETTERS)
def test_no_name_of_a_daemon_takes_one(before: str, control: str, after: str) -> None:
    with pytest.raises(FileError):
        check_name(f"{before}{control}{after}")


@pytest.mark.parametrize("struct", [Array, BodySite, BoardFile, MachineFile])
def test_a_name_with_a_line_break_at_its_end_is_not_a_files(struct: type[msgspec.Struct]) -> None:
    field = next(each for each in msgspec.structs.fields(struct) if each.name == "name")
    alone = msgspec.defstruct("Alone", [("name", field.type)])
    assert convert({"name": "strip-3"}, alone, "a.toml").name == "strip-3"  # type: ignore[attr-defined]
    with pytest.raises(FileError, match="name"):
        convert({"name": "strip-3\n"}, alone, "a.toml")


def test_an_array_whose_name_ends_in_a_line_break_is_refused(tmp_path: Path) -> None:
    text = ARRAY.replace('name = "strip-3"', 'name = "strip-3\\n"')
    assert text != ARRAY
    checked = check_file(write(tmp_path, "a.toml", text))
    assert checked.error is not None
    assert "name" in checked.error


def test_what_is_added_to_a_calibration_is_saved_beside_it_however_long_its_name() -> None:
    longest = "P" * 32
    asked, added = calibrating_file("fake", longest), calibrating_file("fake", longest, ".fit")
    assert asked.parent == added.parent
    assert asked != added
    assert calibrating_file("fake", "P01-fit") != calibrating_file("fake", "P01", ".fit")
    with pytest.raises(FileError, match="give 1 to 32 letters"):
        calibrating_file("fake", longest + "P", ".fit")
