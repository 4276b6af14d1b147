"""The net charge of each electrode: what pulses of one polarity leave as direct current.

Owns: the signed charge of each electrode, returns included, with a leak, its bound, and whether one
more pulse keeps it. Must not know: why a pulse is wanted, how contacts are measured, hardware,
clocks: time comes in.

Charge is in pC, positive into the skin (anodic). It leaks with a time constant of one second, so
that a bound in uC is as many uA of direct current that never ends. Every electrode counts its own
pulses, and carries back a part of those of others. No connection after a pulse is credited: what
passed the skin stays passed. See docs/decisions/0077.

How returns share is known within bounds only: while the capacitance of the skin charges, each
carries about as much as any other; after that, by conductance. So there are three accounts: with
even parts, with those that paths make likely, and with the most that each return may have beside
the others' likely parts, where one that a pulse names may carry all of it. Each keeps the bound;
what lies between ways to share leaves a charge between their accounts. Of `conducts_s` and
`beside_s` only ratios count: they may be parts of all, or S.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from typing import Final, NamedTuple

#: Of the leak: by design, of the order in which ions spread away from under an electrode.
LEAK_NS: Final = 1_000_000_000
#: After so many time constants the sums are moved to a new time: exp(30) is far from any bound.
_MOVED_AFTER = 30.0
#: Where no other conducts, in S: nothing is carried back then.
LEAST_S = 1e-12


class NetState(NamedTuple):
    """One account as it is now: by what parts returns share, the charge of each electrode, what the
    others of a return conduct beside it (None: as they do for themselves), and whether each return
    that a pulse names may carry all of it.
    """

    conducts_s: Sequence[float]
    left_pc: Sequence[float]
    beside_s: Sequence[float] | None = None
    is_named_whole: bool = False


class _Account:
    """One way to share: by these conductances, whose unit does not matter.

    All sums are kept as they were worth at one time, so that a pulse costs one exponential and
    nothing for each electrode. `growth`: what one pC of now counts among them.
    """

    def __init__(self, electrodes: int, bound_pc: int, *, is_named_whole: bool = False) -> None:
        self._bound_pc: Final = bound_pc
        self._is_named_whole: Final = is_named_whole
        self.conducts_s: Sequence[float] = [1.0] * electrodes
        self._beside_s: Sequence[float] = self.conducts_s
        self._whole_s = float(electrodes)
        self._others_s: Sequence[float] = others_s(self.conducts_s, self.conducts_s)
        self._best_s = 1.0
        #: By electrode: its own pulses, and what it carried back of those that name it, and of all
        #: pulses while other conductances held.
        self._own_pc = [0.0] * electrodes
        #: By electrode: its own pulses that return through all others, for each S of these; and all
        #: of these together.
        self._through = [0.0] * electrodes
        self._pool = 0.0
        #: By electrode: what the others' pulses had brought since it was read last, while other
        #: conductances held.
        self._unread_pc = [0.0] * electrodes
        #: Never above what is left to the electrode that is nearest to its bound.
        self._room_pc = float(bound_pc)

    def weigh(
        self, conducts_s: Sequence[float], beside_s: Sequence[float], read: Container[int] = ()
    ) -> None:
        """From now on returns share by these, each beside what the others of `beside_s` conduct.
        Those that were `read` may have conducted so ever since they were read before, and what they
        would have more by that counts, once.
        """
        everyone, whole_s = range(len(self._own_pc)), sum(beside_s)
        own_pc, unread_pc = list[float](), list[float]()
        for electrode in everyone:
            worth_pc, back_pc = self.worth_pc(electrode), self._back_pc(electrode)
            if electrode in read:
                before = self.conducts_s[electrode] / max(LEAST_S, self._whole_s)
                more = conducts_s[electrode] / max(LEAST_S, whole_s) - before
                worth_pc, back_pc = _larger(worth_pc, worth_pc - more * back_pc), 0.0
            own_pc.append(worth_pc)
            unread_pc.append(back_pc)
        self._own_pc, self._unread_pc = own_pc, unread_pc
        self._through, self._pool = [0.0] * len(self._own_pc), 0.0
        self.conducts_s, self._beside_s = conducts_s, beside_s
        self._whole_s, self._best_s = whole_s, max(conducts_s)
        self._others_s = others_s(conducts_s, beside_s)
        # What is left may be less by now: it is counted again.
        self._room_pc = -1.0

    def _back_pc(self, electrode: int) -> float:
        """What others' pulses brought since it was read last, of which each carries its part."""
        carried = self._pool - self._through[electrode]
        return self._unread_pc[electrode] + carried * self._whole_s

    @property
    def has_room(self) -> bool:
        """Whether no electrode is above its bound; False, too, where that must be counted."""
        return self._room_pc >= 0.0

    def state(self, growth: float) -> NetState:
        left_pc = [self.worth_pc(electrode) / growth for electrode in range(len(self._own_pc))]
        return NetState(self.conducts_s, left_pc, self._beside_s, self._is_named_whole)

    def worth_pc(self, electrode: int) -> float:
        carried = self._pool - self._through[electrode]
        return self._own_pc[electrode] - self.conducts_s[electrode] * carried

    def fits(
        self, electrode: int, net_pc: int, returns: tuple[int, ...] | None, growth: float
    ) -> bool:
        if not self._stays(self.worth_pc(electrode) / growth, net_pc):
            return False
        if returns is not None:
            return all(
                self._stays(self.worth_pc(other) / growth, -net_pc * part)
                for other, part in zip(returns, self._parts_of(returns), strict=True)
            )
        each = net_pc / self._others_s[electrode]
        if self._room_pc >= abs(each) * self._best_s:
            return True
        before_pc = [self.worth_pc(other) / growth for other in range(len(self._own_pc))]
        self._room_pc = self._bound_pc - max(map(abs, before_pc))
        return all(
            other == electrode or self._stays(other_pc, -each * self.conducts_s[other])
            for other, other_pc in enumerate(before_pc)
        )

    def add(
        self, electrode: int, net_pc: float, returns: tuple[int, ...] | None, growth: float
    ) -> None:
        worth_pc = net_pc * growth
        self._own_pc[electrode] += worth_pc
        if returns is None:
            others_s = self._others_s[electrode]
            self._through[electrode] += worth_pc / others_s
            self._pool += worth_pc / others_s
            self._room_pc -= abs(net_pc) * self._best_s / others_s
        else:
            for other, part in zip(returns, self._parts_of(returns), strict=True):
                self._own_pc[other] -= worth_pc * part
            self._room_pc -= abs(net_pc)
        own_pc = abs(self.worth_pc(electrode) / growth)
        self._room_pc = min(self._room_pc, self._bound_pc - own_pc)

    def scale(self, factor: float) -> None:
        self._own_pc = [pc * factor for pc in self._own_pc]
        self._through = [value * factor for value in self._through]
        self._unread_pc = [pc * factor for pc in self._unread_pc]
        self._pool *= factor

    def _parts_of(self, returns: tuple[int, ...]) -> list[float]:
        return parts_of(returns, self.conducts_s, is_whole=self._is_named_whole)

    def _stays(self, before_pc: float, more_pc: float) -> bool:
        """Within its bound, or nearer to it."""
        after_pc = abs(before_pc + more_pc)
        return after_pc <= self._bound_pc or after_pc < abs(before_pc)


