r"""Text that crosses the protocol and is shown in logs and on terminals.

Owns: which characters such text may have: others are refused where it comes in (the types are in
`frame.py`), and escaped where it is shown. Must not know: who sends it, where it is shown.

A line break would forge a line of the log, an escape sequence act on the terminal, and a mark of
direction reorder what is read.
"""

from __future__ import annotations

import unicodedata

from etd_hal.names import whole

_UNSHOWN = r"\u0000-\u001f\u007f-\u009f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069"
PLAIN_PATTERN = whole(f"[^{_UNSHOWN}]*")
NAME_PATTERN = whole("[A-Za-z0-9_-]{1,32}")
#: What these refuse, in words.
PATTERN_IN_WORDS = {
    PLAIN_PATTERN: "a text has no control characters, line breaks or marks of direction",
    NAME_PATTERN: "a name has 1 to 32 letters from A to Z, digits, hyphens or underscores",
}

#: Controls, what is shown by no sign of its own, halves of a pair, breaks of a line or a paragraph.
_NOT_SHOWN = ("Cc", "Cf", "Cs", "Zl", "Zp")
#: The longest line that is shown.
MOST_SHOWN = 1_000


def escaped(text: str) -> str:
    r"""The text with each such character as an escape: a line break becomes \n."""
    if text.isprintable():
        return text
    return "".join(map(_escaped_character, text))


def shown(text: str, most: int = MOST_SHOWN) -> str:
    """The text as one line for a log or a terminal: escaped, and no longer than that."""
    line = escaped(text[: most + 1])
    return line if len(line) <= most else f"{line[:most]}... (cut short)"


def _escaped_character(character: str) -> str:
    if unicodedata.category(character) in _NOT_SHOWN:
        return character.encode("unicode_escape").decode()
    return character
