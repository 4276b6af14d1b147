"""How a law reports that it rejects a measurement.

Owns: the callback's type. Must not know: where it leads, what is rejected.
"""

from __future__ import annotations

from collections.abc import Callable

#: Called with the reason in a word, once when a rejection begins.
OnRejected = Callable[[str], object]


def ignore_rejection(_: str) -> None:
    """Where rejections are not counted."""
