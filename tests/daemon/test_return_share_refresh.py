"""When shares are found anew, and what holds of an electrode until then."""

from __future__ import annotations

import math

import pytest

from etd.pulse.measured import MAX_AGE_NS
from etd.safety.return_share import REFRESH_NS, ReturnShare
from etd_body.electrode import load
from path_readings import METER, exact, paths_ohm

START_NS = 5_000_000_000
SOON_NS = 2_000_000
PATH_OHM = paths_ohm([load(50e3)] * 8)[0]


def known(count: int, beside: int = 0) -> ReturnShare:
    """So many of 50 k, and some that were never read; all is found."""
    sharing = ReturnShare(count + beside, METER)
    for electrode in range(count):
        sharing.update(electrode, True, START_NS, exact(PATH_OHM))
    assert sharing.refresh(START_NS)
    return sharing


# --- when -----------------------------------------------------------------------------------------


def test_the_first_is_due_at_once_and_so_is_that_after_a_loss_or_a_reset() -> None:
    sharing = ReturnShare(8, METER)
    assert sharing.refresh(0)
    assert not sharing.refresh(0)
    sharing.update(7, True, 0, exact(PATH_OHM))
    sharing.lose(7)
    assert sharing.refresh(0)
    sharing.reset()
    assert sharing.least_s == [0.0] * 8
    assert sharing.refresh(0)


def test_nothing_is_found_anew_where_nothing_was_read() -> None:
    sharing = known(8)
    assert not sharing.refresh(START_NS + REFRESH_NS)


def test_a_reading_counts_a_quarter_of_a_second_after_the_last_time() -> None:
    sharing = known(8)
    sharing.update(0, True, START_NS + 1, exact(PATH_OHM))
    assert not sharing.refresh(START_NS + REFRESH_NS - 1)
    assert sharing.refresh(START_NS + REFRESH_NS)


def test_a_reading_of_a_contact_that_changed_counts_two_milliseconds_later() -> None:
    sharing, now_ns = known(8), START_NS + 1
    sharing.update(0, True, now_ns, exact(PATH_OHM * 0.9))
    assert not sharing.refresh(now_ns + SOON_NS - 1)
    assert sharing.refresh(now_ns + SOON_NS)


def test_one_that_becomes_known_is_found_two_milliseconds_later() -> None:
    sharing = known(7, beside=1)
    now_ns = START_NS + 1
    sharing.update(7, True, now_ns, exact(PATH_OHM))
    assert not sharing.refresh(now_ns + SOON_NS - 1)
    assert sharing.refresh(now_ns + SOON_NS)


def test_one_that_becomes_unknown_is_found_two_milliseconds_later() -> None:
    sharing, late_ns = known(8), START_NS + MAX_AGE_NS
    for electrode in range(7):
        sharing.update(electrode, True, late_ns - 1, exact(PATH_OHM))
    assert sharing.refresh(late_ns - 1)
    assert not sharing.refresh(late_ns)
    assert not sharing.refresh(late_ns + SOON_NS - 1)
    assert sharing.refresh(late_ns + SOON_NS)


def test_a_touch_that_was_not_read_is_no_change() -> None:
    sharing = known(7, beside=1)
    sharing.update(7, True, START_NS + 1)
    assert not sharing.refresh(START_NS + REFRESH_NS)


# --- until then -----------------------------------------------------------------------------------


def test_one_that_becomes_known_conducts_at_least_what_its_path_does() -> None:
    sharing = known(7, beside=1)
    before = [1.0 / sharing.share(electrode) for electrode in (0, 7)]
    best_ohm = 1.0 / max(one_s for one_s in sharing.most_s if one_s < math.inf)
    for _ in range(2):
        # The second time it is known.
        sharing.update(7, True, START_NS + 1, exact(PATH_OHM))
        assert sharing.least_s[7] == pytest.approx(1.0 / PATH_OHM)
        after = [1.0 / sharing.share(electrode) for electrode in (0, 7)]
        assert after == pytest.approx([before[0] + best_ohm / PATH_OHM, before[1]])


