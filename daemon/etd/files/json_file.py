"""JSON as it lies about in files, read strictly first and mended where that is safe.

Owns: the size of what is read, the two faults it can mend (a bare word, a trailing comma), and the
sentences that say so. Must not know: what the files mean.

Never accepted: a key given twice, NaN, nesting without end, half of a pair of surrogates.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path

from etd_hal.errors import FileError

MAX_BYTES = 16 * 1024 * 1024

#: More digits than any figure here has; beyond some thousands Python refuses them.
_MOST_DIGITS = 100
#: Of what was mended, so many are told one by one.
_MOST_TOLD = 100
#: Strings and numbers are stepped over whole, so that nothing inside them is taken for a fault. A
#: string that never ends goes on to the end of the text: to try again from each quote would take
#: the square of the text's length.
_TOKEN = re.compile(
    r"""(?P<string>"(?:[^"\\]|\\.)*"?)
      | (?P<number>-?\d[\d.eE+-]*)
      | (?P<word>[A-Za-z_][\w-]*)
      | (?P<comma>,)(?=\s*[\]}])""",
    re.VERBOSE,
)
#: The escape of one of a pair of surrogates: alone it is no character, and cannot be written again.
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
_WORDS_OF_JSON = ("true", "false", "null")


def read_json(path: Path) -> tuple[object, tuple[str, ...]]:
    """The content, and a sentence for each thing that had to be mended. Raises: FileError."""
    text = _read_text(path)
    try:
        try:
            return _parse(text), ()
        except json.JSONDecodeError:
            mended_text, mended = _mend(text)
            if not mended:
                raise
        return _parse(mended_text), mended
    except RecursionError as error:
        raise FileError(str(path), "", "it is nested too deep", "a pattern is flat") from error
    except ValueError as error:
        raise FileError(str(path), "", f"it is not JSON ({error})", "correct the line") from error


def _read_text(path: Path) -> str:
    try:
        if path.exists() and not path.is_file():
            raise FileError(str(path), "", "it is not a file", "name a file")
        size_bytes = path.stat().st_size
        if size_bytes > MAX_BYTES:
            raise FileError(str(path), "", f"it has {size_bytes} bytes", f"at most {MAX_BYTES}")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise FileError(str(path), "", "there is no such file", "name one that exists") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(str(path), "", f"it cannot be read ({error})", "check it") from error


class _Ambiguous(ValueError):
    """Well-formed, but not to be understood in one way only."""


def _parse(text: str) -> object:
    content = json.loads(
        text, object_pairs_hook=_once, parse_constant=_no_constant, parse_int=_whole_number
    )
    if _SURROGATE.search(text):
        try:
            json.dumps(content, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            raise _Ambiguous("a text in it has half of a character, like \\ud800 alone") from None
    return content


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    content = dict(pairs)
    if len(content) != len(pairs):
        twice, _ = Counter(key for key, _ in pairs).most_common(1)[0]
        raise _Ambiguous(f"the key {twice!r} is there twice")
    return content


def _whole_number(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise _Ambiguous(f"a whole number of {len(digits)} digits: {digits[:20]}...")
    return int(digits)


def _no_constant(word: str) -> object:
    raise _Ambiguous(f"{word} is not a number")


def _mend(text: str) -> tuple[str, tuple[str, ...]]:
    mended: list[str] = []
    found = 0
    line, counted_to = 1, 0

    def tell(at: int, what: str) -> None:
        nonlocal found, line, counted_to
        found += 1
        if found <= _MOST_TOLD:
            line += text.count("\n", counted_to, at)
            counted_to = at
            mended.append(f"line {line}: {what}")

    def replace(match: re.Match[str]) -> str:
        if match["comma"]:
            tell(match.start(), "a comma before a closing bracket was left out")
            return ""
        word = match["word"]
        if word and word not in _WORDS_OF_JSON:
            tell(match.start(), f"the bare word {word} was taken as text")
            return f'"{word}"'
        return match[0]

    mended_text = _TOKEN.sub(replace, text)
    if found > _MOST_TOLD:
        mended.append(f"and {found - _MOST_TOLD} more of these")
    return mended_text, tuple(mended)
