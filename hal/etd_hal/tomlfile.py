"""A TOML file into a checked struct, and a sentence for everything that can be wrong with it.

Owns: reading, and the way from msgspec's complaint to file, key, value and what is allowed.
Must not know: what any file is about.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import TypeVar

import msgspec

from etd_hal.errors import FileError

T = TypeVar("T")

#: A calibration of 256 electrodes with explicit returns has a quarter of it.
MOST_BYTES = 1_048_576


#: msgspec's names of types, and its bounds, as a person who edits a file calls them.
_KINDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text in quotes",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}
_BOUNDS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}


def load_toml(path: Path, kind: type[T]) -> T:
    """Read `path` into `kind`. Raises: FileError, naming file, key, value and what is allowed."""
    try:
        data = tomllib.loads(_text_of(path))
    except FileNotFoundError:
        raise FileError(str(path), "", "there is no such file", "name one that exists") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(str(path), "", f"it cannot be read ({error})", "check it") from error
    except tomllib.TOMLDecodeError as error:
        raise FileError(str(path), "", f"it is not TOML ({error})", "correct the line") from error
    return convert(data, kind, str(path))


def _text_of(path: Path) -> str:
    """No more than is any file of ours is read: a device or a pipe may have no end.

    Raises: FileError, OSError, UnicodeDecodeError.
    """
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise FileError(
            str(path),
            "",
            f"it has more than {MOST_BYTES} bytes",
            "no file of this kind has so many",
        )
    return data.decode("utf-8")


def convert(data: object, kind: type[T], file: str) -> T:
    """Check `data` against `kind`; msgspec's path becomes the key that the sentence names."""
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        what, _, where = str(error).partition(" - at ")
        key = where.strip("`").removeprefix("$.").removeprefix("$")
        raise FileError(file, key, *_sentences(data, key, what)) from error


def _sentences(data: object, key: str, what: str) -> tuple[str, str]:
    """What the file says there, and what is allowed."""
    if "unknown field" in what:
        return what[0].lower() + what[1:], "remove it, or correct its name"
    if "missing required field" in what:
        return what[0].lower() + what[1:], "write it: nothing here has a default"
    return _value_at(data, key), _allowed(what)


def _allowed(what: str) -> str:
    """The two commonest of msgspec's sentences in words; the others as they are."""
    bounded = re.fullmatch(r"Expected `(int|float)` (>=|<=|>|<) (\S+)", what)
    if bounded is not None:
        kind, sign, bound = bounded.groups()
        return f"give {_KINDS[kind]} {_BOUNDS[sign]} {bound.removesuffix('.0')}"
    other = re.fullmatch(r"Expected `(\w+)`, got `(\w+)`", what)
    if other is not None and set(other.groups()) <= set(_KINDS):
        wanted, found = other.groups()
        what_it_is = "a number with a point" if found == "float" else _KINDS[found]
        return f"give {_KINDS[wanted]}, not {what_it_is}"
    return what


def _value_at(data: object, key: str) -> str:
    for part in key.replace("[", ".[").split(".") if key else []:
        if isinstance(data, dict) and part in data:
            data = data[part]
        elif isinstance(data, list) and part[1:-1].isdigit():
            data = data[int(part[1:-1])]
        else:
            return "the value there"
    text = repr(data)
    return f"it says {text}" if len(text) <= 60 else "the table there"
