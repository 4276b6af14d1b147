"""Net charge: what is counted of each pulse, and that no electrode passes its bound."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd.safety.net_charge import LEAK_NS, LEAST_S, NetCharge, others_s, parts_of

N = 5
BOUND_PC = 1_000_000
NOW_NS = 3_600_000_000_000

Visit = tuple[int, int, int, tuple[int, ...] | None]


def _returns(electrode: int, offsets: set[int] | None) -> tuple[int, ...] | None:
    return None if offsets is None else tuple((electrode + it) % N for it in offsets)


def _sorted(drawn: list[tuple[int, int, int, set[int] | None]]) -> list[Visit]:
    return [
        (at_ns, electrode, net_pc, _returns(electrode, offsets))
        for at_ns, electrode, net_pc, offsets in sorted(drawn, key=lambda each: each[0])
    ]


#: One that touches nothing, and one that nothing is known of but that it conducts best.
conductances = st.lists(st.sampled_from([0.0, 1e-6, 2e-5, 3e-4]), min_size=N, max_size=N).filter(
    any
)

visits = st.lists(
    st.tuples(
        st.integers(0, 3_000_000_000),
        st.integers(0, N - 1),
        st.integers(-900_000, 900_000),
        st.none() | st.sets(st.integers(1, N - 1), min_size=1),
    ),
    max_size=40,
).map(_sorted)


def by_hand_pc(
    booked: list[Visit],
    electrode: int,
    now_ns: int,
    conducts_s: Sequence[Sequence[float]] = (),
    *,
    is_named_whole: bool = False,
) -> float:
    """Each pulse for itself: all of it at its electrode, an even part back at each return, or the
    part of what each conducts at that pulse; of those that it names, all of it at each.
    """
    total = 0.0
    for place, (at_ns, own, net_pc, returns) in enumerate(booked):
        left_pc = net_pc * math.exp(-(now_ns - at_ns) / LEAK_NS)
        others = [other for other in range(N) if other != own] if returns is None else returns
        here = conducts_s[place] if conducts_s else [1.0] * N
        whole = sum(here[other] for other in others)
        if electrode == own:
            total += left_pc
        elif is_named_whole and returns is not None:
            total -= left_pc if electrode in returns else 0.0
        elif electrode in others and whole:
            total -= left_pc * here[electrode] / whole
        elif electrode in others and returns is not None:
            total -= left_pc / len(others)
    return total


@given(visits)
def test_each_electrode_has_its_own_pulses_less_what_it_carried_back(booked: list[Visit]) -> None:
    net = NetCharge(N, BOUND_PC)
    for at_ns, electrode, net_pc, returns in booked:
        net.add(electrode, net_pc, returns, NOW_NS + at_ns)
    now_ns = booked[-1][0] + 100_000_000 if booked else 0
    wanted = [by_hand_pc(booked, electrode, now_ns) for electrode in range(N)]
    assert net.states(NOW_NS + now_ns)[0].left_pc == pytest.approx(wanted, abs=0.01)
    most = [by_hand_pc(booked, electrode, now_ns, is_named_whole=True) for electrode in range(N)]
    assert net.states(NOW_NS + now_ns)[2].left_pc == pytest.approx(most, abs=0.01)
    larger = [max(map(abs, pair)) for pair in zip(wanted, most, strict=True)]
    assert list(map(abs, net.all(NOW_NS + now_ns))) == pytest.approx(larger, abs=0.01)
    each = [abs(net.of(electrode, NOW_NS + now_ns)) for electrode in range(N)]
    assert each == pytest.approx(larger, abs=0.01)


@settings(max_examples=200)
@given(visits, st.data())
def test_of_all_ways_to_share_the_one_that_leaves_most_is_told(
    booked: list[Visit], data: st.DataObject
) -> None:
    net, held = NetCharge(N, BOUND_PC), list[list[float]]()
    for at_ns, electrode, net_pc, returns in booked:
        before = held[-1] if held else [1.0] * N
        here = data.draw(conductances | st.just(before))
        # They are read, and conduct otherwise only then.
        for other in range(N):
            net.read(other, is_as_before=True)
        net.set_conductances(before, before)
        net.set_conductances(here, here)
        held.append(here)
        net.add(electrode, net_pc, returns, NOW_NS + at_ns)
    now_ns = booked[-1][0] + 100_000_000 if booked else 0
    even, measured, most = net.states(NOW_NS + now_ns)
    wanted = [by_hand_pc(booked, electrode, now_ns) for electrode in range(N)]
    by_conductance = [by_hand_pc(booked, electrode, now_ns, held) for electrode in range(N)]
    assert list(even.left_pc) == pytest.approx(wanted, abs=1.0)
    assert list(measured.left_pc) == pytest.approx(by_conductance, abs=1.0)
    whole = [
        by_hand_pc(booked, electrode, now_ns, held, is_named_whole=True) for electrode in range(N)
    ]
    assert list(most.left_pc) == pytest.approx(whole, abs=1.0)
    more = [max(each, key=abs) for each in zip(wanted, by_conductance, whole, strict=True)]
    assert [abs(pc) for pc in net.all(NOW_NS + now_ns)] == pytest.approx(
        [abs(pc) for pc in more], abs=1.0
    )


@settings(max_examples=200)
@given(visits, conductances)
def test_what_fits_keeps_the_bound_however_returns_share_between_the_two_ways(
    asked: list[Visit], conducts_s: list[float]
) -> None:
    net, booked = NetCharge(N, BOUND_PC), list[Visit]()
    net.set_conductances(conducts_s, conducts_s)
    for at_ns, electrode, net_pc, returns in asked:
        if net.fits(electrode, net_pc, returns, NOW_NS + at_ns):
            net.add(electrode, net_pc, returns, NOW_NS + at_ns)
            booked.append((at_ns, electrode, net_pc, returns))
    now_ns = booked[-1][0] if booked else 0
    held = [conducts_s] * len(booked)
    for electrode in range(N):
        even_pc = by_hand_pc(booked, electrode, now_ns)
        conducted_pc = by_hand_pc(booked, electrode, now_ns, held)
        for part in (0.0, 0.3, 1.0):
            assert abs(part * even_pc + (1.0 - part) * conducted_pc) <= BOUND_PC + 1.0


def test_the_direct_current_of_all_is_more_than_one_return_may_carry() -> None:
    net = NetCharge(N, BOUND_PC)
    for electrode in range(N - 1):
        net.add(electrode, BOUND_PC // 4, None, NOW_NS)
    assert not net.exceeds_one_return(NOW_NS)
    net.add(N - 1, BOUND_PC // 4, (0,), NOW_NS)
    assert not net.exceeds_one_return(NOW_NS), "it names its return"
    net.add(N - 1, BOUND_PC // 4, None, NOW_NS)
    assert net.exceeds_one_return(NOW_NS)
    assert not net.exceeds_one_return(NOW_NS + LEAK_NS)


def test_a_return_counts_for_the_most_that_it_may_conduct_beside_what_others_do() -> None:
    net, middle_s = NetCharge(N, BOUND_PC), [1e-5] * N
    net.set_conductances(middle_s, [3e-5, *middle_s[1:]])
    net.add(1, 100_000, None, NOW_NS)
    net.add(0, 40_000, (2,), NOW_NS)
    assert net.of(0, NOW_NS) == pytest.approx(-75_000 + 40_000)
    assert net.of(3, NOW_NS) == pytest.approx(-25_000)
    assert net.states(NOW_NS)[2].beside_s == middle_s
    # Three quarters of the bound come back there; twice is too much.
    assert net.fits(3, BOUND_PC, None, NOW_NS)
    net.add(3, BOUND_PC, None, NOW_NS)
    assert not net.fits(4, BOUND_PC, None, NOW_NS)


@settings(max_examples=200)
@given(visits)
def test_what_fits_never_takes_an_electrode_past_its_bound(asked: list[Visit]) -> None:
    net, booked = NetCharge(N, BOUND_PC), list[Visit]()
    for at_ns, electrode, net_pc, returns in asked:
        before = in_both_ways_pc(booked, at_ns)
        then = [*booked, (at_ns, electrode, net_pc, returns)]
        after = in_both_ways_pc(then, at_ns)
        is_kept = all(
            abs(now) <= max(BOUND_PC, abs(was)) for was, now in zip(before, after, strict=True)
        )
        fits = net.fits(electrode, net_pc, returns, NOW_NS + at_ns)
        if all(abs(abs(pc) - BOUND_PC) > 1.0 for pc in after):
            assert fits == is_kept
        if fits:
            net.add(electrode, net_pc, returns, NOW_NS + at_ns)
            booked = then


def in_both_ways_pc(booked: list[Visit], now_ns: int) -> list[float]:
    """Named returns share evenly, and each carries all."""
    return [
        by_hand_pc(booked, electrode, now_ns, is_named_whole=is_whole)
        for is_whole in (False, True)
        for electrode in range(N)
    ]


def test_a_pulse_that_brings_an_electrode_back_fits_however_far_it_is() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(2, 3 * BOUND_PC, None, NOW_NS)
    assert not net.fits(2, 1, None, NOW_NS)
    assert net.fits(2, -100_000, None, NOW_NS)
    # The others are within theirs, and a return of a pulse at 2 comes nearer as well.
    assert not net.fits(3, -100_000, (2,), NOW_NS)
    assert net.fits(3, 100_000, (2,), NOW_NS)


def test_a_return_that_is_full_keeps_a_pulse_back() -> None:
    """Whose electrode itself would have room."""
    net = NetCharge(N, BOUND_PC)
    net.add(1, BOUND_PC, (0,), NOW_NS)
    assert net.of(0, NOW_NS) == -BOUND_PC
    assert net.fits(2, 100_000, (3, 4), NOW_NS)
    assert not net.fits(2, 100_000, (0, 3), NOW_NS)
    assert not net.fits(2, 100_000, None, NOW_NS)
    assert net.fits(2, -100_000, (0, 3), NOW_NS)
    # Electrode 1 is full the other way.
    assert not net.fits(2, -100_000, None, NOW_NS)


def test_it_leaks_to_a_hundredth_in_five_seconds() -> None:
    net = NetCharge(2, BOUND_PC)
    net.add(0, BOUND_PC, None, NOW_NS)
    later_ns = NOW_NS + 5_000_000_000
    assert net.of(0, later_ns) == pytest.approx(BOUND_PC * math.exp(-5), rel=1e-12)
    assert net.of(1, later_ns) == pytest.approx(-BOUND_PC * math.exp(-5), rel=1e-12)


def test_half_a_minute_after_the_first_it_leaks_as_before() -> None:
    """The sums are moved to a new time then."""
    net = NetCharge(2, BOUND_PC)
    net.add(0, 0.001, None, NOW_NS)
    net.add(0, 1.1 * BOUND_PC, None, NOW_NS + 29_900_000_000)
    assert net.exceeds_one_return(NOW_NS + 29_900_000_000)
    later_ns = NOW_NS + 30_100_000_000
    assert net.of(0, later_ns) == pytest.approx(1.1 * BOUND_PC * math.exp(-0.2))
    assert not net.exceeds_one_return(later_ns)


def test_before_the_first_pulse_there_is_nothing_whatever_returns_conduct() -> None:
    net = NetCharge(N, BOUND_PC)
    for conducts_s in ([1e-5] * N, [2e-5] * N):
        assert net.all(0) == [0.0] * N
        net.set_conductances(conducts_s, conducts_s)
    assert net.all(0) == [0.0] * N


def test_just_the_bound_is_kept_and_no_more() -> None:
    net = NetCharge(N, BOUND_PC)
    assert net.fits(2, BOUND_PC, None, 0)
    assert not net.fits(2, BOUND_PC + 1, None, 0)
    net.add(2, BOUND_PC, None, 0)
    assert not net.exceeds_one_return(0)
    net.add(2, 1, None, 0)
    assert net.exceeds_one_return(0)


def test_a_pulse_that_turns_a_charge_round_is_none_that_brings_it_back() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(2, 3 * BOUND_PC, (0,), 0)
    assert not net.fits(2, -6 * BOUND_PC, (0,), 0)
    assert net.fits(2, -6 * BOUND_PC + 1, (0,), 0)


def test_a_pulse_that_leaves_nothing_fits_unless_one_of_its_path_is_above_its_bound() -> None:
    net = NetCharge(N, BOUND_PC)
    assert net.fits(2, 0, None, NOW_NS)
    net.add(2, 3 * BOUND_PC, (1, 3), NOW_NS)
    assert not net.fits(2, 0, (4,), NOW_NS)
    assert not net.fits(4, 0, (1, 3), NOW_NS)
    assert net.fits(4, 0, (0,), NOW_NS)
    assert not net.fits(4, 0, None, NOW_NS)
    assert net.fits(2, 0, None, NOW_NS + 2 * LEAK_NS)


@pytest.mark.parametrize(
    ("conducts_s", "rounds"),
    [
        # Measured, all of it has come back at the first; by even parts a quarter has.
        ([1e-4, 0.0, 0.0, 0.0, 0.0], 1),
        # Measured, none of it has; by even parts three times two fifths of the bound.
        ([0.0, 1e-4, 1e-4, 1e-4, 1e-4], 3),
    ],
)
def test_a_pulse_that_leaves_nothing_does_not_fit_where_either_account_is_above_the_bound(
    conducts_s: list[float], rounds: int
) -> None:
    net = NetCharge(N, BOUND_PC)
    net.set_conductances(conducts_s, conducts_s)
    for _ in range(rounds):
        for electrode in range(1, N):
            net.add(electrode, 0.4 * BOUND_PC, None, NOW_NS)
        # What room there is is counted anew, as long as a pulse fits by even parts.
        net.fits(1, 1, None, NOW_NS)
    above = [max(map(abs, state.left_pc)) > BOUND_PC for state in net.states(NOW_NS)[:2]]
    assert sum(above) == 1
    assert not net.fits(1, 0, None, NOW_NS)


@pytest.mark.parametrize(
    ("conducts_s", "pulse_pc"),
    [
        # Measured, all of it comes back at the first.
        ([1e-4, 0.0, 0.0, 0.0, 0.0], BOUND_PC // 4),
        # By even parts a quarter does, and measured nothing.
        ([0.0, 1e-4, 1e-4, 1e-4, 1e-4], BOUND_PC),
    ],
)
def test_a_pulse_fits_where_it_fits_by_both_ways_to_share(
    conducts_s: list[float], pulse_pc: int
) -> None:
    net = NetCharge(N, BOUND_PC)
    net.set_conductances(conducts_s, conducts_s)
    for electrode in range(1, N):
        net.add(electrode, pulse_pc, None, NOW_NS)
    worst_pc = [max(map(abs, state.left_pc)) for state in net.states(NOW_NS)]
    assert max(worst_pc) == pytest.approx(BOUND_PC)
    assert min(worst_pc) <= BOUND_PC / 4 + 1
    assert not net.fits(1, 10_000, None, NOW_NS)
    assert net.fits(1, -10_000, None, NOW_NS)


#: Which way the pulses of all electrodes but the first come back, at which time after an earlier
#: one: by what returns conduct, in any unit, and by name.
ways_back = pytest.mark.parametrize(
    ("conducts", "returns"),
    [
        ([1.0] * N, None),
        ([1e-6] * N, None),
        ([1e6] * N, None),
        ([3e6, 2e6, 1e6, 1e6, 1e6], None),
        ([3e-6, 2e-6, 1e-6, 1e-6, 1e-6], None),
        ([1.0] * N, (0,)),
    ],
)


@ways_back
@pytest.mark.parametrize("after_ns", [0, 2_000_000_000])
@pytest.mark.parametrize("pulse_pc", [10_000, -10_000])
def test_pulses_all_around_fit_until_what_they_share_is_at_its_bound_and_not_after(
    conducts: list[float], returns: tuple[int, ...] | None, after_ns: int, pulse_pc: int
) -> None:
    net, now_ns, booked = NetCharge(N, BOUND_PC), NOW_NS + after_ns, list[Visit]()
    net.add(4, 0.001, None, NOW_NS)
    net.set_conductances(conducts, conducts)
    electrode = 1
    while net.fits(electrode, pulse_pc, returns, now_ns):
        net.add(electrode, pulse_pc, returns, now_ns)
        booked.append((after_ns, electrode, pulse_pc, returns))
        electrode = 1 + electrode % (N - 1)
    held = [conducts] * (len(booked) + 1)
    at_bound = [by_hand_pc(booked, 0, after_ns), by_hand_pc(booked, 0, after_ns, held)]
    then = [*booked, (after_ns, electrode, pulse_pc, returns)]
    past = [by_hand_pc(then, 0, after_ns), by_hand_pc(then, 0, after_ns, held)]
    assert max(map(abs, at_bound)) <= BOUND_PC + 1 < max(map(abs, past)) + 2
    # Those that named it have filled it for those that do not.
    assert not net.fits(electrode, 5 * pulse_pc, None, now_ns)


def test_one_that_named_returns_have_filled_is_no_return_that_has_room() -> None:
    net = NetCharge(N, BOUND_PC)
    for electrode in range(1, N):
        net.add(electrode, BOUND_PC // 4, (0,), NOW_NS)
    assert not net.fits(1, 100_000, None, NOW_NS)
    assert net.fits(1, -100_000, None, NOW_NS)


def test_one_that_its_own_pulses_have_filled_is_no_return_that_has_room() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(0, BOUND_PC, None, NOW_NS)
    assert net.fits(1, 100_000, None, NOW_NS)
    assert not net.fits(1, -100_000, None, NOW_NS)


def test_what_counts_from_an_earlier_time_has_filled_an_electrode_then() -> None:
    net = NetCharge(N, BOUND_PC)
    assert net.fits(0, 1, None, NOW_NS)
    net.add(0, BOUND_PC, None, NOW_NS - LEAK_NS)
    assert not net.fits(1, -100_000, None, NOW_NS - LEAK_NS)
    assert net.fits(1, -100_000, None, NOW_NS)


def test_what_is_left_of_each_pulse_is_what_one_return_would_carry() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(0, 0.001, None, NOW_NS)
    net.add(0, 1.1 * BOUND_PC, None, NOW_NS + LEAK_NS)
    assert net.exceeds_one_return(NOW_NS + LEAK_NS)


def test_none_carries_more_than_all_of_what_another_one_sends() -> None:
    assert others_s([1.0, 1.0, 1.0], [1.0, 1.0, 1.0]) == [2.0, 2.0, 2.0]
    assert others_s([5.0, 1.0, 1.0], [1.0, 1.0, 1.0]) == [2.0, 5.0, 5.0]
    # The best of the others where two are alike, and where one is the best beside a better one.
    assert others_s([1.0, 1.0, 0.5], [0.9, 0.05, 0.05]) == [1.0, 1.0, 1.0]
    assert others_s([9.0, 2.0, 0.5], [0.9, 0.05, 0.05]) == [2.0, 9.0, 9.0]
    assert others_s([2.0, 1.0], [0.9, 0.1]) == [1.0, 2.0]
    assert others_s([1.0], [1.0]) == [LEAST_S]


def test_named_returns_that_conduct_nothing_share_evenly() -> None:
    assert parts_of((0, 2), [0.0, 1e-5, 0.0], is_whole=False) == [0.5, 0.5]
    assert parts_of((0, 2), [LEAST_S, 1e-5, 0.0], is_whole=False) == [0.5, 0.5]
    assert parts_of((0, 2), [3e-5, 1e-5, 1e-5], is_whole=False) == pytest.approx([0.75, 0.25])


def test_what_is_taken_back_is_gone_and_what_is_corrected_counts_from_its_time() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(0, 200_000, (1, 2), NOW_NS)
    net.add(0, -200_000, (1, 2), NOW_NS)
    assert net.all(NOW_NS + 1) == pytest.approx([0.0] * N, abs=1e-6)


def test_days_without_a_pulse_are_no_overflow() -> None:
    net = NetCharge(N, BOUND_PC)
    net.add(0, 200_000, None, 0)
    days_ns = 30 * 86_400 * 1_000_000_000
    assert net.all(days_ns) == pytest.approx([0.0] * N, abs=1e-6)
    net.add(0, 200_000, None, days_ns)
    assert net.of(0, days_ns) == pytest.approx(200_000)
