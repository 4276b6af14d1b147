"""Names in files and messages: which texts are one.

Owns: that a pattern is for the whole text, and the pattern of a file's own name. Must not know: who
is named.

A pattern of a struct is searched for, and in Python `$` matches before a line break at the end too.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

_END = r"(?!\n)$"


def whole(pattern: str) -> str:
    """The pattern of a text that is this and no more, in Python as in JSON Schema."""
    return rf"^{pattern}{_END}"


def in_words(pattern: str) -> str:
    """The pattern as a person reads it who edits a file."""
    return f"{pattern.removesuffix(_END)}$" if pattern.endswith(_END) else pattern


#: As boards, machines and body sites call themselves.
PlainName = Annotated[str, Meta(pattern=whole("[a-z0-9][a-z0-9-]{0,39}"))]
