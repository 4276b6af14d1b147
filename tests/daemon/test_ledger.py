"""Charge, pulses and time with current over the last second, returns included."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_parts import maxima_with
from etd.ledger import WINDOW_NS, Bounds, Entry, Ledger

NOW_NS = 9_000_000_000
AMPLE = Bounds(
    interval_us=0,
    mean_current_ua=10**6,
    pulses=10**6,
    on_us=10**9,
    array_mean_current_ua=10**6,
    array_on_us=10**9,
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
) -> Entry:
    return Entry(electrode, charge_pc, on_us, returns, share)


def test_a_window_is_one_second_and_what_is_older_does_not_count() -> None:
    ledger = Ledger(2, bounds(pulses=1))
    ledger.book(entry(), NOW_NS)
    assert ledger.why_not(entry(), NOW_NS + WINDOW_NS - 1) == "pulses"
    assert ledger.why_not(entry(), NOW_NS + WINDOW_NS) is None
    assert WINDOW_NS == 1_000_000_000


@pytest.mark.parametrize(
    ("limits", "first", "reason"),
    [
        (bounds(pulses=1), entry(), "pulses"),
        (bounds(mean_current_ua=1), entry(charge_pc=950_000), "charge"),
        (bounds(on_us=199), entry(), "duty"),
        (bounds(array_mean_current_ua=1), entry(1, charge_pc=950_000), "array charge"),
        (bounds(array_on_us=199), entry(1), "array duty"),
    ],
)
def test_the_bound_that_one_more_pulse_would_pass_is_named(
    limits: Bounds, first: Entry, reason: str
) -> None:
    ledger = Ledger(3, limits)
    assert ledger.why_not(first, NOW_NS) is None
    ledger.book(first, NOW_NS)
    assert ledger.why_not(entry(0), NOW_NS + 1) == reason


def test_what_nobody_may_get_is_what_the_second_is_held_to() -> None:
    maxima = maxima_with(
        interval_us=1,
        mean_current_ua=2,
        rate_hz=3,
        on_us_per_s=4,
        array_mean_current_ua=5,
        array_on_us_per_s=6,
    )
    assert Bounds.of(maxima) == Bounds(
        interval_us=1,
        mean_current_ua=2,
        pulses=3,
        on_us=4,
        array_mean_current_ua=5,
        array_on_us=6,
    )


def test_a_pulse_that_just_fits_is_let_through() -> None:
    ledger = Ledger(2, bounds(mean_current_ua=1, on_us=200, pulses=2, array_on_us=200))
    ledger.book(entry(charge_pc=900_000), NOW_NS)
    assert ledger.why_not(entry(charge_pc=100_000), NOW_NS + 1) is None
    assert ledger.why_not(entry(charge_pc=100_001), NOW_NS + 1) == "charge"


def test_each_explicit_return_is_booked_as_if_it_alone_carried_the_current() -> None:
    ledger = Ledger(4, AMPLE)
    ledger.book(entry(0, returns=(1, 2)), NOW_NS)
    assert [ledger.charge_pc(one, NOW_NS) for one in range(4)] == [PC, PC, PC, 0]


def test_a_return_that_has_had_its_charge_stops_the_pulse() -> None:
    ledger = Ledger(4, bounds(mean_current_ua=1))
    ledger.book(entry(2, charge_pc=950_000, returns=(3,)), NOW_NS)
    assert ledger.why_not(entry(0, returns=(1,)), NOW_NS + 1) is None
    assert ledger.why_not(entry(0, returns=(1, 2)), NOW_NS + 1) == "return charge"
    assert ledger.why_not(entry(0, returns=(3,)), NOW_NS + 1) == "return charge"


def test_through_all_others_each_is_booked_its_share_and_the_source_only_its_own() -> None:
    ledger = Ledger(4, AMPLE)
    ledger.book(entry(0, charge_pc=90, share=1 / 3), NOW_NS)
    assert [ledger.charge_pc(one, NOW_NS) for one in range(4)] == [90, 30, 30, 30]


def test_a_share_is_rounded_up() -> None:
    ledger = Ledger(3, AMPLE)
    ledger.book(entry(0, charge_pc=101, share=0.5), NOW_NS)
    assert ledger.charge_pc(1, NOW_NS) == 51


def test_what_all_others_carried_stops_them_too() -> None:
    ledger = Ledger(3, bounds(mean_current_ua=1))
    ledger.book(entry(0, charge_pc=900_000, share=1.0), NOW_NS)
    assert ledger.why_not(entry(1, charge_pc=200_000, share=0.0), NOW_NS + 1) == "charge"


def test_a_pulse_through_all_others_is_stopped_by_the_one_that_has_had_most() -> None:
    ledger = Ledger(3, bounds(mean_current_ua=1))
    ledger.book(entry(2, charge_pc=900_000, share=0.0), NOW_NS)
    assert ledger.why_not(entry(0, charge_pc=200_000, share=0.4), NOW_NS + 1) is None
    assert ledger.why_not(entry(0, charge_pc=200_000, share=0.6), NOW_NS + 1) == "return charge"
    later_ns = NOW_NS + WINDOW_NS
    assert ledger.why_not(entry(0, charge_pc=200_000, share=0.6), later_ns) is None


def test_excess_is_charged_to_all_in_the_path_and_the_array() -> None:
    ledger = Ledger(3, bounds(array_mean_current_ua=1))
    ledger.book_excess(entry(0, returns=(1,)), 950_000, NOW_NS)
    assert [ledger.charge_pc(one, NOW_NS) for one in range(3)] == [950_000, 950_000, 0]
    assert ledger.why_not(entry(2), NOW_NS + 1) == "array charge"


def test_excess_through_all_others_is_shared_like_the_pulse() -> None:
    ledger = Ledger(3, AMPLE)
    ledger.book_excess(entry(0, share=0.5), 1_000, NOW_NS)
    assert [ledger.charge_pc(one, NOW_NS) for one in range(3)] == [1_000, 500, 500]


def test_excess_is_no_pulse() -> None:
    ledger = Ledger(2, AMPLE)
    ledger.book(entry(), NOW_NS)
    ledger.book_excess(entry(), 1_000, NOW_NS)
    assert ledger.pulses(0, NOW_NS) == 1


ELECTRODES = 4
visits = st.builds(
    Entry,
    electrode=st.integers(0, ELECTRODES - 1),
    charge_pc=st.integers(1, 400_000),
    on_us=st.integers(20, 400),
    returns=st.none(),
    share=st.sampled_from([1.0, 0.5, 1 / 3]),
) | st.builds(
    lambda electrode, charge_pc, offsets: Entry(
        electrode,
        charge_pc,
        100,
        tuple(sorted({(electrode + one) % ELECTRODES for one in offsets})),
        1.0,
    ),
    st.integers(0, ELECTRODES - 1),
    st.integers(1, 400_000),
    st.sets(st.integers(1, ELECTRODES - 1), min_size=1),
)


def carried_pc(booked: list[tuple[int, Entry]], one: int, now_ns: int) -> int:
    """By hand, from the list of all pulses: what electrode `one` carried in the last second."""
    total = 0
    for at_ns, each in booked:
        if at_ns <= now_ns - WINDOW_NS:
            continue
        if each.electrode == one or one in (each.returns or ()):
            total += each.charge_pc
        elif each.returns is None:
            total += -int(-each.charge_pc * each.share // 1)
    return total


@settings(max_examples=60)
@given(st.lists(st.tuples(visits, st.integers(0, 400_000_000)), max_size=40))
def test_no_electrode_and_no_return_ever_carries_more_than_the_bound(
    wishes: list[tuple[Entry, int]],
) -> None:
    ledger, now_ns = Ledger(ELECTRODES, bounds(mean_current_ua=1)), NOW_NS
    booked: list[tuple[int, Entry]] = []
    for wish, gap_ns in wishes:
        now_ns += gap_ns
        fits = [carried_pc(booked, one, now_ns) for one in range(ELECTRODES)]
        assert [ledger.charge_pc(one, now_ns) for one in range(ELECTRODES)] == fits
        verdict = ledger.why_not(wish, now_ns)
        after = [
            carried_pc([*booked, (now_ns, wish)], one, now_ns) <= 1_000_000
            for one in range(ELECTRODES)
        ]
        assert (verdict is None) == all(after)
        if verdict is None:
            ledger.book(wish, now_ns)
            booked.append((now_ns, wish))


# --- the shortest interval ------------------------------------------------------------------------


def test_a_pulse_too_soon_after_the_one_before_does_not_fit() -> None:
    ledger = Ledger(4, bounds(interval_us=2_000))
    ledger.book(entry(1), NOW_NS)
    assert ledger.rested_ns(1) == NOW_NS + 2_000_000
    assert ledger.why_not(entry(1), NOW_NS + 1_999_999) == "interval"
    assert ledger.why_not(entry(1), NOW_NS + 2_000_000) is None


def test_the_interval_is_each_electrodes_own() -> None:
    ledger = Ledger(4, bounds(interval_us=2_000))
    ledger.book(entry(1), NOW_NS)
    assert ledger.why_not(entry(2), NOW_NS + 1) is None
