"""The daemon's clock, as a client on another computer knows it.

Owns: the bounds of the offset between the two CLOCK_MONOTONIC, from requests and their replies.
Must not know: sockets, what is asked.

A reply's `now_ns` lies between the request and the reply, so each exchange bounds the offset; the
narrowest bounds hold, and widen as clocks drift apart.
"""

from __future__ import annotations

#: Two crystals are 100 ppm apart at most.
_DRIFT_PPM = 100


class DaemonClock:
    """On the same machine both clocks are one: there the offset is 0, without uncertainty."""

    def __init__(self, *, is_here: bool) -> None:
        self._is_here = is_here
        #: What the daemon's clock is ahead, in ns, at least and at most; None: not known yet.
        self._bounds: tuple[int, int] | None = (0, 0) if is_here else None
        self._seen_ns = 0

    def observe(self, sent_ns: int, got_ns: int, daemon_ns: int) -> None:
        """A request left at `sent_ns` and its reply came at `got_ns`, by this computer's clock."""
        if self._is_here:
            return
        low, high = daemon_ns - got_ns, daemon_ns - sent_ns
        if self._bounds is not None:
            drift_ns = self._drift_ns(got_ns)
            known_low, known_high = self._bounds[0] - drift_ns, self._bounds[1] + drift_ns
            # Bounds that exclude one another: one of the clocks has slept.
            if low <= known_high and known_low <= high:
                low, high = max(low, known_low), min(high, known_high)
        self._bounds, self._seen_ns = (low, high), got_ns

    def at_least_ns(self, here_ns: int) -> int:
        """What the daemon's clock showed at least: a frame stamped with it is never shown for
        longer than it was meant to be.
        """
        return here_ns + (0 if self._bounds is None else self._bounds[0] - self._drift_ns(here_ns))

    def _drift_ns(self, here_ns: int) -> int:
        """By how much the bounds have widened since the last exchange."""
        return 0 if self._is_here else max(0, here_ns - self._seen_ns) * _DRIFT_PPM // 1_000_000

    @property
    def offset_ns(self) -> int:
        """What the daemon's clock is ahead, as well as it is known."""
        return 0 if self._bounds is None else sum(self._bounds) // 2

    @property
    def uncertainty_ns(self) -> int:
        """The offset is right within so much, either way."""
        return 0 if self._bounds is None else -(-(self._bounds[1] - self._bounds[0]) // 2)
