"""A TOML file into a checked struct, and a sentence for everything that can be wrong with it.

Owns: reading, and the way from msgspec's complaint to file, key, value and what is allowed.
Must not know: what any file is about.
"""

from __future__ import annotations

import datetime
import re
import sys
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from etd_hal import schema_hints, toml_bounds
from etd_hal.bounded_file import read_bounded
from etd_hal.daemon_python import too_old
from etd_hal.errors import FileError

T = TypeVar("T")

#: A calibration of 256 electrodes with explicit returns takes a quarter of this.
MOST_BYTES = 1_048_576

#: msgspec's names of types in words for the person who edits a file.
_KINDS = {
    "int": "a whole number",
    "float": "a number with a point",
    "str": "text in quotes",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Unknown keys are errors: a typo must not disable a limit."""


def load_toml(path: Path, kind: type[T]) -> T:
    """Read `path` into `kind`. Raises: FileError, naming file, key, value and what is allowed;
    PythonTooOld.
    """
    return _loaded(path, kind, read_toml(path))


def load_bytes(path: Path, kind: type[T], data: bytes) -> T:
    """The same of the bytes that were read from `path`."""
    return _loaded(path, kind, _parsed(path, data))


def _loaded(path: Path, kind: type[T], parsed: dict[str, Any]) -> T:
    try:
        return convert(parsed, kind, str(path))
    except RecursionError as error:
        raise _too_deep(path) from error


def read_toml(path: Path) -> dict[str, Any]:
    """What the file says, unchecked. Raises: FileError, for all that is no TOML file; PythonTooOld,
    since Python reads TOML from 3.11 on, and the client runs on 3.10.
    """
    return _parsed(path)


def _parsed(path: Path, data: bytes | None = None) -> dict[str, Any]:
    """`data` None: of the file."""
    try:
        return _read(path, data)
    except FileNotFoundError:
        raise FileError(str(path), "", "there is no such file", "name one that exists") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(str(path), "", f"it cannot be read ({error})", "check it") from error
    except ValueError as error:
        raise FileError(str(path), "", f"it is not TOML ({error})", "correct the line") from error
    except RecursionError as error:
        raise _too_deep(path) from error


def _read(path: Path, data: bytes | None) -> dict[str, Any]:
    """Raises: FileError, PythonTooOld, OSError, RecursionError, ValueError (no text, no TOML)."""
    if sys.version_info >= (3, 11):
        import tomllib  # novm

        text = (read_bounded(path, MOST_BYTES) if data is None else data).decode("utf-8")
        if (why := toml_bounds.why_not(text)) is not None:
            raise FileError(str(path), "", why, "see docs/files.md")
        try:
            parsed = tomllib.loads(text)
        except tomllib.TOMLDecodeError:
            raise
        except ValueError as error:  # Python does not read a number of thousands of digits
            raise _too_long(path) from error
        if _has_long_number(parsed):
            raise _too_long(path)
        return parsed
    raise too_old(f"{path}: reading TOML")


def _has_long_number(parsed: dict[str, Any]) -> bool:
    """Beyond the 64 bits that TOML has: Python reads one of any length if it is hexadecimal, and
    ends with an error where it is to be written into a sentence, or becomes a float.
    """
    left: list[object] = [parsed]
    while left:
        value = left.pop()
        if isinstance(value, dict):
            left.extend(value.values())
        elif isinstance(value, list):
            left.extend(value)
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            return True
    return False


def _too_long(path: Path) -> FileError:
    return FileError(
        str(path), "", "a whole number in it has more than 64 bits", "write a shorter one"
    )


def _too_deep(path: Path) -> FileError:
    return FileError(str(path), "", "it is nested too deep", "see docs/files.md")


def convert(data: object, kind: type[T], file: str) -> T:
    """Check `data` against `kind`; msgspec's path becomes the key that the sentence names."""
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        what, _, where = str(error).partition(" - at ")
        key = where.strip("`").removeprefix("$.").removeprefix("$")
        raise FileError(file, key, *_sentences(data, kind, key, what)) from error


def _sentences(data: object, kind: type, key: str, what: str) -> tuple[str, str]:
    """What the file says at the key, and what is allowed: by the type, else in msgspec's words."""
    field = re.search(r"field `(.*)`$", what)
    if field is not None:
        return what[0].lower() + what[1:], _about_field(data, kind, key, field[1], what)
    may_stand, found = schema_hints.key_path(kind, data, key)
    words = schema_hints.in_words(may_stand)
    if not words:
        return _told(found), what
    return _told(found), f"give {words}{_not(what)}{_meant(found, may_stand)}"


def _about_field(data: object, kind: type, key: str, field: str, what: str) -> str:
    if "missing" in what:
        may_stand, _ = schema_hints.key_path(kind, data, f"{key}.{field}")
        return f"write it, {schema_hints.in_words(may_stand)}: nothing here has a default"
    table, _ = schema_hints.key_path(kind, data, key)
    keys = schema_hints.keys_of(table)
    return f"remove it, or correct its name{schema_hints.meant(field, keys)}: {', '.join(keys)}"


def _not(what: str) -> str:
    """The kind found, where it is not the expected one."""
    other = re.fullmatch(r"Expected `.*`, got `(\w+)`", what)
    return f", not {_KINDS[other[1]]}" if other is not None and other[1] in _KINDS else ""


def _meant(found: object, may_stand: schema_hints.Alternatives) -> str:
    """Only a text can be a word that is written wrongly."""
    if not isinstance(found, str):
        return ""
    return schema_hints.meant(found, schema_hints.words_of_choice(may_stand))


def _told(found: object) -> str:
    if isinstance(found, bool):
        return f"it says {str(found).lower()}"
    text = str(found) if isinstance(found, datetime.date) else repr(found)
    if len(text) <= 60:
        return f"it says {text}"
    return "the table there" if isinstance(found, dict) else f"it says {text[:57]}..."
