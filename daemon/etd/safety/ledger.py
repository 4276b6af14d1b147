"""The charge, pulses and time with current of each electrode, and of the array, in the last second.

Owns: charge, pulses and time with current over a sliding window of one second, returns included,
the time of each electrode's last pulse, and whether one more pulse fits.
Must not know: why a pulse is wanted, hardware, clocks: time comes in.

A pulse is booked before it is sent, at its worst case, and corrected to the charge it had
(`firing.py`). An entry that is never corrected stays at its worst case.

Charge is in pC (uA x us), all phases counted positive. A pulse that returns through all others is
booked to a pool at the share that one return may carry: the total of an electrode is its own sum
plus the pool, less what it put into the pool itself. So a pulse costs the same work for 8
electrodes and for 256.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import msgspec

from etd.safety.maxima import Maxima

WINDOW_NS = 1_000_000_000
_PC_PER_UC = 1_000_000

LedgerReason = Literal[
    "interval", "charge", "pulses", "duty", "array charge", "array duty", "return charge"
]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds over any second, and the interval between two pulses of one electrode."""

    interval_us: int
    mean_current_ua: int
    pulses: int
    on_us: int
    array_mean_current_ua: int
    array_on_us: int

    @classmethod
    def of(cls, maxima: Maxima) -> Bounds:
        """The maxima that hold over any second."""
        return cls(
            interval_us=maxima.interval_us,
            mean_current_ua=maxima.mean_current_ua,
            pulses=maxima.rate_hz,
            on_us=maxima.on_us_per_s,
            array_mean_current_ua=maxima.array_mean_current_ua,
            array_on_us=maxima.array_on_us_per_s,
        )


class Entry(msgspec.Struct, frozen=True, gc=False):
    """One pulse, or a part of it: its charge, its time, and the electrodes that carry it back.

    `returns` None: all others, each with `share`; otherwise each named electrode is booked with all
    of the charge.
    """

    electrode: int
    charge_pc: int
    on_us: int
    returns: tuple[int, ...] | None
    share: float
    #: 0 where the entry continues a pulse that is booked already, as after a probe.
    pulses: int = 1


class _Line(msgspec.Struct, gc=False):
    """One pulse in a window. The electrode's own window and the array's share the line."""

    begun_ns: int
    charge_pc: int
    pooled_pc: int = 0
    on_us: int = 0
    pulses: int = 0


class Booking(_Line, kw_only=True, gc=False):
    """What is booked of an entry now: a line of the windows that can be corrected."""

    entry: Entry
    #: The line in the windows of named returns.
    carried: _Line | None
    #: The state before it: when the electrode's last pulse began, and the most beside the pool.
    before_ns: int | None
    most_before_pc: int


class _Window:
    """Sums of what was booked in the last second; `pooled_pc` is what of it went into the pool."""

    __slots__ = ("charge_pc", "lines", "on_us", "pooled_pc", "pulses")

    def __init__(self) -> None:
        self.lines: deque[_Line] = deque()
        self.charge_pc = 0
        self.pooled_pc = 0
        self.on_us = 0
        self.pulses = 0

    @property
    def beside_pool_pc(self) -> int:
        """The charge of this electrode without its part in the pool."""
        return self.charge_pc - self.pooled_pc

    def book(self, line: _Line) -> None:
        self.lines.append(line)
        self.charge_pc += line.charge_pc
        self.pooled_pc += line.pooled_pc
        self.on_us += line.on_us
        self.pulses += line.pulses

    def take_back(self) -> None:
        """Removes the line that was booked last."""
        self._subtract(self.lines.pop())

    def drop_old(self, now_ns: int) -> None:
        """Removes what began a second ago or earlier."""
        lines, oldest_ns = self.lines, now_ns - WINDOW_NS
        while lines and lines[0].begun_ns <= oldest_ns:
            self._subtract(lines.popleft())

    def _subtract(self, line: _Line) -> None:
        self.charge_pc -= line.charge_pc
        self.pooled_pc -= line.pooled_pc
        self.on_us -= line.on_us
        self.pulses -= line.pulses


