"""How long a message of another process holds, and how long the stopper may be silent.

Owns: a frame's, a lease's and a sign of life's duration, which count on the machine's own clock;
that of the stopper, which counts on the board's; and the factor that lengthens them. Must not know:
clocks, sockets, which backend there is.

They end a current whose sender, or whose stopper, is gone. With a real board the factor is always 1
(`etd_hal.backend.Backend` enforces it); a fake board on a busy machine may have a larger factor.
"""

from __future__ import annotations

from etd.engine.stopper import SILENT_NS as STOPPER_SILENT_NS
from etd.protocol.link import SILENCE_NS
from etd.protocol.messages import LEASE_MS

_MS = 1_000_000


class Timeouts:
    """The protocol's durations times `factor`."""

    def __init__(self, factor: int = 1) -> None:
        self.factor = factor
        self.lease_ns = factor * LEASE_MS * _MS
        self.silence_ns = factor * SILENCE_NS
        self.stopper_silence_ns = factor * STOPPER_SILENT_NS

    def ttl_ns(self, ttl_ms: int) -> int:
        """How long a frame with this ttl is shown."""
        return self.factor * ttl_ms * _MS
