"""What returns carry by their weights, and whether each has room for its part of one more pulse.

A ledger keeps the least room of all, so that it need not add up each electrode for each pulse. It
must never say that there is more than there is: what does not fit is refused to the last pC.
"""

from __future__ import annotations

import pytest

from etd.safety.bookings import WINDOW_NS
from etd.safety.ledger import Ledger
from ledger_parts import AMPLE, NOW_NS, book, bounds, entry, fire, weighed


@pytest.mark.parametrize("is_corrected", [False, True])
def test_a_pulse_through_all_others_is_stopped_by_one_that_was_a_named_return_of_several(
    is_corrected: bool,
) -> None:
    """Who carried 900 nC for two others, and nothing as the stimulated one."""
    ledger = Ledger(4, bounds(mean_current_ua=1))
    for electrode in (0, 1):
        booking = book(ledger, entry(electrode, charge_pc=450_000, returns=(3,)), NOW_NS)
        if is_corrected:
            ledger.correct(booking, 450_000, NOW_NS)
    assert ledger.first_violation(entry(2, charge_pc=200_000, share=0.5), NOW_NS + 1) is None
    assert (
        ledger.first_violation(entry(2, charge_pc=202_000, share=0.5), NOW_NS + 1)
        == "return charge"
    )


def test_a_pulse_through_all_others_is_stopped_by_the_one_that_has_had_most() -> None:
    ledger = Ledger(3, bounds(mean_current_ua=1))
    book(ledger, entry(2, charge_pc=900_000, share=0.0), NOW_NS)
    assert ledger.first_violation(entry(0, charge_pc=200_000, share=0.4), NOW_NS + 1) is None
    assert (
        ledger.first_violation(entry(0, charge_pc=200_000, share=0.6), NOW_NS + 1)
        == "return charge"
    )
    later_ns = NOW_NS + WINDOW_NS
    assert ledger.first_violation(entry(0, charge_pc=200_000, share=0.6), later_ns) is None


# --- weights --------------------------------------------------------------------------------------


def test_each_of_all_others_is_booked_its_weight_of_the_share_and_never_more_than_all() -> None:
    ledger = Ledger(5, AMPLE)
    ledger.set_weights([0.5, 1.0, 0.2, 0.0, 1e9], NOW_NS)
    ledger.set_weights([0.5, 1.0, 0.2, 0.0, 1e9], NOW_NS + WINDOW_NS)
    now_ns = NOW_NS + 2 * WINDOW_NS
    ledger.set_weights([0.5, 1.0, 0.2, 0.0, 1e9], now_ns)
    book(ledger, entry(0, charge_pc=1_000, share=0.8), now_ns)
    assert [ledger.charge_pc(electrode, now_ns) for electrode in range(5)] == [
        1_000,
        800,
        160,
        0,
        1_000,
    ]
    book(ledger, entry(1, charge_pc=1_000, share=3.0), now_ns)
    assert [ledger.charge_pc(electrode, now_ns) for electrode in range(5)] == [
        2_000,
        1_800,
        760,
        0,
        2_000,
    ]


def test_for_the_pulses_of_a_second_counts_the_largest_weight_in_it() -> None:
    ledger = Ledger(2, AMPLE)
    for at_ns in (NOW_NS, NOW_NS + WINDOW_NS, NOW_NS + 2 * WINDOW_NS):
        ledger.set_weights([1.0, 0.1], at_ns)
    now_ns = NOW_NS + 2 * WINDOW_NS
    book(ledger, entry(0, charge_pc=1_000), now_ns)
    assert ledger.charge_pc(1, now_ns) == 100
    ledger.set_weights([1.0, 0.9], now_ns + 1)
    assert ledger.charge_pc(1, now_ns + 1) == 900
    ledger.set_weights([1.0, 0.1], now_ns + 2)
    assert ledger.charge_pc(1, now_ns + WINDOW_NS - 1) == 900