def test_one_that_is_touched_after_its_reading_has_expired_is_dropped_at_once() -> None:
    sharing = known(8)
    whole_s, least_s = sum(sharing.least_s), sharing.least_s[7]
    best_s = max(sharing.most_s)
    sharing.update(7, True, START_NS + MAX_AGE_NS)
    assert sharing.least_s[7] == 0.0
    assert sharing.share(7) == pytest.approx(best_s / (whole_s - least_s))
    assert sharing.share(0) == pytest.approx(best_s / (whole_s - 2 * least_s))


def test_after_a_loss_nothing_counts_and_nothing_bounds() -> None:
    sharing = known(8)
    sharing.lose(7)
    assert sharing.least_s == [0.0] * 8
    assert [sharing.share(electrode) for electrode in range(8)] == [1.0] * 8
    assert sharing.looked_ns(0) == 0
    sharing.update(0, True, START_NS + 1, exact(PATH_OHM))
    assert sharing.refresh(START_NS + 1)
    assert sharing.most_s[0] == math.inf


def test_what_is_lost_is_lost_once() -> None:
    sharing = known(8)
    touch = sharing.last_touch(7)
    assert touch is sharing.reading(7) is not None
    sharing.lose(7)
    assert sharing.last_touch(7) is None
    assert sharing.last_touch(6) is sharing.reading(6)
    sharing.update(0, True, START_NS + 1, exact(PATH_OHM))
    sharing.lose(7)
    assert sharing.is_known(0, START_NS + 1)


# --- what follows ---------------------------------------------------------------------------------


def with_open(*ohm: float) -> ReturnShare:
    """The last one does not touch; found twice, since it bounds the others by the last time."""
    sharing, paths = ReturnShare(len(ohm), METER), paths_ohm([load(one) for one in ohm])
    for now_ns in (START_NS, START_NS + REFRESH_NS):
        for electrode, path_ohm in enumerate(paths):
            is_touched = electrode < len(ohm) - 1
            sharing.update(electrode, is_touched, now_ns, exact(path_ohm))
        assert sharing.refresh(now_ns)
    return sharing


def test_one_that_is_open_conducts_at_most_what_its_path_without_its_way_back_does() -> None:
    sharing = with_open(50e3, 50e3, 50e3, 50e3, 50e3)
    assert sharing.most_s[4] == pytest.approx(1 / 50e3, rel=0.05)


def test_what_is_open_is_taken_off_a_way_back_at_the_most_that_it_conducts() -> None:
    sharing = with_open(50e3, 50e3, 50e3, 50e3, 100e3)
    assert sharing.least_s[0] == pytest.approx(1 / 50e3, rel=0.03)
    assert sharing.least_s[0] <= 1 / 50e3


def test_one_that_was_found_open_without_a_reading_bounds_nothing() -> None:
    sharing = known(7, beside=1)
    sharing.update(7, False, START_NS + REFRESH_NS)
    sharing.update(0, True, START_NS + REFRESH_NS, exact(PATH_OHM))
    assert sharing.refresh(START_NS + REFRESH_NS)
    assert sharing.most_s[7] == math.inf


def test_a_path_that_stays_leaves_its_bound_where_it_is() -> None:
    sharing = known(8)
    bound_s, now_ns = sharing.most_s[0], START_NS + 2 * MAX_AGE_NS
    for _ in range(3):
        sharing.update(0, True, now_ns, exact(PATH_OHM))
        assert sharing.refresh(now_ns)
        assert sharing.most_s[0] == bound_s
        now_ns += REFRESH_NS


def test_one_that_was_never_read_counts_as_the_best() -> None:
    assert known(7, beside=1).weights(START_NS)[7] == 1.0


def test_an_equal_part_is_one_of_those_that_are_known_now() -> None:
    sharing, late_ns = with_open(50e3, 50e3, 50e3, 1e7), START_NS + REFRESH_NS + MAX_AGE_NS
    sharing.update(0, True, late_ns - 1, sharing.reading(0))
    sharing.update(3, False, late_ns - 1)
    assert sharing.refresh(late_ns - 1)
    best_s = max(sharing.most_s)
    assert sharing.weights(late_ns - 1)[3] == pytest.approx(sum(sharing.least_s) / 3 / best_s)
    # Two have expired.
    assert not sharing.refresh(late_ns)
    assert sharing.weights(late_ns)[3] == pytest.approx(sharing.least_s[0] / best_s)
