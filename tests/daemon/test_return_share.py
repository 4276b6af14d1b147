"""Who shares a current, and how: by what pulses told within a second."""

from __future__ import annotations

import math

import pytest

from etd.pulse.measured import CONTACT_POLL_NS, MAX_AGE_NS
from etd.safety.conductance import Reading
from etd.safety.return_parts import most_parts
from etd.safety.return_share import REFRESH_NS, ReturnShare
from etd_body.electrode import Contact, load, skin
from path_readings import METER, exact, paths_ohm, sampled
from plain_records import changed

START_NS = 5_000_000_000
EVEN = load(50e3)


def seen(*contacts: Contact | None, at_ns: int = START_NS) -> ReturnShare:
    """Electrodes that each had a pulse; None: nothing touches there."""
    sharing = ReturnShare(len(contacts), METER)
    touching = [contact for contact in contacts if contact is not None]
    found = iter(paths_ohm(touching))
    for electrode, contact in enumerate(contacts):
        path_ohm = 1e7 if contact is None else next(found)
        sharing.update(electrode, contact is not None, at_ns, exact(path_ohm))
    sharing.refresh(at_ns)
    return sharing


def carried(sharing: ReturnShare, electrode: int, now_ns: int) -> list[float]:
    """Of its current, by each of the others."""
    sharing.refresh(now_ns)
    share, weights = sharing.share(electrode), sharing.weights(now_ns)
    return [min(1.0, share * weight) for other, weight in enumerate(weights) if other != electrode]


def test_all_are_known_where_each_was_measured_or_touches_nothing() -> None:
    sharing, late_ns = seen(EVEN, EVEN, None), START_NS + MAX_AGE_NS + REFRESH_NS
    assert (sharing.are_all_known, ReturnShare(3, METER).are_all_known) == (True, False)
    sharing.update(0, True, late_ns, exact(50e3))
    sharing.refresh(late_ns)
    assert not sharing.are_all_known


def test_where_nothing_is_known_one_return_may_carry_it_all() -> None:
    sharing = ReturnShare(4, METER)
    sharing.refresh(START_NS)
    assert carried(sharing, 0, START_NS) == [1.0] * 3


def test_those_that_are_alike_share_equally() -> None:
    sharing = seen(*[EVEN] * 8)
    assert carried(sharing, 0, START_NS + 1) == pytest.approx([1 / 7] * 7, rel=0.02)


def test_those_that_conduct_better_carry_more() -> None:
    sharing = seen(*[load(152e3)] * 15, load(2e3))
    parts = carried(sharing, 0, START_NS + 1)
    assert parts[-1] == pytest.approx(0.844, rel=0.05)
    # An equal part, though they conduct a sixth of that: capacitances share alike at first.
    assert parts[:-1] == pytest.approx([1 / 15] * 14, rel=0.06)
    # Those of the one are shared by the 15, and booked with what is an equal part in other pulses.
    assert carried(sharing, 15, START_NS + 1) == pytest.approx([0.38] * 15, rel=0.05)


def test_an_equal_part_is_one_of_those_that_touch() -> None:
    """Open electrodes take no part of it."""
    parts = carried(seen(*[load(152e3)] * 7, load(2e3), *[None] * 8), 0, START_NS + 1)
    assert parts[:6] == pytest.approx([1 / 7] * 6, rel=0.1)


def test_one_that_is_open_counts_for_an_equal_part_because_a_touch_is_not_known_at_once() -> None:
    parts = carried(seen(*[EVEN] * 8, None), 0, START_NS + 1)
    # What it would carry of 8 returns at the least; it counts for one of 7.
    assert 1 / 8 < parts[-1] < 1 / 5


def test_forgetting_is_knowing_nothing() -> None:
    sharing = seen(*[EVEN] * 4)
    sharing.reset()
    sharing.refresh(START_NS)
    assert carried(sharing, 0, START_NS) == [1.0] * 3
    assert sharing.reading(0) is None


def test_a_look_is_believed_for_a_second_and_then_it_may_be_the_best_that_was_seen() -> None:
    sharing = seen(load(50e3), load(50e3), load(50e3), load(25e3), load(100e3))
    half_ns = START_NS + MAX_AGE_NS // 2
    for electrode in (1, 2):
        sharing.update(electrode, True, half_ns, sharing.reading(electrode))
    late_ns = START_NS + MAX_AGE_NS
    assert carried(sharing, 0, late_ns - 1)[-1] == pytest.approx(1 / 4, rel=0.05)
    sharing.refresh(late_ns)
    # Two of 50 k are known, and one of 25 k was seen.
    assert carried(sharing, 0, late_ns)[-2:] == pytest.approx([1.0] * 2, abs=0.05)
    assert [sharing.is_known(electrode, late_ns) for electrode in range(5)] == [
        False, True, True, False, False,
    ]  # fmt: skip
    assert carried(sharing, 0, half_ns + MAX_AGE_NS) == [1.0] * 4


