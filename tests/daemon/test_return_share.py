"""Who shares a current: those that told so within a second."""

from __future__ import annotations

import pytest

from etd.safety.return_share import ReturnShare
from etd.stabilize.max_age import CONTACT_POLL_NS, MAX_AGE_NS


def seen(*touches: bool, at_ns: int = 0) -> ReturnShare:
    """Electrodes that each had a probe pulse."""
    sharing = ReturnShare(len(touches))
    for electrode, does in enumerate(touches):
        sharing.update(electrode, does, at_ns)
    return sharing


def test_where_nothing_is_known_one_return_may_carry_it_all() -> None:
    assert ReturnShare(4).largest(0, 0) == 1.0


def test_those_that_touch_share_equally() -> None:
    sharing = seen(True, True, True, False)
    assert sharing.largest(0, 1) == 1 / 2
    assert sharing.largest(3, 1) == 1 / 3


def test_forgetting_is_knowing_nothing() -> None:
    sharing = seen(True, True, True)
    sharing.reset()
    assert sharing.largest(0, 1) == 1.0
    assert sharing.when_probed() == 1.0


def test_a_look_is_believed_for_a_second() -> None:
    sharing = seen(True, True, True, True)
    sharing.update(1, True, MAX_AGE_NS // 2)
    sharing.update(2, True, MAX_AGE_NS // 2)
    assert sharing.largest(0, MAX_AGE_NS - 1) == pytest.approx(1 / 3)
    assert sharing.largest(0, MAX_AGE_NS) == 1 / 2
    assert sharing.largest(0, MAX_AGE_NS + MAX_AGE_NS // 2) == 1.0


def test_what_will_be_known_once_looked_is_told_before() -> None:
    assert seen(True, True, True, False).when_probed() == 1 / 2


@pytest.mark.parametrize("is_through_chosen", [True, False])
def test_when_one_is_lost_no_look_from_before_counts(is_through_chosen: bool) -> None:
    sharing = seen(*[True] * 5)
    if is_through_chosen:
        sharing.lose(4)
    else:
        sharing.update(4, False, 1)
    assert sharing.largest(0, 2) == 1.0
    for electrode in (1, 2, 3):
        sharing.update(electrode, True, 2)
    assert sharing.largest(0, 3) == pytest.approx(1 / 3)


def test_one_that_never_touched_is_not_lost() -> None:
    sharing = seen(True, True, True, False)
    sharing.update(3, False, 1)
    sharing.lose(3)
    assert sharing.largest(0, 2) == 1 / 2


def test_looks_are_wanted_only_where_they_would_help() -> None:
    sharing = seen(True, True, True)
    sharing.want(MAX_AGE_NS - 1)
    assert not sharing.is_wanted
    sharing.want(MAX_AGE_NS)
    assert sharing.is_wanted
    sharing.reset()
    assert not sharing.is_wanted


def test_those_who_are_known_not_to_touch_need_no_look() -> None:
    sharing = seen(True, False, False)
    sharing.want(1)
    assert not sharing.is_wanted


def test_the_next_look_is_due_half_a_second_after_the_last() -> None:
    sharing = ReturnShare(2)
    assert sharing.is_due(1, 0)
    sharing.update(1, True, MAX_AGE_NS)
    assert not sharing.is_due(1, MAX_AGE_NS + CONTACT_POLL_NS - 1)
    assert sharing.is_due(1, MAX_AGE_NS + CONTACT_POLL_NS)
