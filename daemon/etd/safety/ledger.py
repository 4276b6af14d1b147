"""The charge, pulses and time with current of each electrode, and of the array, in the last second.

Owns: charge, pulses and time with current over a sliding window of one second, returns included,
the time of each electrode's last pulse, and whether one more pulse fits; net charge is kept in step
with them (`net_charge.py`).
Must not know: why a pulse is wanted, hardware, clocks: time comes in.

A pulse is booked before it is sent, at its worst case, and corrected to the charge it had
(`firing.py`). An entry that is never corrected stays at its worst case.

Charge is in pC (uA x us), all phases counted positive. A pulse that returns through all others is
booked to a pool at the share that the best return may carry. The weight of an electrode is the part
of that share which it may carry. Its total is its own sum plus its weight times the pool, without
what it put into the pool itself, and of the pulses of others never more than all of them. The
largest weight of the last second counts for all pulses of that second. So a pulse costs the same
work for 8 electrodes and for 256, except where the least room of all must be counted again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from etd.safety.bookings import WINDOW_NS, Booking, Entry, Window, carried_line
from etd.safety.maxima import Maxima
from etd.safety.net_charge import NetCharge
from etd.safety.return_weights import ReturnWeights

_PC_PER_UC = 1_000_000
#: The least room must be counted again.
_UNKNOWN_PC = -1

LedgerReason = Literal[
    "interval",
    "charge",
    "pulses",
    "duty",
    "array charge",
    "array duty",
    "return charge",
    "net charge",
]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds over any second, of net charge, and of the interval between two pulses."""

    interval_us: int
    mean_current_ua: int
    pulses: int
    on_us: int
    array_mean_current_ua: int
    array_on_us: int
    net_charge_pc: int

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
            net_charge_pc=maxima.net_charge_pc,
        )