@pytest.mark.parametrize("is_through_chosen", [True, False])
def test_when_one_is_lost_no_look_from_before_counts(is_through_chosen: bool) -> None:
    sharing = seen(*[EVEN] * 5)
    if is_through_chosen:
        sharing.lose(4)
    else:
        sharing.update(4, False, START_NS + 1)
    sharing.refresh(START_NS + 2)
    assert max(carried(sharing, 0, START_NS + 2)) == 1.0
    for electrode in (1, 2, 3):
        sharing.update(electrode, True, START_NS + 2, exact(paths_ohm([EVEN] * 4)[0]))
    sharing.refresh(START_NS + 3 + REFRESH_NS)
    # Three of 50 k are known again. One of four is not, so nothing bounds their way back closely,
    # and what bounded them before was another array.
    assert carried(sharing, 0, START_NS + 3)[:3] == pytest.approx([2 / 3] * 3, rel=0.05)


def test_when_one_is_lost_what_follows_is_found_anew_before_the_next_pulse() -> None:
    sharing = seen(EVEN, EVEN, EVEN, None)
    assert sharing.is_known(3, START_NS + 1)
    assert not sharing.refresh(START_NS + 1)
    sharing.lose(0)
    assert sharing.refresh(START_NS + 1)
    # One that was open may touch now: what moved one contact may have moved it.
    assert [sharing.is_known(electrode, START_NS + 1) for electrode in (1, 2, 3)] == [False] * 3


def test_when_one_is_lost_the_best_from_before_still_stands_for_those_that_are_unknown() -> None:
    sharing = seen(load(5e3), *[load(100e3)] * 6)
    sharing.lose(6)
    for electrode in range(1, 6):
        sharing.update(electrode, True, START_NS + 1, exact(120e3))
    assert sharing.refresh(START_NS + 1)
    assert carried(sharing, 1, START_NS + 1)[0] == 1.0
    # 5 k beside four of some 120 k.
    assert sharing.share(1) == pytest.approx(120 / 5 / 4, rel=0.2)


def lost_all_but(sharing: ReturnShare, known: int, path_ohm: float, at_ns: int) -> None:
    """A contact was lost, and so many of the others were read since."""
    sharing.lose(15)
    for electrode in range(known):
        sharing.update(electrode, True, at_ns, exact(path_ohm))
    sharing.refresh(at_ns)


@pytest.mark.parametrize("known", [1, 2, 7])
def test_while_less_than_half_are_known_each_counts_as_the_best_that_was_seen(known: int) -> None:
    """What bounds the few allows them anything: that filled the array's second for two."""
    sharing = seen(*[EVEN] * 16)
    lost_all_but(sharing, known, paths_ohm([EVEN] * 15)[0], START_NS + 1)
    assert sharing.weights(START_NS + 1) == [1.0] * 16
    # Of those that are read, one is the electrode itself: all, or by what the others conduct.
    assert sharing.share(0) == pytest.approx(1.0 if known < 3 else 1 / 6, rel=0.2)
    assert sharing.share(0) <= 1.0
    for electrode in range(known, 15):
        sharing.update(electrode, True, START_NS + 2, exact(paths_ohm([EVEN] * 15)[0]))
    later_ns = START_NS + 2 + REFRESH_NS
    assert carried(sharing, 0, later_ns)[:14] == pytest.approx([1 / 14] * 14, rel=0.1)
    # Nor is that taken for the best for ever after.
    assert sharing.share(0) == pytest.approx(1 / 14, rel=0.1)


def test_from_half_on_one_that_nothing_bounds_may_carry_all_again() -> None:
    sharing = seen(*[EVEN] * 16)
    lost_all_but(sharing, 7, paths_ohm([EVEN] * 15)[0], START_NS + 1)
    now_ns = START_NS + 2
    # Its path reads as what the way back alone may be: it may be next to nothing itself.
    sharing.update(7, True, now_ns, exact(3e3))
    now_ns += REFRESH_NS
    assert carried(sharing, 0, now_ns)[6] == 1.0


