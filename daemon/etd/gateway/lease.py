"""The lease as the gateway knows it: a first check, which refuses other clients' frames.

Owns: token, holder, and the last seq passed on. Must not know: when a lease lapses; the engine
decides that, and reports it.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass

from etd.protocol.errors import Refused
from etd.protocol.opening import Limits, NamedCalibration


@dataclass(slots=True)
class StandingLease:
    token: str
    client: str
    uid: int | None
    #: What it was opened with: calibrations of one person, or limits.
    calibrations: tuple[NamedCalibration, ...] = ()
    limits: Limits | None = None
    last_seq: int = -1


class LeaseView:
    """At most one lease stands. The last one that ended is remembered: its accounts are kept."""

    def __init__(self) -> None:
        self.standing: StandingLease | None = None
        self._ended: StandingLease | None = None
        self._why_none = "none has been opened"

    def begin(self, lease: StandingLease) -> None:
        """The engine has granted it."""
        self._ended = None
        self.standing = lease

    def end(self, token: str, why: str) -> None:
        """The engine has ended this lease. Another lease is not affected."""
        if self.standing is not None and self.standing.token == token:
            self._ended, self.standing = self.standing, None
            self._why_none = f"the last one ended: {why}"

    def reset(self) -> None:
        """The engine is gone, and every lease with it."""
        if self.standing is not None:
            self.end(self.standing.token, "the engine is gone")
        self._ended = None

    def check(self, token: str, uid: int | None) -> StandingLease:
        """The lease with this token, if it stands and belongs to this user.

        Raises: Refused (`no_lease`, `other_lease`).
        """
        lease = self.standing
        if lease is None:
            raise Refused("no_lease", f"there is no lease ({self._why_none}): open one")
        if not hmac.compare_digest(lease.token.encode(), token.encode()):
            raise Refused("other_lease", f"the lease is now held by {lease.client!r}")
        if lease.uid != uid:
            raise Refused("other_lease", "the lease was opened by another user of this machine")
        return lease

    def has_ended(self, token: str, uid: int | None) -> bool:
        """Whether it is the last lease, of this user, that no other has followed yet."""
        ended = self._ended
        if ended is None or ended.uid != uid:
            return False
        return hmac.compare_digest(ended.token.encode(), token.encode())

    def check_seq(self, lease: StandingLease, seq: int) -> None:
        """Raises: Refused (`old_seq`)."""
        if seq <= lease.last_seq:
            raise Refused(
                "old_seq", f"seq {seq} follows {lease.last_seq}: seq must increase within a lease"
            )