class NetCharge:
    def __init__(self, electrodes: int, bound_pc: int) -> None:
        self.bound_pc: Final = bound_pc
        self._even: Final = _Account(electrodes, bound_pc)
        self._measured: Final = _Account(electrodes, bound_pc)
        self._most: Final = _Account(electrodes, bound_pc, is_named_whole=True)
        self._accounts: Final = (self._even, self._measured, self._most)
        #: What the sums were worth at that time.
        self._at_ns = 0
        #: Pulses through all others; and, by electrode, these when it was read last.
        self._through_pc = 0.0
        self._read_pc = [0.0] * electrodes
        #: What the last scan brought through all others, and what there was at its end.
        self.scan_pc = self._scanned_pc = 0.0
        #: Read since the last conductances; and, of these, those that conduct better by now.
        self._read: set[int] = set()
        self._better: set[int] = set()

    def set_conductances(self, conducts_s: Sequence[float], most_s: Sequence[float]) -> None:
        """By electrode, in any unit, what it likely conducts and the most that it may; from now on
        returns share by these.
        """
        self._measured.weigh(conducts_s, conducts_s, self._read)
        self._most.weigh(most_s, conducts_s, self._read)
        for electrode in self._better:
            self._read_pc[electrode] = self._through_pc
        self._read.clear()
        self._better.clear()

    def read(self, electrode: int, *, is_as_before: bool) -> None:
        """A pulse has measured what this electrode conducts; `set_conductances` says it. One that
        conducts better than before is unread until then.
        """
        self._read.add(electrode)
        if is_as_before:
            self._read_pc[electrode] = self._through_pc
        else:
            self._better.add(electrode)

    def unread_pc(self, electrode: int, now_ns: int) -> float:
        """What is left of all pulses through all others since it was read last: so much it may have
        beside what is counted, if it conducts better by now than all others together.
        """
        return abs(self._through_pc - self._read_pc[electrode]) / self._growth(now_ns)

    def scan_over(self, now_ns: int) -> None:
        """All pulses of a frame's scan were fired."""
        self.scan_pc = abs(self._through_pc - self._scanned_pc) / self._growth(now_ns)
        self._scanned_pc = self._through_pc

    def of(self, electrode: int, now_ns: int) -> float:
        """In the account in which it has most."""
        growth = self._growth(now_ns)
        return max((account.worth_pc(electrode) / growth for account in self._accounts), key=abs)

    def all(self, now_ns: int) -> list[float]:
        return [self.of(electrode, now_ns) for electrode in range(len(self._read_pc))]

    def states(self, now_ns: int) -> tuple[NetState, ...]:
        """Of all accounts."""
        growth = self._growth(now_ns)
        return tuple(account.state(growth) for account in self._accounts)

    def exceeds_one_return(self, now_ns: int) -> bool:
        """Whether a single return that carries all of it would have more than its bound."""
        return abs(self._through_pc / self._growth(now_ns)) > self.bound_pc

    def fits(
        self, electrode: int, net_pc: int, returns: tuple[int, ...] | None, now_ns: int
    ) -> bool:
        """Whether no electrode of the path would pass its bound, but those that it brings back.
        What leaves nothing does not fit where one is above it: so much came from phases that took
        longer than their plan.
        """
        if not net_pc and all(account.has_room for account in self._accounts):
            return True
        growth = self._growth(now_ns)
        return all(account.fits(electrode, net_pc, returns, growth) for account in self._accounts)

    def add(
        self, electrode: int, net_pc: float, returns: tuple[int, ...] | None, now_ns: int
    ) -> None:
        """The pulse counts as one of `now_ns`. A negative amount takes back what was added."""
        if not net_pc:
            return
        growth = self._growth(now_ns)
        for account in self._accounts:
            account.add(electrode, net_pc, returns, growth)
        if returns is None:
            self._through_pc += net_pc * growth

    def _growth(self, now_ns: int) -> float:
        """What one pC of now counts among the sums."""
        passed = (now_ns - self._at_ns) / LEAK_NS
        if passed > _MOVED_AFTER:
            self._move_to(now_ns)
            return 1.0
        return math.exp(passed)

    def _move_to(self, now_ns: int) -> None:
        """The sums as they are worth now."""
        factor = math.exp((self._at_ns - now_ns) / LEAK_NS)
        self._at_ns = now_ns
        for account in self._accounts:
            account.scale(factor)
        self._through_pc *= factor
        self._scanned_pc *= factor
        self._read_pc = [pc * factor for pc in self._read_pc]


def others_s(conducts_s: Sequence[float], beside_s: Sequence[float]) -> list[float]:
    """By electrode, what the others of its pulses conduct: each by `conducts_s` beside what
    `beside_s` has, and none of them more than all together.
    """
    whole_s, ordered = sum(beside_s), sorted(conducts_s)
    best_s, next_s = ordered[-1], ordered[-2] if len(ordered) > 1 else 0.0
    return [
        max(LEAST_S, whole_s - at_s, best_s if own_s < best_s else next_s)
        for own_s, at_s in zip(conducts_s, beside_s, strict=True)
    ]


def parts_of(
    returns: tuple[int, ...], conducts_s: Sequence[float], *, is_whole: bool
) -> list[float]:
    """Of a pulse that returns through these; `is_whole`: the most, since no pulse through all
    others may have measured them.
    """
    if is_whole:
        return [1.0] * len(returns)
    named_s = [conducts_s[other] for other in returns]
    whole_s = sum(named_s)
    if whole_s <= LEAST_S:
        return [1.0 / len(returns)] * len(returns)
    return [own_s / whole_s for own_s in named_s]


def _larger(one_pc: float, other_pc: float) -> float:
    return one_pc if abs(one_pc) >= abs(other_pc) else other_pc
