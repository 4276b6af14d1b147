"""The net charge of each electrode: what pulses of one polarity leave as direct current.

Owns: the signed charge of each electrode, returns included, with a leak, its bound, and whether one
more pulse keeps it. Must not know: why a pulse is wanted, hardware, clocks: time comes in.

Charge is in pC, positive into the skin (anodic). It leaks with a time constant of one second, so
that a bound in uC is as many uA of direct current that never ends. Every electrode counts its own
pulses, and carries back an even part of those of others: with pulses at all electrodes alike, next
to nothing is left anywhere. No connection after a pulse is credited: what passed the skin stays
passed. See docs/decisions/0077.

All sums are kept as they were worth at one time, so that a pulse costs one exponential and nothing
for each electrode.
"""

from __future__ import annotations

import math
from typing import Final

#: Of the leak: by design, of the order in which ions spread away from under an electrode.
LEAK_NS: Final = 1_000_000_000
#: After so many time constants the sums are moved to a new time: exp(30) is far from any bound.
_MOVED_AFTER = 30.0


class NetCharge:
    def __init__(self, electrodes: int, bound_pc: int) -> None:
        self.bound_pc: Final = bound_pc
        self._others: Final = max(1, electrodes - 1)
        #: What these sums were worth at `_at_ns`.
        self._at_ns = 0
        #: By electrode: its own pulses, and what it carried back of those that name it.
        self._own_pc = [0.0] * electrodes
        #: By electrode: its own pulses that return through all others; and all of these.
        self._through_pc = [0.0] * electrodes
        self._pool_pc = 0.0
        #: Never above what is left to the electrode that is nearest to its bound.
        self._room_pc = float(bound_pc)

    def of(self, electrode: int, now_ns: int) -> float:
        return self._worth_pc(electrode) / self._growth(now_ns)

    def all(self, now_ns: int) -> list[float]:
        growth = self._growth(now_ns)
        return [self._worth_pc(electrode) / growth for electrode in range(len(self._own_pc))]

    def fits(
        self, electrode: int, net_pc: int, returns: tuple[int, ...] | None, now_ns: int
    ) -> bool:
        """Whether no electrode of the path would pass its bound, but those that it brings back."""
        if not net_pc:
            return True
        if not self._stays(self.of(electrode, now_ns), net_pc):
            return False
        each_pc = -net_pc / (self._others if returns is None else len(returns))
        if returns is not None:
            return all(self._stays(self.of(other, now_ns), each_pc) for other in returns)
        if self._room_pc >= abs(each_pc):
            return True
        before_pc = self.all(now_ns)
        self._room_pc = self.bound_pc - max(map(abs, before_pc))
        del before_pc[electrode]
        return all(self._stays(other_pc, each_pc) for other_pc in before_pc)

    def add(
        self, electrode: int, net_pc: float, returns: tuple[int, ...] | None, now_ns: int
    ) -> None:
        """The pulse counts as one of `now_ns`. A negative amount takes back what was added."""
        if not net_pc:
            return
        worth_pc = net_pc * self._growth(now_ns)
        self._own_pc[electrode] += worth_pc
        if returns is None:
            self._through_pc[electrode] += worth_pc
            self._pool_pc += worth_pc
            self._room_pc -= abs(net_pc) / self._others
        else:
            each_pc = worth_pc / len(returns)
            for other in returns:
                self._own_pc[other] -= each_pc
            self._room_pc -= abs(net_pc) / len(returns)
        self._room_pc = min(self._room_pc, self.bound_pc - abs(self.of(electrode, now_ns)))

    def _stays(self, before_pc: float, more_pc: float) -> bool:
        after_pc = abs(before_pc + more_pc)
        return after_pc <= self.bound_pc or after_pc < abs(before_pc)

    def _worth_pc(self, electrode: int) -> float:
        """At `_at_ns`."""
        through_pc = self._through_pc[electrode]
        return self._own_pc[electrode] - (self._pool_pc - through_pc) / self._others

    def _growth(self, now_ns: int) -> float:
        """What one pC of now counts among the sums."""
        passed = (now_ns - self._at_ns) / LEAK_NS
        if passed > _MOVED_AFTER:
            self._move_to(now_ns)
            return 1.0
        return math.exp(passed)

    def _move_to(self, now_ns: int) -> None:
        """What is left of sums so old is nothing that counts."""
        factor = math.exp(-min(700.0, (now_ns - self._at_ns) / LEAK_NS))
        self._at_ns = now_ns
        self._own_pc = [pc * factor for pc in self._own_pc]
        self._through_pc = [pc * factor for pc in self._through_pc]
        self._pool_pc *= factor
