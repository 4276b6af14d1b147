"""What a TOML text may have, looked at before it is parsed.

Owns: how many parts a key has and how many tables a text makes, in one walk over it. Must not know:
files, what a key means, whether the text is TOML.

For each part of a key `tomllib` goes through all before it, and for each part and table it makes a
dictionary and a set: of a file of a few hundred kilobytes that takes minutes, or gigabytes. Each
character is walked over once, whatever the text is: strings, comments and keys are stepped over
whole, also where they never end.
"""

from __future__ import annotations

import re

#: Parts of a key, joined by points: the deepest here has four.
MOST_PARTS = 16
#: Tables by a heading or by a key with points, one for each electrode at most; a line that begins
#: with a list counts too.
MOST_TABLES = 2_000

_ONE_LINE = r""""[^"\\\n]*(?:\\.[^"\\\n]*)*"?|'[^'\n]*'?"""
_PART = rf"(?:[A-Za-z0-9_-]+|{_ONE_LINE})"
_LINES = (
    # One or two quotes may stand before the three that end it; an escape may be all that is left.
    r'"""[^"\\]*(?:(?:(?s:\\.)|"(?!""))[^"\\]*)*(?:"{3,5}|\\?\Z)'
    r"|'''[^']*(?:'(?!'')[^']*)*(?:'{3,5}|\Z)"
)
_PARTS = re.compile(_PART)
_TOKEN = re.compile(
    rf"\#[^\n]*|{_LINES}"
    r"|(?P<heading>^[ \t]*\[)"
    rf"|(?P<key>{_PART}(?:[ \t]*\.[ \t]*{_PART})*)(?P<has_value>[ \t]*=)?",
    re.MULTILINE,
)


def why_not(text: str) -> str | None:
    """Why it should not be parsed; None where it may be."""
    tables = 0
    for token in _TOKEN.finditer(text):
        kind = token.lastgroup
        if kind == "heading":
            tables += 1
        elif kind is not None and "." in (key := token["key"]):
            parts = len(_PARTS.findall(key))
            if parts > MOST_PARTS:
                return f"it is nested too deep: more than {MOST_PARTS} names are joined by points"
            tables += kind == "has_value" and parts > 1
        if tables > MOST_TABLES:
            return f"it has more than {MOST_TABLES} tables"
    return None
