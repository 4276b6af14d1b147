"""What the log says of leases, of which any client can open and close a thousand in a second.

Owns: which openings have lines of their own, and the count of the others. Must not know: how a line
is written, time: the journal says when one summary ends and the next begins.
"""

from __future__ import annotations

from collections import Counter

from etd.gateway.lease import StandingLease
from etd.protocol.who import who

#: Between two summaries, so many openings are told one by one: of one client, and of all.
MOST_OF_ONE = 3
MOST_OF_ALL = 20


class LeaseLog:
    """Each call returns the lines there are to write."""

    def __init__(self) -> None:
        self._holder: StandingLease | None = None
        self._is_holder_told = False
        self._told: Counter[str] = Counter()
        #: By who; "" for clients of whom nothing was told.
        self._untold: Counter[str] = Counter()

    def changed(self, standing: StandingLease | None) -> list[str]:
        """After each turn: the lease that stands now."""
        lines: list[str] = []
        if standing is self._holder:
            return lines
        before, self._holder = self._holder, standing
        if before is not None and self._is_holder_told:
            lines.append(f"lease of {before.client!r} ended")
        if standing is not None:
            lines += self._opened(who(standing.client, standing.uid))
        return lines

    def summary(self) -> list[str]:
        """What had no line of its own, and whose lease stands if that was not told."""
        lines: list[str] = []
        if self._untold:
            others = self._untold.pop("", 0)
            counts = [f"{count} by {named}" for named, count in sorted(self._untold.items())]
            counts += [f"{others} by other clients"] if others else []
            lines.append(f"since the last summary: more leases opened: {', '.join(counts)}")
        if self._holder is not None and not self._is_holder_told:
            lines.append(f"the lease is now held by {who(self._holder.client, self._holder.uid)}")
            self._is_holder_told = True
        self._told.clear()
        self._untold.clear()
        return lines

    def _opened(self, named: str) -> list[str]:
        self._is_holder_told = self._told[named] < MOST_OF_ONE and self._told.total() < MOST_OF_ALL
        if self._is_holder_told:
            self._told[named] += 1
            return [f"lease opened by {named}"]
        self._untold[named if self._told[named] else ""] += 1
        return []
