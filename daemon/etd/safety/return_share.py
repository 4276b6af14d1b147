"""How much of a pulse one return may carry, when all other electrodes are its returns.

Owns: which electrodes are known to touch, how long a contact poll counts, and the share that
follows. Must not know: caps, ledgers, hardware, clocks: time comes in.

The electrodes that touch share the current. A contact that no pulse has measured for a second is
unknown. When one electrode loses contact, no measurement from before counts: what moved it may have
moved others. While no contact is known, one return may carry all of it.
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
        """The supply was off: any contact may have changed."""
        self._touches = [False] * self._electrodes
        self._looked_ns: list[int | None] = [None] * self._electrodes
        #: The electrodes known to touch, and when each measurement expires.
        self._known: set[int] = set()
        self._ending: deque[tuple[int, int]] = deque()
        self._is_wanted = False

    def largest(self, electrode: int, now_ns: int) -> float:
        """The part of this electrode's current that one of all others may carry; 1 in doubt."""
        self._expire(now_ns)
        others = len(self._known) - (electrode in self._known)
        return 1.0 / max(1, others)

    def when_probed(self) -> float:
        """The share once every contact is measured anew and none is lost."""
        return 1.0 / max(1, sum(self._touches) - 1)

    def want(self, now_ns: int) -> None:
        """A pulse got less than requested because of its returns. If the reason is that contacts
        are not known, silent electrodes are polled from now on.
        """
        self._expire(now_ns)
        if len(self._known) < sum(self._touches):
            self._is_wanted = True

    @property
    def is_wanted(self) -> bool:
        """Whether silent electrodes are to be polled."""
        return self._is_wanted

    def is_due(self, electrode: int, now_ns: int) -> bool:
        """Whether an electrode without a pulse is due for a contact poll."""
        looked_ns = self._looked_ns[electrode]
        return looked_ns is None or now_ns - looked_ns >= CONTACT_POLL_NS

    def update(self, electrode: int, touches: bool, now_ns: int) -> None:
        """A pulse through all others has measured whether this electrode touches."""
        if not touches:
            self.lose(electrode)
        else:
            self._known.add(electrode)
            self._ending.append((now_ns + MAX_AGE_NS, electrode))
        self._touches[electrode] = touches
        self._looked_ns[electrode] = now_ns

    def lose(self, electrode: int) -> None:
        """This electrode does not touch. If it did before, no contact is known any more."""
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
