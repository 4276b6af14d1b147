"""What the log says of leases, of which any client can open and close a thousand in a second.

Owns: the lines of their beginnings and ends. Must not know: how many have lines of their own
(`summed_up.py`), time.
"""

from __future__ import annotations

import logging

from etd.gateway.lease import StandingLease
from etd.gateway.summed_up import SummedUp
from etd.protocol.who import who


class LeaseLog:
    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._openings = SummedUp(log, "leases opened")
        self._holder: StandingLease | None = None
        self._is_holder_told = False

    def changed(self, standing: StandingLease | None) -> None:
        """After each turn: the lease that stands now."""
        if standing is self._holder:
            return
        before, self._holder = self._holder, standing
        if before is not None and self._is_holder_told:
            self._log.info("lease of %r ended", before.client)
        if standing is not None:
            line = f"lease opened by {who(standing.client, standing.uid)}"
            self._is_holder_told = self._openings.tell(f"user {standing.uid}", logging.INFO, line)

    def sum_up(self) -> None:
        """What had no line of its own, and whose lease stands if that was not told."""
        self._openings.sum_up()
        holder = self._holder
        if holder is not None and not self._is_holder_told:
            self._log.info("the lease is now held by %s", who(holder.client, holder.uid))
            self._is_holder_told = True
