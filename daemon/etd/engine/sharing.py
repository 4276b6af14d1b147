"""How much of a pulse one return may carry, when all other electrodes are its returns.

Owns: the conductances that pulses have told, how long each is believed, and the largest share.
Must not know: caps, ledgers, what follows from a share, hardware, clocks: time comes in.

A current divides by conductance. Electrodes that had a pulse in the last second are known. The
others are vouched for by every pulse that goes through them, because the resistance of its whole
path rises when returns are lost. What a rise below `TOLERANCE` could hide is reckoned as lost.
After a larger one, while pulses tell nothing, and from the first electrode that lost contact until
the next arming, only electrodes visited in the last second count.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

#: A visit is as good as a look for this long; and pulses that tell nothing are borne as long.
FRESH_NS = 1_000_000_000

#: Of a path's resistance: less than this is not told from sweat and pressure.
TOLERANCE = 0.1

_NS_PER_SIEMENS = 1e9


@dataclass(frozen=True, slots=True)
class _Reference:
    """The least that a path resisted, and what may have been lost before without being seen.

    The least, because skin resists less at higher currents and with sweat: a path that resists
    no more than this has lost nothing.
    """

    path_ohm: int
    unseen_ohm: float


class Sharing:
    """See the module. Conductances are whole nanosiemens, so that sums stay exact."""

    def __init__(self, electrodes: int) -> None:
        self._electrodes = electrodes
        self.forget()

    def forget(self) -> None:
        """The supply was off: whoever touched may have gone."""
        self._known = [0] * self._electrodes
        self._fresh = [0] * self._electrodes
        self._fresh_until_ns = [0] * self._electrodes
        self._expiring: deque[tuple[int, int]] = deque()
        #: By electrode and width: in narrower pulses the same skin seems to resist less.
        self._references: dict[tuple[int, int], _Reference] = {}
        self._doubtful: set[int] = set()
        self._was_lost = False
        self._untold_since_ns: int | None = None
        self._unseen_ohm = 0.0

    def largest(self, electrode: int, now_ns: int) -> float:
        """The part of this electrode's current that one of all others may carry; 1 in doubt."""
        self._expire(now_ns)
        way_ohm = self._way_ohm(electrode, now_ns)
        if way_ohm is None:
            return 1.0
        others = self._known[:electrode] + self._known[electrode + 1 :]
        return min(1.0, max(others) / _NS_PER_SIEMENS * way_ohm)

    def learn(self, electrode: int, width_us: int, path_ohm: int | None, now_ns: int) -> None:
        """One pulse that was fired through all others; `path_ohm` None: it touches nobody."""
        was_touched, was_seen = self._known[electrode] > 0, self._fresh_until_ns[electrode] > 0
        conductance = 0 if path_ohm is None else round(_NS_PER_SIEMENS / max(1, path_ohm))
        self._known[electrode] = self._fresh[electrode] = conductance
        self._fresh_until_ns[electrode] = now_ns + FRESH_NS
        self._expiring.append((now_ns + FRESH_NS, electrode))
        before = self._references.get((electrode, width_us))
        if path_ohm is None:
            self._was_lost |= was_touched
        elif before is not None:
            self._compare(electrode, width_us, path_ohm, before)
        elif self._believes(now_ns):
            self._references[electrode, width_us] = _Reference(path_ohm, self._unseen_ohm)
            if was_seen and self._untold_since_ns is None:
                self._untold_since_ns = now_ns

    def lose(self, electrode: int) -> None:
        """A pulse through chosen returns found it open; of the others it said nothing."""
        self._was_lost |= self._known[electrode] > 0
        self._known[electrode] = self._fresh[electrode] = 0

    # --- who is there ------------------------------------------------------------------------

    def _way_ohm(self, electrode: int, now_ns: int) -> float | None:
        """The most that the others may resist together; None when nobody is known to be there."""
        ways = []
        fresh = sum(self._fresh) - self._fresh[electrode]
        if fresh > 0:
            ways.append(_NS_PER_SIEMENS / fresh)
        known = sum(self._known) - self._known[electrode]
        if known > 0 and self._believes(now_ns):
            ways.append(_NS_PER_SIEMENS / known + self._unseen_ohm)
        return min(ways, default=None)

    def _expire(self, now_ns: int) -> None:
        while self._expiring and self._expiring[0][0] <= now_ns:
            until_ns, electrode = self._expiring.popleft()
            if self._fresh_until_ns[electrode] == until_ns:
                self._fresh[electrode] = 0

    # --- what pulses say of those they do not visit ------------------------------------------

    def _believes(self, now_ns: int) -> bool:
        if self._doubtful or self._was_lost:
            return False
        since_ns = self._untold_since_ns
        return since_ns is None or now_ns - since_ns < FRESH_NS

    def _compare(self, electrode: int, width_us: int, path_ohm: int, before: _Reference) -> None:
        slack_ohm = TOLERANCE * before.path_ohm
        if path_ohm > before.path_ohm + slack_ohm:
            self._doubtful.add(electrode)
            return
        self._doubtful.discard(electrode)
        self._untold_since_ns = None
        self._unseen_ohm = before.unseen_ohm + slack_ohm
        if path_ohm < before.path_ohm:
            self._references[electrode, width_us] = _Reference(path_ohm, before.unseen_ohm)
