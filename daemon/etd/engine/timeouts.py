"""How long what another process said holds: a frame, a lease, a sign of life.

Owns: the three durations that count on the machine's own clock, and the one way in which they are
lengthened. Must not know: clocks, sockets, which backend there is.

They are what ends a current whose sender is gone. The factor is 1 with a real board, always
(`etd_hal.backend.Backend` holds that); a fake on a busy machine may have a larger one.
"""

from __future__ import annotations

from etd.protocol.link import SILENCE_NS
from etd.protocol.messages import LEASE_MS

_MS = 1_000_000


class Timeouts:
    """Each is so many times as long as the protocol says."""

    def __init__(self, factor: int = 1) -> None:
        self.factor = factor
        self.lease_ns = factor * LEASE_MS * _MS
        self.silence_ns = factor * SILENCE_NS

    def ttl_ns(self, ttl_ms: int) -> int:
        """How long a frame with this ttl is felt."""
        return self.factor * ttl_ms * _MS
