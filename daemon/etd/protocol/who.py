"""How the log, a halt and `status` name a client: its own name in quotes, its user by the kernel.

Owns: that form. Must not know: what the client did.

A client chooses its name, so it may look as if another user's came after it. What it chose ends
with its quotes, and the user that the kernel told follows them.
"""

from __future__ import annotations

from typing import Annotated, Final

from msgspec import Meta

from etd.protocol.text import PLAIN_PATTERN

#: A name has 64 characters, of which a quoted one may take ten, as \U0010ffff; the user follows.
MOST_OF_WHO: Final = 700
#: What `who` has made.
Who = Annotated[str, Meta(max_length=MOST_OF_WHO, pattern=PLAIN_PATTERN)]
Uid = Annotated[int, Meta(ge=0, lt=2**32)]


def who(client: str, uid: int | None) -> str:
    """`'study' (user 1000)`; `user 1000`, where the client has no name."""
    user = f"user {uid}"
    return f"{client!r} ({user})" if client else user


def user_of(named: str) -> str:
    """Of what `who` has made, the part that the kernel told."""
    return named.rpartition("(")[2].removesuffix(")")
