"""What a ledger is made of: the sums of a window, and what is booked of an entry."""

from __future__ import annotations

import pytest

from etd.safety.bookings import Entry, Line, Window, carried_line, worst_net_pc

NOW_NS = 9_000_000_000
SECOND_NS = 1_000_000_000
#: Each figure another, so that no sum can stand in for another one.
FIRST = {"charge_pc": 7_000, "through_pc": 500, "pooled_pc": 60, "on_us": 100, "pulses": 1}
SECOND = {"charge_pc": 11_000, "through_pc": 900, "pooled_pc": 80, "on_us": 300, "pulses": 2}
BOTH = {"charge_pc": 18_000, "through_pc": 1_400, "pooled_pc": 140, "on_us": 400, "pulses": 3}
NOTHING = dict.fromkeys(FIRST, 0)


def sums(window: Window) -> dict[str, int]:
    return {name: getattr(window, name) for name in FIRST}


def two_lines() -> Window:
    window = Window()
    window.book(Line(NOW_NS, **FIRST))
    window.book(Line(NOW_NS + 400, **SECOND))
    return window


def entry(
    charge_pc: int = 100_000,
    returns: tuple[int, ...] | None = None,
    share: float = 1.0,
    pulses: int = 1,
    net_pc: int | None = None,
) -> Entry:
    return Entry(0, charge_pc, 100, returns, share, pulses, net_pc)


# --- windows --------------------------------------------------------------------------------------


def test_a_window_begins_with_nothing_and_adds_up_what_is_booked() -> None:
    assert sums(Window()) == NOTHING
    assert sums(two_lines()) == BOTH


def test_what_is_taken_back_is_the_last_line_with_all_its_figures() -> None:
    window = two_lines()
    window.take_back()
    assert sums(window) == FIRST
    window.take_back()
    assert sums(window) == NOTHING
    assert not window.lines


def test_what_began_a_second_ago_goes_with_all_its_figures_and_nothing_else() -> None:
    window = two_lines()
    window.drop_old(NOW_NS + SECOND_NS - 1)
    assert sums(window) == BOTH
    window.drop_old(NOW_NS + SECOND_NS)
    assert sums(window) == SECOND
    window.drop_old(NOW_NS + SECOND_NS + 400)
    assert sums(window) == NOTHING
    assert not window.lines


def test_after_a_long_pause_all_goes_at_once() -> None:
    window = two_lines()
    window.drop_old(NOW_NS + 60 * SECOND_NS)
    assert sums(window) == NOTHING
    window.drop_old(NOW_NS + 61 * SECOND_NS)
    assert sums(window) == NOTHING


def test_a_line_of_charge_alone_has_neither_time_nor_pulses_nor_a_part_in_the_pool() -> None:
    window = Window()
    window.book(Line(NOW_NS, 7_000))
    assert sums(window) == {**NOTHING, "charge_pc": 7_000}


# --- what goes to the pool, and to named returns --------------------------------------------------


def test_the_share_of_any_charge_goes_to_the_pool_rounded_up() -> None:
    third = entry(100_000, share=1 / 3)
    assert third.pooled_of(100_000) == 33_334
    assert third.pooled_of(50_000) == 16_667
    assert third.pooled_of(0) == 0


def test_with_named_returns_nothing_goes_to_the_pool() -> None:
    named = entry(100_000, returns=(1, 2), share=1 / 3)
    assert named.pooled_of(100_000) == 0
    assert named.pooled_of(50_000) == 0


@pytest.mark.parametrize(
    ("returns", "pulses", "counted"), [((1,), 1, 1), ((1,), 0, 0), ((1, 2), 1, 0)]
)
def test_a_named_return_carries_all_of_the_charge_and_a_lone_one_the_pulse_as_well(
    returns: tuple[int, ...], pulses: int, counted: int
) -> None:
    """The time with current is the stimulated electrode's own."""
    window = Window()
    line = carried_line(entry(returns=returns, pulses=pulses), NOW_NS, 120_000)
    window.book(line)
    assert line.begun_ns == NOW_NS
    assert sums(window) == {**NOTHING, "charge_pc": 120_000, "pulses": counted}


# --- net charge -----------------------------------------------------------------------------------


def test_what_a_pulse_leaves_is_all_of_its_charge_unless_its_phases_balance() -> None:
    assert entry(100_000).net_pc == 100_000
    assert entry(100_000, net_pc=-100_000).net_pc == -100_000
    assert entry(100_000, net_pc=0).net_pc == 0


@pytest.mark.parametrize(
    ("net_pc", "worst_pc", "leaves_pc"),
    [
        (None, 100_000, 100_000),
        (None, 130_000, 130_000),
        (-100_000, 130_000, -130_000),
        (-1, 130_000, -130_000),
        (1, 130_000, 130_000),
        (0, 130_000, 0),
    ],
)
def test_at_its_worst_a_single_phase_leaves_all_of_that_and_phases_that_balance_nothing(
    net_pc: int | None, worst_pc: int, leaves_pc: int
) -> None:
    assert worst_net_pc(entry(100_000, net_pc=net_pc), worst_pc) == leaves_pc
