"""The one lease, on the machine's clock.

Owns: its holder, its end, and the rising seq of its frames. Must not know: sockets, what the holder
wants. Time comes in.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.protocol.errors import Refused
from etd.protocol.opening import LeaseCalibration
from etd.safety.limits import PersonLimits


@dataclass(slots=True)
class Lease:
    """A standing lease with the limits of the person it is for."""

    token: str
    client: str
    person: PersonLimits
    #: How long it lasts after a renewal.
    lasts_ns: int
    #: What its caps are from; none where they are numbers.
    calibrations: tuple[LeaseCalibration, ...] = ()
    lapses_host_ns: int = 0
    last_seq: int = -1

    def renew(self, host_ns: int) -> None:
        """Called for each frame that says that its client lives, and for `keep`."""
        self.lapses_host_ns = host_ns + self.lasts_ns

    def has_lapsed(self, host_ns: int) -> bool:
        return host_ns >= self.lapses_host_ns


def calibrations_of(lease: Lease | None) -> tuple[LeaseCalibration, ...]:
    """With which a lease stands, if one does."""
    return () if lease is None else lease.calibrations


def check_holder(lease: Lease | None, token: str) -> Lease:
    """The standing lease, if `token` belongs to it. Raises: Refused."""
    if lease is None:
        raise Refused("no_lease", "no lease stands: open one (it may have lapsed)")
    if lease.token != token:
        raise Refused("other_lease", f"the lease is held by {lease.client!r}")
    return lease


def check_seq(lease: Lease, seq: int) -> None:
    """Raises: Refused (`old_seq`)."""
    if seq <= lease.last_seq:
        raise Refused("old_seq", f"seq {seq} is not above {lease.last_seq}, the last one taken")
