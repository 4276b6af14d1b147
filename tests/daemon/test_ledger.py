"""Charge, pulses and time with current over the last second, returns included."""

from __future__ import annotations

from typing import get_args

import pytest

from engine_parts import maxima_with
from etd.safety.bookings import WINDOW_NS, Entry
from etd.safety.ledger import Bounds, Ledger, LedgerReason
from ledger_parts import AMPLE, NOW_NS, PC, book, bounds, entry
from plain_records import changed


def test_a_window_is_one_second_and_what_is_older_does_not_count() -> None:
    ledger = Ledger(2, bounds(pulses=1))
    book(ledger, entry(), NOW_NS)
    assert ledger.first_violation(entry(), NOW_NS + WINDOW_NS - 1) == "pulses"
    assert ledger.first_violation(entry(), NOW_NS + WINDOW_NS) is None
    assert WINDOW_NS == 1_000_000_000


def test_a_lone_return_has_each_pulse_as_well() -> None:
    """It is alone on its side, as the electrode is on the other: the last guard counts both."""
    ledger = Ledger(4, bounds(pulses=2))
    book(ledger, entry(0, returns=(1,)), NOW_NS)
    book(ledger, entry(1, returns=(2, 3)), NOW_NS)
    assert (ledger.pulses(0, NOW_NS), ledger.pulses(1, NOW_NS)) == (1, 2)
    assert (ledger.pulses(2, NOW_NS), ledger.pulses(3, NOW_NS)) == (0, 0)
    assert ledger.first_violation(entry(1, returns=(0,)), NOW_NS) == "pulses"
    assert ledger.first_violation(entry(0, returns=(1,)), NOW_NS) == "pulses"
    assert ledger.first_violation(entry(0, returns=(1, 2)), NOW_NS) is None
    assert ledger.first_violation(entry(0, returns=(1,)), NOW_NS + WINDOW_NS) is None


def test_a_lone_return_has_as_many_pulses_as_the_bound_and_not_one_more() -> None:
    ledger = Ledger(3, bounds(pulses=2))
    book(ledger, entry(0, returns=(2,)), NOW_NS)
    assert ledger.first_violation(entry(1, returns=(2,)), NOW_NS) is None
    book(ledger, entry(1, returns=(2,)), NOW_NS)
    assert (ledger.pulses(1, NOW_NS), ledger.pulses(2, NOW_NS)) == (1, 2)
    assert ledger.first_violation(entry(1, returns=(2,)), NOW_NS) == "pulses"


def test_the_pulses_of_all_electrodes_are_those_of_the_last_second() -> None:
    ledger = Ledger(4, AMPLE)
    assert ledger.recent_pulses(NOW_NS) == 0
    book(ledger, entry(0), NOW_NS)
    book(ledger, entry(1, returns=(2,)), NOW_NS + 500)
    book(ledger, changed(entry(1, returns=(2,)), pulses=0), NOW_NS + 500)
    book(ledger, entry(0), NOW_NS + 900)
    assert ledger.recent_pulses(NOW_NS + 900) == 3
    assert ledger.recent_pulses(NOW_NS + WINDOW_NS - 1) == 3
    assert ledger.recent_pulses(NOW_NS + WINDOW_NS) == 2
    assert ledger.recent_pulses(NOW_NS + WINDOW_NS + 500) == 1
    assert ledger.recent_pulses(NOW_NS + 2 * WINDOW_NS) == 0


def test_all_is_forgotten_a_second_after_the_last_pulse_of_any_electrode() -> None:
    ledger = Ledger(4, AMPLE)
    assert ledger.forgotten_ns() == 0
    for electrode, after_ns in [(0, 0), (1, 200), (2, 700), (0, 1_000)]:
        book(ledger, entry(electrode), NOW_NS + after_ns)
        assert ledger.forgotten_ns() == NOW_NS + after_ns + 1_000_000_000
    assert ledger.recent_pulses(NOW_NS + WINDOW_NS + 999) == 1
    assert ledger.forgotten_ns() == NOW_NS + 1_000_001_000
    assert ledger.recent_pulses(NOW_NS + WINDOW_NS + 1_000) == 0
    assert ledger.forgotten_ns() == 0


def test_a_lone_returns_pulse_that_was_not_sent_is_taken_back() -> None:
    ledger = Ledger(2, bounds(pulses=2))
    booking = ledger.book(entry(0, returns=(1,)), NOW_NS, PC)
    ledger.take_back(booking)
    assert (ledger.pulses(0, NOW_NS), ledger.pulses(1, NOW_NS)) == (0, 0)


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
    assert ledger.first_violation(first, NOW_NS) is None
    book(ledger, first, NOW_NS)
    assert ledger.first_violation(entry(0), NOW_NS + 1) == reason


