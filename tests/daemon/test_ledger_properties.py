"""The ledger against a list of all pulses, added up by hand: what fits is let through, no more."""

from __future__ import annotations

import math
import random

from hypothesis import given, settings
from hypothesis import strategies as st

from etd.safety.bookings import WINDOW_NS, Entry
from etd.safety.ledger import Ledger
from ledger_parts import bounds
from plain_records import changed

NOW_NS = 9_000_000_000
#: 1,000,000 pC a second, and all else ample.
BOUNDS = bounds(mean_current_ua=1)
ELECTRODES = 4
visits = st.builds(
    Entry,
    electrode=st.integers(0, ELECTRODES - 1),
    charge_pc=st.integers(1, 400_000),
    on_us=st.integers(20, 400),
    returns=st.none(),
    share=st.sampled_from([1.0, 0.5, 1 / 3, 4.0]),
) | st.builds(
    lambda electrode, charge_pc, offsets: Entry(
        electrode,
        charge_pc,
        100,
        tuple(sorted({(electrode + offset) % ELECTRODES for offset in offsets})),
        1.0,
    ),
    st.integers(0, ELECTRODES - 1),
    st.integers(1, 400_000),
    st.sets(st.integers(1, ELECTRODES - 1), min_size=1),
)


def carried_pc(
    booked: list[tuple[int, Entry]], electrode: int, now_ns: int, weight: float = 1.0
) -> int:
    """By hand, from the list of all pulses: what electrode `one` carried in the last second."""
    total, pooled, through = 0, 0, 0
    for at_ns, each in booked:
        if at_ns <= now_ns - WINDOW_NS:
            continue
        if each.electrode == electrode or electrode in (each.returns or ()):
            total += each.charge_pc
        elif each.returns is None:
            pooled += -int(-each.charge_pc * each.share // 1)
            through += each.charge_pc
    return total + min(through, math.ceil(pooled * weight))


def in_path(electrode: int, entry_: Entry) -> bool:
    return entry_.returns is None or electrode == entry_.electrode or electrode in entry_.returns


#: What becomes of a booking: what it came to, None where it is not corrected; -1: taken back.
fates = st.one_of(st.none(), st.just(-1), st.integers(0, 500_000))


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(visits, st.integers(0, 400_000_000), st.integers(0, 200_000), fates), max_size=40
    ),
    st.lists(st.sampled_from([0.01, 0.3, 1.0, 2.0, 1e9]), min_size=ELECTRODES, max_size=ELECTRODES),
)
def test_no_electrode_and_no_return_is_let_through_more_than_the_bound(
    requests: list[tuple[Entry, int, int, int | None]], weights: list[float]
) -> None:
    ledger, now_ns = Ledger(ELECTRODES, BOUNDS), NOW_NS
    for at_ns in (NOW_NS - 2 * WINDOW_NS, NOW_NS - WINDOW_NS, NOW_NS):
        ledger.set_weights(weights, at_ns)
    booked: list[tuple[int, Entry]] = []

    def charges_pc() -> list[int]:
        return [ledger.charge_pc(electrode, now_ns) for electrode in range(ELECTRODES)]

    def by_hand_pc(*more: Entry) -> list[int]:
        lines = [*booked, *((now_ns, each) for each in more)]
        return [
            carried_pc(lines, electrode, now_ns, weights[electrode])
            for electrode in range(ELECTRODES)
        ]

    for pulse_request, gap_ns, excess_pc, fate in requests:
        now_ns += gap_ns
        assert charges_pc() == by_hand_pc()
        after = [
            pc <= 1_000_000
            for electrode, pc in enumerate(by_hand_pc(pulse_request))
            if in_path(electrode, pulse_request)
        ]
        assert (ledger.first_violation(pulse_request, now_ns) is None) == all(after)
        if not all(after):
            continue
        worst = changed(pulse_request, charge_pc=pulse_request.charge_pc + excess_pc)
        booking = ledger.book(pulse_request, now_ns, worst.charge_pc)
        assert charges_pc() == by_hand_pc(worst)
        if fate == -1:
            ledger.take_back(booking)
            continue
        if fate is not None:
            ledger.correct(booking, fate, now_ns)
            worst = changed(pulse_request, charge_pc=fate)
        booked.append((now_ns, worst))


def drawn(chance: random.Random) -> Entry:
    """A pulse; about every second one goes through all others."""
    electrode = chance.randrange(ELECTRODES)
    returns = None
    if chance.random() < 0.5:
        others = [other for other in range(ELECTRODES) if other != electrode]
        returns = tuple(sorted(chance.sample(others, chance.randrange(1, ELECTRODES))))
    share = 1.0 if returns is not None else chance.choice([1.0, 0.5, 1 / 3, 1.5, 4.0])
    charge_pc = chance.choice([1_000, 20_000, 60_000, 200_000])
    return Entry(electrode, chance.randrange(1, charge_pc), 100, returns, share)


@settings(max_examples=6)
@given(
    st.integers(0, 2**32),
    st.sampled_from([[0.01, 0.3, 1.0, 1.0], [0.3, 0.7, 1e9, 1.0], [2.0, 1.0, 0.5, 0.01]]),
)
def test_through_many_seconds_it_lets_through_what_fits_and_nothing_else(
    seed: int, weights: list[float]
) -> None:
    """Near the bound: the pulses begin a little after they are booked, and differ from that."""
    chance, now_ns = random.Random(seed), NOW_NS
    ledger = Ledger(ELECTRODES, BOUNDS)
    for at_ns in (NOW_NS - 2 * WINDOW_NS, NOW_NS - WINDOW_NS, NOW_NS):
        ledger.set_weights(weights, at_ns)
    booked: list[tuple[int, Entry]] = []
    let_through = {True: 0, False: 0}
    for _ in range(300):
        now_ns += chance.choice([1, 1_000_000, 10_000_000, 60_000_000])
        booked = [line for line in booked if line[0] > now_ns - WINDOW_NS]
        each = drawn(chance)
        lines = [*booked, (now_ns, each)]
        totals_pc = [
            carried_pc(lines, electrode, now_ns, weights[electrode])
            for electrode in range(ELECTRODES)
            if in_path(electrode, each)
        ]
        fits = max(totals_pc) <= 1_000_000
        assert (ledger.first_violation(each, now_ns) is None) == fits
        let_through[fits] += 1
        if not fits:
            continue
        booking = ledger.book(each, now_ns, each.charge_pc + chance.randrange(50_000))
        if chance.random() < 0.1:
            ledger.take_back(booking)
            continue
        begun_ns = now_ns + chance.randrange(100_000)
        had = changed(each, charge_pc=each.charge_pc + chance.randrange(2_000))
        ledger.correct(booking, had.charge_pc, begun_ns)
        now_ns = begun_ns
        booked.append((begun_ns, had))
    assert min(let_through.values()) > 10
