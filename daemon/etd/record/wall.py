"""Wall time of what a record has, from the clocks that it holds.

Owns: the relation of both clocks between two readings. Must not know: lines' other contents.
"""

from __future__ import annotations

import datetime

from etd.record.lines import Clocks

_BEGINNING = datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)


class WallClock:
    """Tell it each `Clocks` line; the newest holds."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None

    def heed(self, clocks: Clocks) -> None:
        self._offset_ns = clocks.wall_ns - clocks.t_ns + clocks.clock_lag_us * 1_000

    def iso(self, t_ns: int) -> str | None:
        """In UTC with milliseconds; None before the first reading."""
        if self._offset_ns is None:
            return None
        # Times of a record are within 300 years each, and so this is a date.
        at = _BEGINNING + datetime.timedelta(microseconds=(t_ns + self._offset_ns) // 1_000)
        return at.isoformat(timespec="milliseconds")