def test_a_weight_that_rises_takes_room_that_was_there() -> None:
    ledger = Ledger(3, bounds(mean_current_ua=1))
    for at_ns in (NOW_NS, NOW_NS + WINDOW_NS, NOW_NS + 2 * WINDOW_NS):
        ledger.set_weights([0.1] * 3, at_ns)
    now_ns = NOW_NS + 2 * WINDOW_NS
    for electrode in (0, 1):
        assert ledger.first_violation(entry(electrode, charge_pc=500_000), now_ns) is None
        book(ledger, entry(electrode, charge_pc=500_000), now_ns)
    assert ledger.first_violation(entry(0), now_ns) is None
    ledger.set_weights([0.1, 0.1, 0.99], now_ns)
    assert ledger.first_violation(entry(0), now_ns) == "return charge"


def test_one_that_conducts_better_does_not_take_the_room_of_the_others() -> None:
    """It may carry nearly all of each pulse, and the others next to nothing."""
    ledger = Ledger(4, bounds(mean_current_ua=1))
    weights = [0.01, 0.01, 0.01, 1.0]
    for at_ns in (NOW_NS, NOW_NS + WINDOW_NS, NOW_NS + 2 * WINDOW_NS):
        ledger.set_weights(weights, at_ns)
    now_ns = NOW_NS + 2 * WINDOW_NS
    for number in range(11):
        assert ledger.first_violation(entry(number % 3, share=0.9), now_ns) is None
        book(ledger, entry(number % 3, share=0.9), now_ns)
    assert ledger.charge_pc(0, now_ns) < 410_000
    assert ledger.charge_pc(3, now_ns) == 990_000
    assert ledger.first_violation(entry(0, share=0.9), now_ns) == "return charge"
    assert ledger.first_violation(entry(3, share=33.0), now_ns) == "charge"
    assert ledger.first_violation(entry(0, charge_pc=10_000, share=0.9), now_ns) is None


def test_a_source_that_has_had_its_charge_stops_as_a_return_what_it_carries_little_of() -> None:
    ledger = weighed([1.0] * 3)
    fire(ledger, entry(1, charge_pc=10_000, share=0.1))
    fire(ledger, entry(0, charge_pc=950_000, share=0.1))
    assert ledger.first_violation(entry(1, charge_pc=500_000, share=0.5), NOW_NS) == "return charge"


def test_one_whose_weight_is_above_one_has_more_than_the_share() -> None:
    ledger = weighed([2.0, 1.0, 1.0, 1.0])
    fire(ledger, entry(3, charge_pc=1_000, share=0.5))
    fire(ledger, entry(1, charge_pc=600_000, share=0.5))
    assert ledger.first_violation(entry(2, charge_pc=500_000, share=0.5), NOW_NS) == "return charge"


@pytest.mark.parametrize("is_corrected", [True, False])
def test_after_a_share_above_one_a_return_may_have_all_of_later_pulses(is_corrected: bool) -> None:
    ledger = weighed([1.0, 0.01, 0.01, 0.01])
    fire(ledger, entry(1, charge_pc=200_000, share=8.0), is_corrected=is_corrected)
    for electrode in (2, 3):
        fire(ledger, entry(electrode, charge_pc=300_000, share=0.1))
    assert ledger.charge_pc(0, NOW_NS) == 800_000
    assert ledger.first_violation(entry(1, charge_pc=300_000, share=0.1), NOW_NS) == "return charge"


# --- the least room of all ------------------------------------------------------------------------


def test_before_room_was_counted_not_even_one_pc_is_taken_for_granted() -> None:
    ledger = Ledger(3, bounds(mean_current_ua=1))
    book(ledger, entry(2, charge_pc=1_000_000, share=0.0), NOW_NS)
    assert ledger.first_violation(entry(0, charge_pc=1), NOW_NS) == "return charge"
    assert ledger.first_violation(entry(0, charge_pc=1, share=0.0), NOW_NS) is None


def test_what_named_returns_carried_takes_room_that_was_counted() -> None:
    """3 has carried 900,000 pC for two others, who have had half of it each."""
    ledger = weighed([1.0] * 4)
    fire(ledger, entry(2, charge_pc=1_000, share=0.0))
    for electrode in (0, 1):
        fire(ledger, entry(electrode, charge_pc=450_000, returns=(2, 3)))
    assert ledger.first_violation(entry(0, charge_pc=100_001), NOW_NS) == "return charge"
    # 2 is at 901,000.
    assert ledger.first_violation(entry(0, charge_pc=99_000), NOW_NS) is None


