"""How a law says that it does not believe what is measured.

Owns: the shape of that. Must not know: who hears it, what is not believed.
"""

from __future__ import annotations

from collections.abc import Callable

#: Hears the reason in a word, once when it begins.
OnRejected = Callable[[str], object]


def ignore_rejection(_: str) -> None:
    """Where nobody counts what is not believed."""
