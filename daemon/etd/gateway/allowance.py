"""How much a user may add to a record, beside what is shown.

Owns: the amount at once, and how fast it comes back. Must not know: records, what is added. Time
comes in.
"""

from __future__ import annotations

from typing import Final

#: At once: some hundreds of the longest notes, or thousands of requests.
MOST_BYTES: Final = 1_048_576
#: And then: 59 MB in an hour.
BYTES_A_SECOND: Final = 16_384


class Allowance:
    """Whole when made."""

    def __init__(self, now_ns: int) -> None:
        self._left_bytes = float(MOST_BYTES)
        self._at_ns = now_ns

    def take(self, count_bytes: int, now_ns: int) -> bool:
        """False: so much is not left now, and nothing was taken."""
        back = max(0, now_ns - self._at_ns) * BYTES_A_SECOND / 1e9
        self._at_ns = now_ns
        self._left_bytes = min(float(MOST_BYTES), self._left_bytes + back)
        if count_bytes > self._left_bytes:
            return False
        self._left_bytes -= count_bytes
        return True
