"""What each electrode, and the array, got in the last second.

Owns: charge, pulses and time with current over a sliding window of one second, returns included,
the time of each electrode's last pulse, and whether one more pulse fits.
Must not know: why a pulse is wanted, hardware, clocks: time comes in.

Charge is in pC (uA x us), all phases counted positive. A pulse that returns through all others is
booked to a pool at the share that one return may carry: everybody's total is its own sum plus the
pool, less what it put into the pool itself. So a pulse costs the same work for 8 electrodes and
for 256.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import msgspec

from etd.maxima import Maxima

WINDOW_NS = 1_000_000_000
_PC_PER_UC = 1_000_000

LedgerReason = Literal[
    "interval", "charge", "pulses", "duty", "array charge", "array duty", "return charge"
]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Over any second; and between two pulses of one electrode."""

    interval_us: int
    mean_current_ua: int
    pulses: int
    on_us: int
    array_mean_current_ua: int
    array_on_us: int

    @classmethod
    def of(cls, maxima: Maxima) -> Bounds:
        """What nobody may get in any second."""
        return cls(
            interval_us=maxima.interval_us,
            mean_current_ua=maxima.mean_current_ua,
            pulses=maxima.rate_hz,
            on_us=maxima.on_us_per_s,
            array_mean_current_ua=maxima.array_mean_current_ua,
            array_on_us=maxima.array_on_us_per_s,
        )


class Entry(msgspec.Struct, frozen=True):
    """One visit, or a part of it: what the electrode gets, and who carries it back.

    `returns` None: all others, at `share` each; otherwise each named one as if it alone did.
    """

    electrode: int
    charge_pc: int
    on_us: int
    returns: tuple[int, ...] | None
    share: float
    #: 0 where it goes on with a visit that is booked already, as a pulse does after its probe.
    pulses: int = 1


class _Window:
    """Sums of what was booked in the last second; `pooled_pc` is what of it went into the pool."""

    __slots__ = ("charge_pc", "entries", "on_us", "pooled_pc", "pulses")

    def __init__(self) -> None:
        self.entries: deque[tuple[int, int, int, int, int]] = deque()
        self.charge_pc = 0
        self.pooled_pc = 0
        self.on_us = 0
        self.pulses = 0

    @property
    def beside_pool_pc(self) -> int:
        """Of one electrode: what it carried, but for what the pool has of it."""
        return self.charge_pc - self.pooled_pc

    def book(
        self, now_ns: int, charge_pc: int, pooled_pc: int = 0, on_us: int = 0, pulses: int = 0
    ) -> None:
        self.entries.append((now_ns, charge_pc, pooled_pc, on_us, pulses))
        self.charge_pc += charge_pc
        self.pooled_pc += pooled_pc
        self.on_us += on_us
        self.pulses += pulses

    def forget(self, now_ns: int) -> None:
        entries, oldest_ns = self.entries, now_ns - WINDOW_NS
        while entries and entries[0][0] <= oldest_ns:
            _, charge_pc, pooled_pc, on_us, pulses = entries.popleft()
            self.charge_pc -= charge_pc
            self.pooled_pc -= pooled_pc
            self.on_us -= on_us
            self.pulses -= pulses


class Ledger:
    """See the module."""

    def __init__(self, electrodes: int, bounds: Bounds) -> None:
        self._bounds = bounds
        self._charge_pc = bounds.mean_current_ua * _PC_PER_UC
        self._array_charge_pc = bounds.array_mean_current_ua * _PC_PER_UC
        self._interval_ns = bounds.interval_us * 1_000
        self._begun_ns: list[int | None] = [None] * electrodes
        self._own = [_Window() for _ in range(electrodes)]
        #: Of all together: what they have put into the pool is what is in it.
        self._array = _Window()
        #: Never below the largest (own sum - put into the pool) of any electrode.
        self._most_beside_pool_pc = 0

    def charge_pc(self, electrode: int, now_ns: int) -> int:
        """All that the electrode carried in the last second, as stimulated one and as return."""
        own, array = self._own[electrode], self._array
        own.forget(now_ns)
        array.forget(now_ns)
        return own.beside_pool_pc + array.pooled_pc

    def pulses(self, electrode: int, now_ns: int) -> int:
        """Its own pulses in the last second."""
        self.charge_pc(electrode, now_ns)
        return self._own[electrode].pulses

    def rested_ns(self, electrode: int) -> int:
        """From when on its next pulse may begin."""
        begun_ns = self._begun_ns[electrode]
        return 0 if begun_ns is None else begun_ns + self._interval_ns

    def why_not(self, entry: Entry, now_ns: int) -> LedgerReason | None:
        """The first bound that one more pulse would pass; None if it fits."""
        bounds, own, array = self._bounds, self._own[entry.electrode], self._array
        total_pc = self.charge_pc(entry.electrode, now_ns) + entry.charge_pc
        if entry.pulses and now_ns < self.rested_ns(entry.electrode):
            return "interval"
        if own.pulses + entry.pulses > bounds.pulses:
            return "pulses"
        if total_pc > self._charge_pc:
            return "charge"
        if own.on_us + entry.on_us > bounds.on_us:
            return "duty"
        if array.charge_pc + entry.charge_pc > self._array_charge_pc:
            return "array charge"
        if array.on_us + entry.on_us > bounds.array_on_us:
            return "array duty"
        return None if self._returns_fit(entry, now_ns) else "return charge"

    def book(self, entry: Entry, now_ns: int) -> None:
        """What was fired."""
        if entry.pulses:
            self._begun_ns[entry.electrode] = now_ns
        self._book(entry, entry.charge_pc, now_ns, entry.on_us, entry.pulses)

    def book_excess(self, entry: Entry, excess_pc: int, now_ns: int) -> None:
        """What a message that took longer than planned may have added: to all in the path."""
        self._book(entry, excess_pc, now_ns)

    def _book(
        self, entry: Entry, charge_pc: int, now_ns: int, on_us: int = 0, pulses: int = 0
    ) -> None:
        """So much for the electrode and the array, and for who carries it back."""
        pooled_pc = _share_pc(entry, charge_pc) if entry.returns is None else 0
        own = self._own[entry.electrode]
        own.book(now_ns, charge_pc, pooled_pc, on_us, pulses)
        self._array.book(now_ns, charge_pc, pooled_pc, on_us, pulses)
        most_pc = max(self._most_beside_pool_pc, own.beside_pool_pc)
        for one in entry.returns or ():
            carrying = self._own[one]
            carrying.book(now_ns, charge_pc)
            most_pc = max(most_pc, carrying.beside_pool_pc)
        self._most_beside_pool_pc = most_pc

    def _returns_fit(self, entry: Entry, now_ns: int) -> bool:
        if entry.returns is not None:
            return all(
                self.charge_pc(one, now_ns) + entry.charge_pc <= self._charge_pc
                for one in entry.returns
            )
        room_pc = self._charge_pc - self._array.pooled_pc - _share_pc(entry, entry.charge_pc)
        if self._most_beside_pool_pc > room_pc:
            self._most_beside_pool_pc = self._recount(now_ns)
        return self._most_beside_pool_pc <= room_pc

    def _recount(self, now_ns: int) -> int:
        for own in self._own:
            own.forget(now_ns)
        return max(own.beside_pool_pc for own in self._own)


def _share_pc(entry: Entry, charge_pc: int) -> int:
    """Rounded up: a ledger errs on the side of having given more."""
    return math.ceil(charge_pc * entry.share)