def test_the_best_is_kept_while_few_are_known() -> None:
    sharing = seen(*[EVEN] * 8, load(10e3))
    late_ns = START_NS + MAX_AGE_NS
    for electrode in (0, 1, 2):
        sharing.update(electrode, True, late_ns, sharing.reading(electrode))
    sharing.refresh(late_ns + REFRESH_NS)
    # One of 10 k was seen, and two of 50 k are known beside electrode 0.
    assert sharing.share(0) == 1.0
    for electrode in (3, 4):
        sharing.update(electrode, True, late_ns, sharing.reading(electrode))
    sharing.refresh(late_ns + 2 * REFRESH_NS)
    assert sharing.share(0) == pytest.approx(5.0 / 4.0, rel=0.1)


def test_one_that_never_touched_is_not_lost() -> None:
    sharing = seen(EVEN, EVEN, EVEN, None)
    before = carried(sharing, 0, START_NS + 2)
    sharing.update(3, False, START_NS + 1)
    sharing.lose(3)
    assert carried(sharing, 0, START_NS + 2) == before


def test_a_touch_without_a_reading_is_not_known() -> None:
    sharing = ReturnShare(3, METER)
    sharing.update(0, True, START_NS)
    assert not sharing.is_known(0, START_NS)
    sharing.update(0, True, START_NS, exact(75e3))
    assert sharing.is_known(0, START_NS)
    sharing.update(0, True, START_NS + MAX_AGE_NS - 1)
    assert sharing.is_known(0, START_NS + MAX_AGE_NS - 1)
    sharing.update(0, True, START_NS + MAX_AGE_NS)
    assert not sharing.is_known(0, START_NS + MAX_AGE_NS)


def test_readings_are_taken_four_times_a_second() -> None:
    sharing = seen(EVEN, EVEN)
    assert sharing.read_from_ns[0] == START_NS + REFRESH_NS
    assert REFRESH_NS == 250_000_000
    sharing.reset()
    assert sharing.read_from_ns[0] == 0


def test_what_a_contact_conducts_at_the_most_stays_bound_when_the_others_are_not_known() -> None:
    sharing = seen(*[EVEN] * 16)
    later_ns = START_NS + 2 * MAX_AGE_NS
    for electrode in range(3):
        sharing.update(electrode, True, later_ns, exact(paths_ohm([EVEN] * 16)[0]))
    sharing.refresh(later_ns + REFRESH_NS)
    assert sharing.most_s[0] == pytest.approx(EVEN.conductance_s, rel=0.01)


def loosely(least_ohm: float) -> Reading:
    """Of a path that may resist twice that."""
    return changed(exact(least_ohm), most_ohm=2.0 * least_ohm)


def test_a_path_that_falls_lowers_the_own_resistance_and_one_that_rises_does_not_raise_it() -> None:
    sharing = seen(*[EVEN] * 16)
    path_ohm, later_ns = paths_ohm([EVEN] * 16)[0], START_NS + 2 * MAX_AGE_NS
    for step, ohm in enumerate((path_ohm - 20e3, path_ohm, path_ohm + 20e3)):
        now_ns = later_ns + step * REFRESH_NS
        sharing.update(0, True, now_ns, loosely(ohm))
        assert sharing.refresh(now_ns)
        least_ohm = 1.0 / sharing.most_s[0]
        assert least_ohm == pytest.approx(50e3 - max(0.0, path_ohm - ohm), rel=0.01)


@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_a_path_that_cannot_be_the_one_of_before_drops_what_was_kept_of_all(factor: float) -> None:
    sharing = seen(*[EVEN] * 16)
    path_ohm, later_ns = paths_ohm([EVEN] * 16)[0], START_NS + 2 * MAX_AGE_NS
    sharing.update(0, True, later_ns, exact(factor * path_ohm))
    for electrode in (0, 1):
        sharing.update(electrode, True, later_ns, exact(factor * path_ohm))
        sharing.refresh(later_ns + electrode * REFRESH_NS)
        assert sharing.most_s[electrode] == math.inf


def test_one_that_nothing_bounds_may_carry_all_however_long_ago_it_was_read() -> None:
    sharing = ReturnShare(3, METER)
    for electrode, ohm in enumerate((300e3, 300e3, 100e3)):
        sharing.update(electrode, True, START_NS, exact(ohm))
    sharing.refresh(START_NS)
    assert sharing.most_s[2] == math.inf
    for now_ns in (START_NS, START_NS + 10 * MAX_AGE_NS):
        sharing.refresh(now_ns)
        assert carried(sharing, 0, now_ns)[-1] == 1.0


# --- conductances ---------------------------------------------------------------------------------