class Ledger:
    def __init__(self, electrodes: int, bounds: Bounds) -> None:
        self._bounds = bounds
        self._charge_pc = bounds.mean_current_ua * _PC_PER_UC
        self._array_charge_pc = bounds.array_mean_current_ua * _PC_PER_UC
        self._interval_ns = bounds.interval_us * 1_000
        self._begun_ns: list[int | None] = [None] * electrodes
        self._own = [Window() for _ in range(electrodes)]
        #: All electrodes together; its `pooled_pc` is the pool.
        self._array = Window()
        self.net: Final = NetCharge(electrodes, bounds.net_charge_pc)
        self._weights = ReturnWeights(electrodes, WINDOW_NS)
        #: Never above the least charge that is left to an electrode; and the electrode that refused
        #: a pulse last.
        self._room_pc = _UNKNOWN_PC
        self._full = 0
        #: Until then a total may include all pulses of the others.
        self._whole_until_ns = 0

    def set_weights(self, weights: Sequence[float], now_ns: int) -> None:
        """By electrode: the part of an entry's share that it may carry, from now on."""
        if self._weights.set(weights, now_ns):
            self._room_pc = _UNKNOWN_PC

    def charge_pc(self, electrode: int, now_ns: int) -> int:
        """The charge that the electrode carried in the last second, stimulated and as a return."""
        self._own[electrode].drop_old(now_ns)
        self._array.drop_old(now_ns)
        return self._carried_pc(electrode)

    def _carried_pc(self, electrode: int, pooled_pc: int = 0, through_pc: int = 0) -> int:
        """The same, of windows without old lines, with so much more in the pool."""
        own, array = self._own[electrode], self._array
        pooled_pc += array.pooled_pc - own.pooled_pc
        through_pc += array.through_pc - own.through_pc
        carried_pc = math.ceil(pooled_pc * self._weights.of[electrode])
        return own.charge_pc + (carried_pc if carried_pc < through_pc else through_pc)

    def pulses(self, electrode: int, now_ns: int) -> int:
        """The pulses of the last second: those of the electrode, and those that it alone carried
        back.
        """
        self._own[electrode].drop_old(now_ns)
        return self._own[electrode].pulses

    def recent_pulses(self, now_ns: int) -> int:
        """The pulses of the last second at all electrodes."""
        self._array.drop_old(now_ns)
        return self._array.pulses

    def rested_ns(self, electrode: int) -> int:
        """The earliest time of the electrode's next pulse."""
        begun_ns = self._begun_ns[electrode]
        return 0 if begun_ns is None else begun_ns + self._interval_ns

    def forgotten_ns(self) -> int:
        """From when on nothing counts any more of all that was booked; 0: nothing does now."""
        lines = self._array.lines
        return lines[-1].begun_ns + WINDOW_NS if lines else 0

    def exceeds_one_return(self, entry: Entry) -> bool:
        """Whether the charge of the array in a second, with one more pulse, exceeds what a single
        electrode may carry.
        """
        return self._array.charge_pc + entry.charge_pc > self._charge_pc

    def first_violation(self, entry: Entry, now_ns: int) -> LedgerReason | None:
        """The first bound that this entry would exceed; None if it fits."""
        bounds, own, array = self._bounds, self._own[entry.electrode], self._array
        begun_ns = self._begun_ns[entry.electrode]
        own.drop_old(now_ns)
        array.drop_old(now_ns)
        total_pc = self._carried_pc(entry.electrode) + entry.charge_pc
        if entry.pulses and begun_ns is not None and now_ns < begun_ns + self._interval_ns:
            return "interval"
        if own.pulses + entry.pulses > bounds.pulses:
            return "pulses"
        if entry.returns is not None and not self._lone_return_fits(entry, now_ns):
            return "pulses"
        if total_pc > self._charge_pc:
            return "charge"
        if own.on_us + entry.on_us > bounds.on_us:
            return "duty"
        if array.charge_pc + entry.charge_pc > self._array_charge_pc:
            return "array charge"
        if array.on_us + entry.on_us > bounds.array_on_us:
            return "array duty"
        if not self._returns_fit(entry, now_ns):
            return "return charge"
        is_kept = self.net.fits(entry.electrode, entry.net_pc, entry.returns, now_ns)
        return None if is_kept else "net charge"

    def book(self, entry: Entry, now_ns: int, worst_pc: int) -> Booking:
        """Books a pulse before it is sent. `worst_pc` is the largest charge it can have: for the
        electrode and the array, and in its share for each return.
        """
        electrode, returns = entry.electrode, entry.returns
        booking = Booking(
            now_ns,
            worst_pc,
            worst_pc if returns is None else 0,
            entry.pooled_of(worst_pc),
            entry.on_us,
            entry.pulses,
            entry,
            None if returns is None else carried_line(entry, now_ns, worst_pc),
            self._begun_ns[electrode],
            self._room_pc,
        )
        self._own[electrode].book(booking)
        self._array.book(booking)
        self.net.add(electrode, booking.net_pc, returns, now_ns)
        if entry.pulses:
            self._begun_ns[electrode] = now_ns
        if booking.carried is not None:
            for other in returns or ():
                self._own[other].book(booking.carried)
        # It is counted again if this entry is never corrected.
        self._room_pc = _UNKNOWN_PC
        if booking.pooled_pc > booking.charge_pc:
            self._whole_until_ns = now_ns + WINDOW_NS
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
        if booking.carried is None:
            more_pooled_pc = entry.pooled_of(charge_pc) - booking.pooled_pc
            own.pooled_pc += more_pooled_pc
            array.pooled_pc += more_pooled_pc
            own.through_pc += more_pc
            array.through_pc += more_pc
            booking.through_pc += more_pc
            booking.pooled_pc += more_pooled_pc
        else:
            booking.carried.begun_ns, booking.carried.charge_pc = begun_ns, charge_pc
            for electrode in entry.returns or ():
                self._own[electrode].charge_pc += more_pc
        self._room_pc = self._narrowed_pc(booking)

    def take_back(self, booking: Booking) -> None:
        """Nothing of the pulse was sent. Call it before any other entry is booked or checked."""
        entry = booking.entry
        for electrode in (entry.electrode, *(entry.returns or ())):
            self._own[electrode].take_back()
        self._array.take_back()
        self.settle_net(booking, 0)
        self._begun_ns[entry.electrode] = booking.before_ns
        self._room_pc = booking.room_before_pc

    def settle_net(self, booking: Booking, net_pc: int) -> None:
        """What its phases left, positive into the skin, instead of what was booked."""
        entry, more_pc = booking.entry, net_pc - booking.net_pc
        booking.net_pc = net_pc
        self.net.add(entry.electrode, more_pc, entry.returns, booking.booked_ns)

    # --- room ------------------------------------------------------------------------------------

    def _narrowed_pc(self, booking: Booking) -> int:
        """The least room after this entry: what the best return may carry is subtracted, and the
        room of the electrodes on the path counts as it is now.
        """
        entry, room_pc = booking.entry, booking.room_before_pc
        if entry.returns is None:
            if booking.pooled_pc > booking.charge_pc:
                self._whole_until_ns = booking.begun_ns + WINDOW_NS
            room_pc -= self._most_pc(booking.pooled_pc, booking.charge_pc, booking.begun_ns)
        else:
            for electrode in entry.returns:
                room_pc = min(room_pc, self._charge_pc - self._carried_pc(electrode))
        own, array = self._own[entry.electrode], self._array
        pooled_pc = (array.pooled_pc - own.pooled_pc) * self._weights.of[entry.electrode]
        # At least its carried charge: not bound by all of the others' pulses, and rounded up.
        own_room_pc = self._charge_pc - own.charge_pc - int(pooled_pc) - 1
        return own_room_pc if own_room_pc < room_pc else room_pc

    def _most_pc(self, pooled_pc: int, charge_pc: int, now_ns: int) -> int:
        """The most by which the total of a return may rise. That is the share while no share and no
        weight is above 1; otherwise totals may be bound by the whole charge of the others' pulses.
        """
        most = self._weights.most
        if pooled_pc <= charge_pc and most <= 1.0 and now_ns >= self._whole_until_ns:
            return pooled_pc
        return max(charge_pc, math.ceil(pooled_pc * most))

    def _returns_fit(self, entry: Entry, now_ns: int) -> bool:
        if entry.returns is not None:
            return all(
                self.charge_pc(electrode, now_ns) + entry.charge_pc <= self._charge_pc
                for electrode in entry.returns
            )
        pooled_pc = entry.pooled_of(entry.charge_pc)
        if self._room_pc >= self._most_pc(pooled_pc, entry.charge_pc, now_ns):
            return True
        if not self._return_fits(self._full, entry, pooled_pc, now_ns):
            return False
        most_pc = 0
        for other in range(len(self._own)):
            if not self._return_fits(other, entry, pooled_pc, now_ns):
                self._full = other
                return False
            carried_pc = self._carried_pc(other)
            if carried_pc > most_pc:
                most_pc = carried_pc
        self._room_pc = self._charge_pc - most_pc
        return True

    def _return_fits(self, electrode: int, entry: Entry, pooled_pc: int, now_ns: int) -> bool:
        """Whether the entry, too, fits into what the electrode may carry; drops its old lines."""
        if electrode == entry.electrode:
            return True
        own = self._own[electrode]
        if own.lines and own.lines[0].begun_ns <= now_ns - WINDOW_NS:
            own.drop_old(now_ns)
        carried_pc = self._carried_pc(electrode, pooled_pc, entry.charge_pc)
        return carried_pc <= self._charge_pc

    def _lone_return_fits(self, entry: Entry, now_ns: int) -> bool:
        """With a single return both electrodes are alone on their side, and the guard of the HAL
        counts a pulse for both.
        """
        if entry.returns is None or len(entry.returns) != 1:
            return True
        own = self._own[entry.returns[0]]
        own.drop_old(now_ns)
        return own.pulses + entry.pulses <= self._bounds.pulses
