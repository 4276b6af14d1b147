"""Entries and bounds for tests of the ledger.

Owns: bounds that are ample but for what a test names, a pulse of 1000 uA for 100 us, and how one is
booked, or fired as it was planned. Must not know: what follows from it.
"""

from __future__ import annotations

import dataclasses

from etd.safety.bookings import Booking, Entry
from etd.safety.ledger import Bounds, Ledger

SECOND_NS = 1_000_000_000
NOW_NS = 9 * SECOND_NS
AMPLE = Bounds(
    interval_us=0,
    mean_current_ua=10**6,
    pulses=10**6,
    on_us=10**9,
    array_mean_current_ua=10**6,
    array_on_us=10**9,
    net_charge_pc=10**12,
)
#: 1000 uA for 100 us.
PC = 100_000


def bounds(**changes: int) -> Bounds:
    return dataclasses.replace(AMPLE, **changes)


def entry(
    electrode: int = 0,
    charge_pc: int = PC,
    on_us: int = 100,
    returns: tuple[int, ...] | None = None,
    share: float = 1.0,
    net_pc: int | None = None,
) -> Entry:
    return Entry(electrode, charge_pc, on_us, returns, share, net_pc=net_pc)


def book(ledger: Ledger, entry: Entry, now_ns: int) -> Booking:
    """At what it is planned to be."""
    return ledger.book(entry, now_ns, entry.charge_pc)


def weighed(weights: list[float]) -> Ledger:
    """Bound to 1,000,000 pC a second, with weights that have stood for long."""
    ledger = Ledger(len(weights), bounds(mean_current_ua=1))
    for at_ns in (NOW_NS - 2 * SECOND_NS, NOW_NS - SECOND_NS, NOW_NS):
        ledger.set_weights(weights, at_ns)
    return ledger


def fire(ledger: Ledger, each: Entry, now_ns: int = NOW_NS, *, is_corrected: bool = True) -> None:
    assert ledger.first_violation(each, now_ns) is None
    booking = book(ledger, each, now_ns)
    if is_corrected:
        ledger.correct(booking, each.charge_pc, now_ns)