def test_each_reason_has_the_name_that_others_read_it_by() -> None:
    """It goes to clients as it is, and the engine tells by it what waiting helps against."""
    assert get_args(LedgerReason) == (
        "interval",
        "charge",
        "pulses",
        "duty",
        "array charge",
        "array duty",
        "return charge",
        "net charge",
    )


def test_what_nobody_may_get_is_what_the_second_is_held_to() -> None:
    maxima = maxima_with(
        interval_us=1,
        mean_current_ua=2,
        rate_hz=3,
        on_us_per_s=4,
        array_mean_current_ua=5,
        array_on_us_per_s=6,
        net_charge_pc=7,
    )
    assert Bounds.of(maxima) == Bounds(
        interval_us=1,
        mean_current_ua=2,
        pulses=3,
        on_us=4,
        array_mean_current_ua=5,
        array_on_us=6,
        net_charge_pc=7,
    )


def test_a_pulse_that_just_fits_is_let_through() -> None:
    ledger = Ledger(2, bounds(mean_current_ua=1, on_us=200, pulses=2, array_on_us=200))
    book(ledger, entry(charge_pc=900_000), NOW_NS)
    assert ledger.first_violation(entry(charge_pc=100_000), NOW_NS + 1) is None
    assert ledger.first_violation(entry(charge_pc=100_001), NOW_NS + 1) == "charge"


def test_an_array_has_all_of_its_charge_and_not_more() -> None:
    ledger = Ledger(3, bounds(array_mean_current_ua=1))
    book(ledger, entry(0, charge_pc=600_000, returns=(2,)), NOW_NS)
    assert ledger.first_violation(entry(1, charge_pc=400_000), NOW_NS + 1) is None
    assert ledger.first_violation(entry(1, charge_pc=400_001), NOW_NS + 1) == "array charge"


def test_a_named_return_has_all_of_its_charge_and_not_more() -> None:
    ledger = Ledger(4, bounds(mean_current_ua=1))
    book(ledger, entry(0, charge_pc=600_000, returns=(2, 3)), NOW_NS)
    following = entry(1, charge_pc=400_000, returns=(2, 3))
    assert ledger.first_violation(following, NOW_NS + 1) is None
    one_too_many = changed(following, charge_pc=400_001)
    assert ledger.first_violation(one_too_many, NOW_NS + 1) == "return charge"


def test_each_explicit_return_is_booked_as_if_it_alone_carried_the_current() -> None:
    ledger = Ledger(4, AMPLE)
    book(ledger, entry(0, returns=(1, 2)), NOW_NS)
    assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(4)] == [PC, PC, PC, 0]


def test_a_return_that_has_had_its_charge_stops_the_pulse() -> None:
    ledger = Ledger(4, bounds(mean_current_ua=1))
    book(ledger, entry(2, charge_pc=950_000, returns=(3,)), NOW_NS)
    assert ledger.first_violation(entry(0, returns=(1,)), NOW_NS + 1) is None
    assert ledger.first_violation(entry(0, returns=(1, 2)), NOW_NS + 1) == "return charge"
    assert ledger.first_violation(entry(0, returns=(3,)), NOW_NS + 1) == "return charge"


def test_through_all_others_each_is_booked_its_share_and_the_source_only_its_own() -> None:
    ledger = Ledger(4, AMPLE)
    book(ledger, entry(0, charge_pc=90, share=1 / 3), NOW_NS)
    assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(4)] == [90, 30, 30, 30]


def test_a_share_is_rounded_up() -> None:
    ledger = Ledger(3, AMPLE)
    book(ledger, entry(0, charge_pc=101, share=0.5), NOW_NS)
    assert ledger.charge_pc(1, NOW_NS) == 51


def test_what_all_others_carried_stops_them_too() -> None:
    ledger = Ledger(3, bounds(mean_current_ua=1))
    book(ledger, entry(0, charge_pc=900_000, share=1.0), NOW_NS)
    assert ledger.first_violation(entry(1, charge_pc=200_000, share=0.0), NOW_NS + 1) == "charge"


def test_the_pulses_of_a_second_and_one_more_may_be_more_than_one_return_may_carry() -> None:
    ledger = Ledger(3, bounds(mean_current_ua=1))
    book(ledger, entry(0, charge_pc=950_000), NOW_NS)
    assert not ledger.exceeds_one_return(entry(1, charge_pc=50_000))
    assert ledger.exceeds_one_return(entry(1, charge_pc=50_001))


# --- booked at its worst, and corrected -----------------------------------------------------------


