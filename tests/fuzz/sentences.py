"""What is told about bytes that were refused: it can be shown on a terminal, and it is no flood.

Owns: that judgment. Must not know: what was refused.
"""

from __future__ import annotations

import unicodedata
from typing import get_args

from etd.protocol.errors import ErrorCode, EtdError, Refused

#: Controls, marks of direction, halves of a pair, breaks of a line or a paragraph.
_UNSHOWN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
_MOST_REASON = 2_000
#: The longest line about a file.
_MOST_CHARACTERS = 1_200


def check_line(line: str) -> None:
    """One line, with nothing in it that acts on a terminal."""
    forging = [char for char in line if unicodedata.category(char) in _UNSHOWN]
    assert not forging, (forging, line)


def check_refusal(refusal: Refused) -> None:
    """A code of the protocol's list, and a reason that does not give back what it was sent."""
    assert refusal.code in get_args(ErrorCode)
    assert refusal.reason
    check_line(refusal.reason)
    check_line(str(refusal))
    assert len(refusal.reason) <= _MOST_REASON


def check_told(lines: list[str]) -> None:
    """What a command prints about a file."""
    assert lines
    for line in lines:
        check_line(line)
        assert len(line) <= _MOST_CHARACTERS


def check_error(error: EtdError) -> None:
    """It says something that a terminal can have."""
    assert str(error)
    str(error).encode()