class Ledger:
    """See the module."""

    def __init__(self, electrodes: int, bounds: Bounds) -> None:
        self._bounds = bounds
        self._charge_pc = bounds.mean_current_ua * _PC_PER_UC
        self._array_charge_pc = bounds.array_mean_current_ua * _PC_PER_UC
        self._interval_ns = bounds.interval_us * 1_000
        self._begun_ns: list[int | None] = [None] * electrodes
        self._own = [_Window() for _ in range(electrodes)]
        #: All electrodes together; its `pooled_pc` is the pool.
        self._array = _Window()
        #: Never below the largest (own sum - put into the pool) of any electrode.
        self._most_beside_pool_pc = 0

    def charge_pc(self, electrode: int, now_ns: int) -> int:
        """The charge that the electrode carried in the last second, stimulated and as a return."""
        own, array = self._own[electrode], self._array
        own.drop_old(now_ns)
        array.drop_old(now_ns)
        return own.beside_pool_pc + array.pooled_pc

    def pulses(self, electrode: int, now_ns: int) -> int:
        """The pulses of the last second: those of the electrode, and those that it alone carried
        back.
        """
        self.charge_pc(electrode, now_ns)
        return self._own[electrode].pulses

    def rested_ns(self, electrode: int) -> int:
        """The earliest time of the electrode's next pulse."""
        begun_ns = self._begun_ns[electrode]
        return 0 if begun_ns is None else begun_ns + self._interval_ns

    def first_violation(self, entry: Entry, now_ns: int) -> LedgerReason | None:
        """The first bound that this entry would exceed; None if it fits."""
        bounds, own, array = self._bounds, self._own[entry.electrode], self._array
        begun_ns = self._begun_ns[entry.electrode]
        own.drop_old(now_ns)
        array.drop_old(now_ns)
        total_pc = own.charge_pc - own.pooled_pc + array.pooled_pc + entry.charge_pc
        if entry.pulses and begun_ns is not None and now_ns < begun_ns + self._interval_ns:
            return "interval"
        if own.pulses + entry.pulses > bounds.pulses or not self._lone_return_fits(entry, now_ns):
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

    def book(self, entry: Entry, now_ns: int, worst_pc: int) -> Booking:
        """Books a pulse before it is sent. `worst_pc` is the largest charge it can have: for the
        electrode and the array, and in its share for each return.
        """
        electrode, returns = entry.electrode, entry.returns
        booking = Booking(
            now_ns,
            worst_pc,
            _share_pc(entry, worst_pc) if returns is None else 0,
            entry.on_us,
            entry.pulses,
            entry=entry,
            carried=None if returns is None else _carried(entry, now_ns, worst_pc),
            before_ns=self._begun_ns[electrode],
            most_before_pc=self._most_beside_pool_pc,
        )
        own = self._own[electrode]
        own.book(booking)
        self._array.book(booking)
        if entry.pulses:
            self._begun_ns[electrode] = now_ns
        self._keep_most(own)
        if booking.carried is not None:
            for other in returns or ():
                self._own[other].book(booking.carried)
                self._keep_most(self._own[other])
        return booking

    def correct(self, booking: Booking, charge_pc: int, begun_ns: int) -> None:
        """The pulse began at `begun_ns` and had `charge_pc` in all. To be called before any other
        entry is booked or checked.
        """
        entry, more_pc = booking.entry, charge_pc - booking.charge_pc
        own, array = self._own[entry.electrode], self._array
        own.charge_pc += more_pc
        array.charge_pc += more_pc
        booking.begun_ns, booking.charge_pc = begun_ns, charge_pc
        if entry.pulses:
            self._begun_ns[entry.electrode] = begun_ns
        # The worst case that was booked does not count any more.
        self._most_beside_pool_pc = booking.most_before_pc
        if booking.carried is None:
            more_pooled_pc = _share_pc(entry, charge_pc) - booking.pooled_pc
            own.pooled_pc += more_pooled_pc
            array.pooled_pc += more_pooled_pc
            booking.pooled_pc += more_pooled_pc
        else:
            booking.carried.begun_ns, booking.carried.charge_pc = begun_ns, charge_pc
            for electrode in entry.returns or ():
                self._own[electrode].charge_pc += more_pc
                self._keep_most(self._own[electrode])
        self._keep_most(own)

    def take_back(self, booking: Booking) -> None:
        """Nothing of the pulse was sent. Call it before any other entry is booked or checked."""
        entry = booking.entry
        for electrode in (entry.electrode, *(entry.returns or ())):
            self._own[electrode].take_back()
        self._array.take_back()
        self._begun_ns[entry.electrode] = booking.before_ns
        self._most_beside_pool_pc = booking.most_before_pc

    def _keep_most(self, own: _Window) -> None:
        most_pc = own.charge_pc - own.pooled_pc
        if most_pc > self._most_beside_pool_pc:
            self._most_beside_pool_pc = most_pc

    def _returns_fit(self, entry: Entry, now_ns: int) -> bool:
        if entry.returns is not None:
            return all(
                self.charge_pc(electrode, now_ns) + entry.charge_pc <= self._charge_pc
                for electrode in entry.returns
            )
        room_pc = self._charge_pc - self._array.pooled_pc - _share_pc(entry, entry.charge_pc)
        if self._most_beside_pool_pc > room_pc:
            self._most_beside_pool_pc = self._recount(now_ns)
        return self._most_beside_pool_pc <= room_pc

    def _lone_return_fits(self, entry: Entry, now_ns: int) -> bool:
        """With a single return both electrodes are alone on their side, and the guard of the HAL
        counts a pulse for both.
        """
        if entry.returns is None or len(entry.returns) != 1:
            return True
        own = self._own[entry.returns[0]]
        own.drop_old(now_ns)
        return own.pulses + entry.pulses <= self._bounds.pulses

    def _recount(self, now_ns: int) -> int:
        for own in self._own:
            own.drop_old(now_ns)
        return max(own.beside_pool_pc for own in self._own)


def _carried(entry: Entry, now_ns: int, charge_pc: int) -> _Line:
    """The line in the window of each named return."""
    is_alone = entry.returns is not None and len(entry.returns) == 1
    return _Line(now_ns, charge_pc, pulses=entry.pulses if is_alone else 0)


def _share_pc(entry: Entry, charge_pc: int) -> int:
    """Rounded up: the ledger errs on the side of more charge."""
    return math.ceil(charge_pc * entry.share)