def test_the_worst_is_booked_to_all_in_the_path_and_the_array_until_it_is_corrected() -> None:
    ledger = Ledger(3, bounds(array_mean_current_ua=1))
    booking = ledger.book(entry(0, returns=(1,)), NOW_NS, 950_000)
    assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(3)] == [950_000, 950_000, 0]
    assert ledger.first_violation(entry(2), NOW_NS + 1) == "array charge"
    ledger.correct(booking, 120_000, NOW_NS)
    assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(3)] == [120_000, 120_000, 0]
    assert ledger.first_violation(entry(2), NOW_NS + 1) is None
    ledger.correct(booking, 900_001, NOW_NS)
    assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(3)] == [900_001, 900_001, 0]
    assert ledger.first_violation(entry(2), NOW_NS + 1) == "array charge"


def test_what_goes_through_all_others_is_shared_as_it_is_corrected() -> None:
    ledger = Ledger(3, AMPLE)
    booking = ledger.book(entry(0, share=0.5), NOW_NS, 4_000)
    assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(3)] == [4_000, 2_000, 2_000]
    ledger.correct(booking, 1_001, NOW_NS)
    assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(3)] == [1_001, 501, 501]


def test_a_correction_is_no_pulse_and_moves_the_time_from_which_the_next_may_come() -> None:
    ledger = Ledger(2, bounds(interval_us=2_000))
    booking = ledger.book(entry(), NOW_NS, 1_000)
    ledger.correct(booking, 500, NOW_NS + 300)
    assert ledger.pulses(0, NOW_NS + WINDOW_NS + 299) == 1
    assert ledger.rested_ns(0) == NOW_NS + 300 + 2_000_000
    assert ledger.pulses(0, NOW_NS + WINDOW_NS + 300) == 0
    assert ledger.charge_pc(0, NOW_NS + WINDOW_NS + 300) == 0


def test_what_a_named_return_carried_counts_from_when_the_pulse_began() -> None:
    ledger = Ledger(2, AMPLE)
    booking = ledger.book(entry(returns=(1,)), NOW_NS, PC)
    ledger.correct(booking, 500, NOW_NS + 300)
    assert ledger.charge_pc(1, NOW_NS + WINDOW_NS + 299) == 500
    assert ledger.charge_pc(1, NOW_NS + WINDOW_NS + 300) == 0


def test_a_pulse_behind_its_probe_has_the_probe_s_time_whatever_becomes_of_it() -> None:
    ledger = Ledger(2, bounds(interval_us=2_000))
    book(ledger, entry(), NOW_NS)
    assert ledger.first_violation(entry(), NOW_NS + 70) == "interval"
    assert ledger.first_violation(changed(entry(), pulses=0), NOW_NS + 70) is None
    behind = ledger.book(changed(entry(), pulses=0), NOW_NS + 70, PC)
    ledger.correct(behind, PC, NOW_NS + 80)
    assert ledger.rested_ns(0) == NOW_NS + 2_000_000
    ledger.take_back(behind)
    assert ledger.rested_ns(0) == NOW_NS + 2_000_000
    assert ledger.charge_pc(0, NOW_NS + 80) == PC


def test_what_was_taken_back_was_never_there() -> None:
    ledger = Ledger(3, bounds(interval_us=2_000, mean_current_ua=1, pulses=2))
    book(ledger, entry(0), NOW_NS)
    for returns in (None, (1,)):
        ledger.take_back(ledger.book(entry(0, returns=returns), NOW_NS + 2_000_000, 900_000))
        assert [ledger.charge_pc(electrode, NOW_NS) for electrode in range(3)] == [PC, PC, PC]
        assert ledger.pulses(0, NOW_NS) == 1
        assert ledger.rested_ns(0) == NOW_NS + 2_000_000
        assert ledger.first_violation(entry(1, charge_pc=900_000), NOW_NS + 2_000_000) is None


# --- the shortest interval ------------------------------------------------------------------------


def test_a_pulse_too_soon_after_the_one_before_does_not_fit() -> None:
    ledger = Ledger(4, bounds(interval_us=2_000))
    assert ledger.rested_ns(1) == 0
    book(ledger, entry(1), NOW_NS)
    assert ledger.rested_ns(1) == NOW_NS + 2_000_000
    assert ledger.first_violation(entry(1), NOW_NS + 1_999_999) == "interval"
    assert ledger.first_violation(entry(1), NOW_NS + 2_000_000) is None


def test_the_interval_is_each_electrodes_own() -> None:
    ledger = Ledger(4, bounds(interval_us=2_000))
    book(ledger, entry(1), NOW_NS)
    assert ledger.first_violation(entry(2), NOW_NS + 1) is None
