"""Net charge of a return that was not read: what its next reading changes, and when it is due."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.safety.net_charge import LEAK_NS, NetCharge

N = 5
BOUND_PC = 1_000_000
NOW_NS = 3_600_000_000_000


@given(st.lists(st.tuples(st.integers(1, N - 1), st.integers(1, 300_000)), max_size=8))
def test_one_that_is_found_to_conduct_better_may_have_done_so_since_it_was_read_before(
    pulses: list[tuple[int, int]],
) -> None:
    """By the new conductance, of all pulses since then; what it carried before stays."""
    net, before_s, better_s = NetCharge(N, BOUND_PC), [1e-5] * N, [4e-5, *[1e-5] * (N - 1)]
    net.set_conductances(before_s, before_s)
    net.add(2, 100_000, None, NOW_NS)
    net.read(0, is_as_before=True)
    net.set_conductances(before_s, before_s)
    for electrode, net_pc in pulses:
        net.add(electrode, net_pc, None, NOW_NS)
    # Others that are found anew change nothing of that.
    net.set_conductances(before_s, before_s)
    net.read(0, is_as_before=True)
    net.set_conductances(better_s, better_s)
    # Three others conduct beside it.
    since_pc = -sum(net_pc * 4 / 7 for _, net_pc in pulses)
    found_pc = net.states(NOW_NS)[1].left_pc[0] + 25_000
    assert 1.2 * since_pc - 1 <= found_pc <= since_pc + 1
    for _ in range(2):
        net.set_conductances(better_s, better_s)
        assert net.states(NOW_NS)[1].left_pc[0] + 25_000 == pytest.approx(found_pc, abs=0.01)


def test_one_that_is_found_to_conduct_worse_has_what_was_counted() -> None:
    net, before_s = NetCharge(N, BOUND_PC), [1e-5] * N
    net.set_conductances(before_s, before_s)
    net.add(2, 400_000, None, NOW_NS)
    net.read(0, is_as_before=True)
    worse_s = [1e-6, *[1e-5] * (N - 1)]
    net.set_conductances(worse_s, worse_s)
    assert net.states(NOW_NS)[1].left_pc[0] == pytest.approx(-100_000)


@pytest.mark.parametrize("own_s", [4e-5, 1e-6])
def test_what_its_own_pulses_brought_is_none_of_what_came_back_through_it(own_s: float) -> None:
    net, before_s, then_s = NetCharge(N, BOUND_PC), [1e-5] * N, [own_s, *[1e-5] * (N - 1)]
    net.set_conductances(before_s, before_s)
    net.add(0, 400_000, None, NOW_NS)
    net.read(0, is_as_before=True)
    net.set_conductances(then_s, then_s)
    assert net.states(NOW_NS)[1].left_pc[0] == pytest.approx(400_000)


def test_what_came_back_before_it_was_read_counts_as_it_conducted_then() -> None:
    """In any unit."""
    net, before_s = NetCharge(N, BOUND_PC), [1e6] * N
    net.set_conductances(before_s, before_s)
    net.add(2, 400_000, None, NOW_NS)
    net.read(0, is_as_before=True)
    net.set_conductances(before_s, before_s)
    better_s = [4e6, *before_s[1:]]
    net.set_conductances(better_s, better_s)
    assert net.states(NOW_NS)[1].left_pc[0] == pytest.approx(-100_000)


def test_one_that_conducts_better_is_unread_until_that_counts() -> None:
    net, before_s, better_s = NetCharge(N, BOUND_PC), [1e-5] * N, [4e-5, *[1e-5] * (N - 1)]
    net.set_conductances(before_s, before_s)
    net.add(2, 300_000, None, NOW_NS)
    net.read(1, is_as_before=True)
    net.read(0, is_as_before=False)
    assert net.unread_pc(1, NOW_NS) == 0.0
    assert net.unread_pc(0, NOW_NS) == pytest.approx(300_000)
    net.set_conductances(better_s, better_s)
    assert net.unread_pc(0, NOW_NS) == 0.0
    # It was, once.
    net.add(2, 100_000, None, NOW_NS)
    net.set_conductances(better_s, better_s)
    assert net.unread_pc(0, NOW_NS) == pytest.approx(100_000)


def test_after_a_minute_what_was_not_read_counts_as_before() -> None:
    """The sums are moved to a new time in between."""
    net, before_s, better_s = NetCharge(N, BOUND_PC), [1e-5] * N, [4e-5, *[1e-5] * (N - 1)]
    net.set_conductances(before_s, before_s)
    net.add(2, 400_000, None, NOW_NS - LEAK_NS)
    net.set_conductances(before_s, before_s)
    later_ns = NOW_NS + 29_500_000_000
    net.add(2, 400_000, None, later_ns)
    assert net.unread_pc(0, later_ns + LEAK_NS) <= BOUND_PC / 2
    net.read(0, is_as_before=True)
    net.set_conductances(better_s, better_s)
    found_pc = net.states(later_ns + LEAK_NS)[1].left_pc[0]
    assert found_pc == pytest.approx(-250_000 * math.exp(-1), rel=1e-6)


def test_a_pulse_that_leaves_nothing_does_not_fit_where_a_reading_has_found_one_full() -> None:
    net, before_s, better_s = NetCharge(N, BOUND_PC), [1e-5] * N, [1.0, *[1e-5] * (N - 1)]
    net.set_conductances(before_s, before_s)
    for electrode in range(1, N):
        net.add(electrode, BOUND_PC // 2, None, NOW_NS)
    assert net.fits(1, 0, None, NOW_NS)
    net.read(0, is_as_before=True)
    net.set_conductances(better_s, better_s)
    assert not net.fits(1, 0, None, NOW_NS)
    assert net.fits(1, -100_000, None, NOW_NS)


@pytest.mark.parametrize("sign", [1, -1])
def test_what_went_through_since_one_was_read_is_its_own_to_the_last_pc(sign: int) -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(1, sign * BOUND_PC // 2, None, NOW_NS)
    net.add(1, sign * BOUND_PC, (0,), NOW_NS)
    assert net.unread_pc(0, NOW_NS) == BOUND_PC // 2
    net.add(1, sign, None, NOW_NS)
    assert net.unread_pc(0, NOW_NS) > BOUND_PC / 2
    assert net.unread_pc(0, NOW_NS + LEAK_NS) <= BOUND_PC / 2
    net.read(0, is_as_before=True)
    assert net.unread_pc(0, NOW_NS) <= BOUND_PC / 2
    assert net.unread_pc(3, NOW_NS) > BOUND_PC / 2
    net.add(1, sign * (BOUND_PC // 2 + 1), None, NOW_NS)
    assert net.unread_pc(0, NOW_NS) > BOUND_PC / 2
    net.add(1, -sign * BOUND_PC // 2, None, NOW_NS)
    assert net.unread_pc(0, NOW_NS) <= BOUND_PC / 2


def test_at_the_very_beginning_nothing_has_gone_through() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(1, BOUND_PC // 2, None, 0)
    assert net.unread_pc(0, 0) == BOUND_PC // 2


def test_what_had_gone_through_when_one_was_read_leaks_as_the_rest_does() -> None:
    """Over the time, too, at which the sums are moved."""
    net = NetCharge(N, BOUND_PC)
    net.add(1, 0.001, None, NOW_NS)
    net.add(1, BOUND_PC, None, NOW_NS + 29_900_000_000)
    net.read(0, is_as_before=True)
    later_ns = NOW_NS + 30_100_000_000
    assert net.unread_pc(3, later_ns) > BOUND_PC / 2
    assert net.unread_pc(0, later_ns) <= BOUND_PC / 2
    net.add(1, BOUND_PC // 2 + 1, None, later_ns)
    assert net.unread_pc(0, later_ns) > BOUND_PC / 2


@pytest.mark.parametrize("sign", [1, -1])
def test_a_scan_brought_what_went_through_since_the_one_before(sign: int) -> None:
    net = NetCharge(N, BOUND_PC)
    assert net.scan_pc == 0.0
    net.add(1, sign * 300_000, None, 0)
    net.scan_over(0)
    assert net.scan_pc == 300_000
    net.add(1, sign * 200_000, None, LEAK_NS)
    net.scan_over(LEAK_NS)
    assert net.scan_pc == pytest.approx(200_000)
    net.scan_over(LEAK_NS)
    assert net.scan_pc == 0.0


def test_the_sums_are_moved_between_two_scans_and_the_second_is_as_it_was() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(1, 300_000, None, 0)
    net.scan_over(29_900_000_000)
    later_ns = 30_100_000_000
    net.add(1, 200_000, None, later_ns)
    net.scan_over(later_ns)
    assert net.scan_pc == pytest.approx(200_000)


def test_conductances_in_another_unit_change_nothing() -> None:
    """As where nothing is known any more, and all are alike."""
    net, before_s = NetCharge(N, BOUND_PC), [1e-5] * N
    net.set_conductances(before_s, before_s)
    net.add(2, 400_000, None, NOW_NS)
    net.set_conductances([1.0] * N, [1.0] * N)
    assert net.all(NOW_NS) == pytest.approx([-100_000, -100_000, 400_000, -100_000, -100_000])


def test_where_none_touches_by_now_nothing_more_came_back() -> None:
    net, before_s = NetCharge(N, BOUND_PC), [1e-5] * N
    net.set_conductances(before_s, before_s)
    net.add(2, 400_000, None, NOW_NS)
    net.set_conductances([0.0] * N, [0.0] * N)
    assert net.all(NOW_NS) == pytest.approx([-100_000, -100_000, 400_000, -100_000, -100_000])


def test_estimates_that_go_up_and_down_between_two_readings_add_nothing() -> None:
    """Of another contact that flickers, say."""
    net, before_s, better_s = NetCharge(N, BOUND_PC), [1e-5] * N, [4e-5, *[1e-5] * (N - 1)]
    net.set_conductances(before_s, before_s)
    net.add(2, 400_000, None, NOW_NS)
    for conducts_s in (better_s, before_s) * 20:
        net.set_conductances(conducts_s, conducts_s)
    assert net.all(NOW_NS) == pytest.approx([-100_000, -100_000, 400_000, -100_000, -100_000])