def test_of_known_ones_the_likely_part_and_the_most_follow_from_their_paths() -> None:
    """An open one has none."""
    sharing = seen(*[EVEN] * 7, load(25e3), None)
    likely, most = sharing.parts(START_NS)
    assert likely == pytest.approx([1 / 9] * 7 + [2 / 9, 0.0], rel=0.02)
    assert most[8] == 0.0
    for part, up_to in zip(likely[:8], most[:8], strict=True):
        assert part <= up_to <= 1.1 * part


def test_how_far_a_path_is_known_is_how_far_the_most_lies_above_what_is_likely() -> None:
    sharing = ReturnShare(8, METER)
    for electrode, ohm in enumerate(paths_ohm([EVEN] * 8)):
        sharing.update(electrode, True, START_NS, vague(ohm, 1.4))
    sharing.refresh(START_NS)
    likely, most = sharing.parts(START_NS)
    assert likely == pytest.approx([1 / 8] * 8, rel=0.02)
    assert 0.17 < min(most) <= max(most) < 0.19


def test_what_is_likely_lies_between_the_least_and_the_most_however_far_these_are_apart() -> None:
    paths = paths_ohm([EVEN] * 8)
    sharing = ReturnShare(8, METER)
    for electrode, ohm in enumerate(paths):
        times = 1.4 if electrode < 4 else 1.01
        sharing.update(electrode, True, START_NS, vague(ohm, times))
    sharing.refresh(START_NS)
    assert sharing.parts(START_NS)[0] == pytest.approx([1 / 8] * 8, rel=0.02)


def test_the_way_back_makes_a_rise_longer_and_what_it_may_end_at_more() -> None:
    """Of few contacts; it resists a seventh of each."""
    on = [skin(2e3, 98e3, 0.3)] * 8
    sharing, readings = ReturnShare(8, METER), list[Reading]()
    for electrode in range(8):
        reading = METER.read(sampled(on, electrode, 300, 50), None)
        assert reading is not None
        readings.append(reading)
        sharing.update(electrode, True, START_NS, reading)
    sharing.refresh(START_NS)
    at_once = most_parts(
        [1.0 / METER.most_ohm(reading, 0.0) for reading in readings],
        [1.0 / reading.least_ohm for reading in readings],
    )
    assert min(sharing.parts(START_NS)[1]) > 1.02 * max(at_once)


def test_an_unknown_one_conducts_as_well_as_the_best_and_an_unbounded_one_may_carry_all() -> None:
    sharing = ReturnShare(6, METER)
    for electrode, ohm in enumerate((300e3, 300e3, 300e3, 100e3)):
        sharing.update(electrode, True, START_NS, exact(ohm))
    # The source was at its end there: it may resist anything. And the sixth was never read.
    at_end = changed(exact(100e3), most_ohm=math.inf)
    sharing.update(4, True, START_NS, at_end)
    sharing.refresh(START_NS)
    likely, most = sharing.parts(START_NS)
    assert most[3] == 1.0
    assert likely[3] == likely[5] == most[5] == max(likely)
    assert 0.0 < likely[4] <= likely[3]
    shorted = changed(exact(300e3), least_ohm=0.0)
    sharing.update(0, True, START_NS + REFRESH_NS, shorted)
    sharing.refresh(START_NS + REFRESH_NS)
    likely, most = sharing.parts(START_NS + REFRESH_NS)
    assert most[0] == 1.0
    assert 0.0 < min(likely) <= max(likely) < 1.0


def test_where_few_are_known_all_conduct_alike() -> None:
    sharing = ReturnShare(5, METER)
    sharing.refresh(START_NS)
    assert sharing.parts(START_NS) == ([0.2] * 5, [0.2] * 5)
    for electrode in (0, 1):
        sharing.update(electrode, True, START_NS, exact(75e3))
    sharing.refresh(START_NS + REFRESH_NS)
    assert sharing.parts(START_NS + REFRESH_NS) == ([0.2] * 5, [0.2] * 5)


def test_where_nothing_is_bounded_one_may_carry_all() -> None:
    """Of two contacts both paths are the same one, and each carries all of the other's."""
    sharing = ReturnShare(3, METER)
    for electrode in (0, 1):
        sharing.update(electrode, True, START_NS, exact(75e3))
    sharing.refresh(START_NS)
    assert sharing.weights(START_NS) == [1.0] * 3
    assert sharing.share(2) == 1.0
    likely, most = sharing.parts(START_NS)
    assert likely == [0.5] * 3
    assert min(most) == pytest.approx(0.5)


