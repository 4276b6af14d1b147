"""How much of a pulse one return may carry, when all other electrodes are its returns.

Owns: which electrodes are known to touch, for how long a look is believed, and the share that
follows. Must not know: caps, ledgers, hardware, clocks: time comes in.

A current is shared by those that touch. What no pulse has told for a second is not known, and when
one electrode loses contact, no look from before counts: whatever took it away may have taken
others. With nobody known, one return may carry it all.
"""

from __future__ import annotations

from collections import deque

from etd.stabilize.max_age import CONTACT_POLL_NS, MAX_AGE_NS, is_stale


class ReturnShare:
    """See the module."""

    def __init__(self, electrodes: int) -> None:
        self._electrodes = electrodes
        self.reset()

    def reset(self) -> None:
        """The supply was off: whoever touched may have gone."""
        self._touches = [False] * self._electrodes
        self._looked_ns: list[int | None] = [None] * self._electrodes
        #: Who is known to touch, and when each look ends.
        self._known: set[int] = set()
        self._ending: deque[tuple[int, int]] = deque()
        self._is_wanted = False

    def largest(self, electrode: int, now_ns: int) -> float:
        """The part of this electrode's current that one of all others may carry; 1 in doubt."""
        self._expire(now_ns)
        others = len(self._known) - (electrode in self._known)
        return 1.0 / max(1, others)

    def when_probed(self) -> float:
        """The same, once everybody has been looked at anew and nobody has gone."""
        return 1.0 / max(1, sum(self._touches) - 1)

    def want(self, now_ns: int) -> None:
        """A pulse got less than it wanted because of its returns: if that is for want of looks,
        look at everybody from now on.
        """
        self._expire(now_ns)
        if len(self._known) < sum(self._touches):
            self._is_wanted = True

    @property
    def is_wanted(self) -> bool:
        """Whether silent electrodes are to be looked at."""
        return self._is_wanted

    def is_due(self, electrode: int, now_ns: int) -> bool:
        """Whether it is time for a look at an electrode that had no pulse."""
        looked_ns = self._looked_ns[electrode]
        return looked_ns is None or now_ns - looked_ns >= CONTACT_POLL_NS

    def update(self, electrode: int, touches: bool, now_ns: int) -> None:
        """A pulse through all others told whether this one touches."""
        if not touches:
            self.lose(electrode)
        else:
            self._known.add(electrode)
            self._ending.append((now_ns + MAX_AGE_NS, electrode))
        self._touches[electrode] = touches
        self._looked_ns[electrode] = now_ns

    def lose(self, electrode: int) -> None:
        """It does not touch. If it did, the others are not known any more."""
        if self._touches[electrode]:
            self._known.clear()
            self._looked_ns[:] = [None] * self._electrodes
        self._touches[electrode] = False
        self._known.discard(electrode)

    def _expire(self, now_ns: int) -> None:
        while self._ending and self._ending[0][0] <= now_ns:
            _, electrode = self._ending.popleft()
            if is_stale(self._looked_ns[electrode], now_ns):
                self._known.discard(electrode)