def test_what_a_source_carried_for_others_and_had_itself_takes_room_to_the_last_pc() -> None:
    ledger = weighed([1.0] * 4)
    fire(ledger, entry(0, charge_pc=500_000, share=0.4))
    fire(ledger, entry(1, charge_pc=700_000, share=0.0))
    assert ledger.charge_pc(1, NOW_NS) == 900_000
    assert ledger.first_violation(entry(2, charge_pc=100_001), NOW_NS) == "return charge"
    assert ledger.first_violation(entry(2, charge_pc=100_000), NOW_NS) is None


def test_a_source_of_named_returns_carries_by_its_weight() -> None:
    """1 has had 500,000 pC and carried 5/4 of 200,000; with 5/4 of another 234,000 that is more
    than a million.
    """
    ledger = weighed([1.0, 1.25, 1.0, 1.0])
    fire(ledger, entry(0, charge_pc=500_000, share=0.4))
    fire(ledger, entry(1, charge_pc=500_000, returns=(2, 3)))
    assert ledger.charge_pc(1, NOW_NS) == 750_000
    one_too_many = entry(0, charge_pc=260_000, share=0.9)
    assert ledger.first_violation(one_too_many, NOW_NS) == "return charge"
    # 5/4 of 200,000 is what 1 has left.
    assert ledger.first_violation(entry(0, charge_pc=250_000, share=0.8), NOW_NS) is None


@pytest.mark.parametrize(
    ("own_pc", "more_pc", "less_pc"),
    [
        # 1,000 pC are left to 0, which carries 3/2 of each pulse.
        (984_000, 667, 666),
        # 4 pC are left; 3 pC would be 4.5.
        (984_996, 3, 2),
    ],
)
def test_a_return_whose_weight_is_above_one_is_full_before_the_charge_of_pulses_fills_it(
    own_pc: int, more_pc: int, less_pc: int
) -> None:
    ledger = weighed([1.5, 1.0, 1.0])
    fire(ledger, entry(1, charge_pc=100_000, share=0.1))
    fire(ledger, entry(0, charge_pc=own_pc, share=0.0))
    # 0 has carried 15,000 pC besides; here its room is counted.
    assert ledger.first_violation(entry(2, charge_pc=1, share=0.0), NOW_NS) is None
    assert ledger.first_violation(entry(1, charge_pc=more_pc), NOW_NS) == "return charge"
    assert ledger.first_violation(entry(1, charge_pc=less_pc), NOW_NS) is None


def test_a_share_above_one_counts_for_a_second_from_when_its_pulse_began() -> None:
    """It was booked 300 ns before. While it counts, a return may have all of any other pulse."""
    ledger = weighed([1.0, 0.01, 0.01, 0.01])
    above = entry(1, charge_pc=200_000, share=8.0)
    assert ledger.first_violation(above, NOW_NS) is None
    ledger.correct(book(ledger, above, NOW_NS), 200_000, NOW_NS + 300)
    late_ns = NOW_NS + WINDOW_NS + 100
    for electrode in (2, 3):
        fire(ledger, entry(electrode, charge_pc=300_000, share=0.1), late_ns)
    assert ledger.charge_pc(0, late_ns) == 800_000
    following = entry(1, charge_pc=300_000, share=0.1)
    assert ledger.first_violation(following, late_ns) == "return charge"
    # Of the three alone it has a tenth.
    assert ledger.first_violation(following, NOW_NS + WINDOW_NS + 300) is None


def test_what_a_return_had_a_second_ago_is_not_counted_to_it_at_that_very_time() -> None:
    ledger = Ledger(4, bounds(mean_current_ua=1))
    book(ledger, entry(2, charge_pc=900_000, share=0.0), NOW_NS)
    for electrode in (1, 3):
        book(ledger, entry(electrode, charge_pc=600_000, share=0.1), NOW_NS + 1_000)
    following = entry(0, charge_pc=100_000, share=0.5)
    assert ledger.first_violation(following, NOW_NS + WINDOW_NS - 1) == "return charge"
    assert ledger.first_violation(following, NOW_NS + WINDOW_NS) is None
