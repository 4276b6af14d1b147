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
    """Sums of what was booked in the last second."""

    __slots__ = ("charge_pc", "entries", "on_us", "pulses")

    def __init__(self) -> None:
        self.entries: deque[tuple[int, int, int, int]] = deque()
        self.charge_pc = 0
        self.on_us = 0
        self.pulses = 0

    def book(self, now_ns: int, charge_pc: int, on_us: int, pulses: int) -> None:
        self.entries.append((now_ns, charge_pc, on_us, pulses))
        self.charge_pc += charge_pc
        self.on_us += on_us
        self.pulses += pulses

    def forget(self, now_ns: int) -> None:
        entries, oldest_ns = self.entries, now_ns - WINDOW_NS
        while entries and entries[0][0] <= oldest_ns:
            _, charge_pc, on_us, pulses = entries.popleft()
            self.charge_pc -= charge_pc
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
        self._into_pool = [_Window() for _ in range(electrodes)]
        self._pool = _Window()
        self._array = _Window()
        #: Never below the largest (own sum - put into the pool) of any electrode.
        self._most_beside_pool_pc = 0

    def charge_pc(self, electrode: int, now_ns: int) -> int:
        """All that the electrode carried in the last second, as stimulated one and as return."""
        for window in (self._own[electrode], self._into_pool[electrode], self._pool):
            window.forget(now_ns)
        return self._beside_pool_pc(electrode) + self._pool.charge_pc

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
        bounds = self._bounds
        total_pc = self.charge_pc(entry.electrode, now_ns) + entry.charge_pc
        own = self._own[entry.electrode]
        self._array.forget(now_ns)
        if entry.pulses and now_ns < self.rested_ns(entry.electrode):
            return "interval"
        if own.pulses + entry.pulses > bounds.pulses:
            return "pulses"
        if total_pc > self._charge_pc:
            return "charge"
        if own.on_us + entry.on_us > bounds.on_us:
            return "duty"
        if self._array.charge_pc + entry.charge_pc > self._array_charge_pc:
            return "array charge"
        if self._array.on_us + entry.on_us > bounds.array_on_us:
            return "array duty"
        return None if self._returns_fit(entry, now_ns) else "return charge"

    def book(self, entry: Entry, now_ns: int) -> None:
        """What was fired."""
        electrode = entry.electrode
        if entry.pulses:
            self._begun_ns[electrode] = now_ns
        self._own[electrode].book(now_ns, entry.charge_pc, entry.on_us, entry.pulses)
        self._array.book(now_ns, entry.charge_pc, entry.on_us, entry.pulses)
        if entry.returns is None:
            share_pc = _share_pc(entry)
            self._pool.book(now_ns, share_pc, 0, 0)
            self._into_pool[electrode].book(now_ns, share_pc, 0, 0)
        for one in entry.returns or ():
            self._own[one].book(now_ns, entry.charge_pc, 0, 0)
            self._most_beside_pool_pc = max(self._most_beside_pool_pc, self._beside_pool_pc(one))
        self._most_beside_pool_pc = max(self._most_beside_pool_pc, self._beside_pool_pc(electrode))

    def book_excess(self, entry: Entry, excess_pc: int, now_ns: int) -> None:
        """What a message that took longer than planned may have added: to all in the path."""
        if entry.returns is None:
            share_pc = math.ceil(excess_pc * entry.share)
            self._pool.book(now_ns, share_pc, 0, 0)
            self._into_pool[entry.electrode].book(now_ns, share_pc, 0, 0)
        self._array.book(now_ns, excess_pc, 0, 0)
        for one in (entry.electrode, *(entry.returns or ())):
            self._own[one].book(now_ns, excess_pc, 0, 0)
            self._most_beside_pool_pc = max(self._most_beside_pool_pc, self._beside_pool_pc(one))

    def _beside_pool_pc(self, electrode: int) -> int:
        return self._own[electrode].charge_pc - self._into_pool[electrode].charge_pc

    def _returns_fit(self, entry: Entry, now_ns: int) -> bool:
        if entry.returns is not None:
            return all(
                self.charge_pc(one, now_ns) + entry.charge_pc <= self._charge_pc
                for one in entry.returns
            )
        room_pc = self._charge_pc - self._pool.charge_pc - _share_pc(entry)
        if self._most_beside_pool_pc > room_pc:
            self._most_beside_pool_pc = self._recount(now_ns)
        return self._most_beside_pool_pc <= room_pc

    def _recount(self, now_ns: int) -> int:
        for window in (*self._own, *self._into_pool):
            window.forget(now_ns)
        return max(self._beside_pool_pc(one) for one in range(len(self._own)))


def _share_pc(entry: Entry) -> int:
    """Rounded up: a ledger errs on the side of having given more."""
    return math.ceil(entry.charge_pc * entry.share)