def test_where_the_converter_tells_nothing_all_are_alike() -> None:
    """Between nothing and a step of it, which is less than any contact resists."""
    sharing = ReturnShare(16, METER)
    for electrode in range(16):
        unread = changed(exact(80.0, 2_000.0), least_ohm=0.0)
        sharing.update(electrode, True, START_NS, unread)
    sharing.refresh(START_NS)
    likely, most = sharing.parts(START_NS)
    assert likely == pytest.approx([1 / 16] * 16)
    assert max(most) < 1.01 / 16


def test_a_path_that_takes_no_current_for_certain_has_no_part() -> None:
    """The leak takes all of it."""
    sharing = seen(*[EVEN] * 8)
    none = changed(exact(1e7), least_ohm=math.inf, most_ohm=math.inf)
    sharing.update(7, True, START_NS + REFRESH_NS, none)
    sharing.refresh(START_NS + REFRESH_NS)
    likely, most = sharing.parts(START_NS + REFRESH_NS)
    assert max(likely[7], most[7]) < 1e-3
    assert likely[:7] == pytest.approx([1 / 7] * 7, rel=0.02)


def test_where_nothing_touches_all_are_alike() -> None:
    sharing = seen(None, None)
    assert sharing.parts(START_NS) == ([0.5] * 2, [0.5] * 2)


def test_one_that_is_known_again_by_its_last_reading_counts_within_milliseconds() -> None:
    sharing = seen(*[EVEN] * 8)
    sharing.update(7, False, START_NS + 10_000_000)
    assert sharing.refresh(START_NS + 11_000_000)
    sharing.update(0, True, START_NS + 20_000_000)
    assert not sharing.refresh(START_NS + 21_000_000)
    assert sharing.refresh(START_NS + 25_000_000)


def test_a_path_that_resists_a_tenth_less_is_taken_over_within_milliseconds() -> None:
    """Though it may be the same one: no path differs from it for certain."""
    sharing, (path_ohm, *_) = ReturnShare(8, METER), paths_ohm([EVEN] * 8)
    for electrode in range(8):
        sharing.update(electrode, True, START_NS, vague(path_ohm, 1.4))
    sharing.refresh(START_NS)
    now_ns = START_NS + 50_000_000
    assert sharing.update(0, True, now_ns, vague(0.91 * path_ohm, 1.4))
    assert not sharing.refresh(now_ns + 5_000_000)
    assert not sharing.update(0, True, now_ns, vague(0.89 * path_ohm, 1.4))
    assert sharing.refresh(now_ns + 5_000_000)
    # From there on it is the same one.
    assert sharing.update(0, True, now_ns + 6_000_000, vague(0.89 * path_ohm, 1.4))
    assert not sharing.refresh(now_ns + 12_000_000)


def vague(path_ohm: float, times: float) -> Reading:
    """Of a path that resists so much, or as many times more or less."""
    return changed(exact(path_ohm), least_ohm=path_ohm / times, most_ohm=path_ohm * times)


# --- looks ----------------------------------------------------------------------------------------


def test_looks_are_wanted_from_when_they_are_asked_for_until_all_is_forgotten() -> None:
    sharing = seen(EVEN, EVEN)
    assert not sharing.is_wanted
    sharing.want()
    assert sharing.is_wanted
    sharing.reset()
    assert not sharing.is_wanted


def test_the_next_look_is_due_half_a_second_after_the_last() -> None:
    sharing = ReturnShare(2, METER)
    assert sharing.is_due(1, 0)
    sharing.update(1, True, MAX_AGE_NS, exact(1e5))
    assert sharing.looked_ns(1) == MAX_AGE_NS
    assert sharing.looked_ns(0) == 0
    assert not sharing.is_due(1, MAX_AGE_NS + CONTACT_POLL_NS - 1)
    assert sharing.is_due(1, MAX_AGE_NS + CONTACT_POLL_NS)


def test_nothing_is_kept_of_paths_from_before_and_after_a_change() -> None:
    """One of 50 k becomes one of 3.5 k, and a path through it is read before its own."""
    changed = [load(6e3), load(3.5e3), *[EVEN] * 6]
    sharing, paths = seen(changed[0], *[EVEN] * 7), paths_ohm(changed)
    for step, electrodes in enumerate(([0], [1], range(8))):
        now_ns = START_NS + (1 + step) * REFRESH_NS
        for electrode in electrodes:
            sharing.update(electrode, True, now_ns, exact(paths[electrode]))
        sharing.refresh(now_ns)
    for electrode, contact in enumerate(changed):
        assert sharing.most_s[electrode] >= contact.conductance_s * 0.999
