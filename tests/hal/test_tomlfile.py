"""What a file says that cannot be, in the words of whoever edits it."""

from __future__ import annotations

from typing import Annotated

import msgspec
import pytest
from msgspec import Meta

from etd_hal.errors import FileError
from etd_hal.tomlfile import convert


class Example(msgspec.Struct, frozen=True, kw_only=True):
    whole: Annotated[int, Meta(ge=50, le=200)] = 50
    part: Annotated[float, Meta(gt=0.0, lt=1.5)] = 1.0
    text: Annotated[str, Meta(pattern="^[a-z]+$")] = "a"
    flag: bool = False
    many: tuple[int, ...] = ()


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("whole", 7, "give a whole number of at least 50"),
        ("whole", 201, "give a whole number of at most 200"),
        ("whole", "7", "give a whole number, not text in quotes"),
        ("whole", 60.5, "give a whole number, not a number with a point"),
        ("part", 0.0, "give a number above 0"),
        ("part", 2.5, "give a number below 1.5"),
        ("text", 3, "give text in quotes, not a whole number"),
        ("text", "A", "Expected `str` matching regex '^[a-z]+$'"),
        ("flag", 1, "give true or false, not a whole number"),
        ("many", {}, "give a list, not a table"),
    ],
)
def test_what_is_allowed_is_said_in_words(key: str, value: object, allowed: str) -> None:
    with pytest.raises(FileError) as told:
        convert({key: value}, Example, "a.toml")
    assert (told.value.key, told.value.allowed) == (key, allowed)
