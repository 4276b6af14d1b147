"""The words between a board and its stopper, as the driving side reads them."""

from __future__ import annotations

import pytest

from etd_hal.cutlatch import (
    ALIVE_NS,
    CAUSE,
    CUTS,
    DUE_NS,
    LOOKED_NS,
    NOTE_ERROR,
    NOTED,
    OVERDUE,
    POWER,
    SEEN,
    SILENT,
    WINDOW_NS,
    CutLatch,
)
from etd_hal.errors import BoardFault

A_MESSAGE = "because a message was overdue"
SILENCE = "because the engine was silent for longer than the heartbeat's window"


@pytest.fixture
def latch() -> CutLatch:
    return CutLatch()


def test_each_word_has_a_place_of_its_own_and_there_are_no_others(latch: CutLatch) -> None:
    """Each is written by one side alone: two in one place would be one that both sides write."""
    by_driver = [DUE_NS, SEEN, ALIVE_NS, WINDOW_NS, POWER]
    by_stopper = [CUTS, LOOKED_NS, CAUSE, NOTED, NOTE_ERROR]
    assert sorted(by_driver + by_stopper) == list(range(len(latch.words)))


def test_where_nobody_has_cut_nothing_is_refused(latch: CutLatch) -> None:
    assert not latch.is_cut
    latch.check()
    assert latch.see() == 0
    latch.check()


def test_a_cut_is_seen_and_refuses_until_it_is_over(latch: CutLatch) -> None:
    latch.words[CUTS] += 1
    latch.words[CAUSE] = OVERDUE
    for _ in range(2):
        assert latch.is_cut
        with pytest.raises(BoardFault) as caught:
            latch.check()
        assert latch.words[SEEN] == 1
        assert caught.value.what == "outputs"
        assert caught.value.measured == f"cut off by the stopper, {A_MESSAGE}"
        assert caught.value.expected == "a board that was made safe since"
    latch.ended = latch.see()
    assert not latch.is_cut
    latch.check()


def test_the_second_of_two_cuts_stands_when_the_first_is_over(latch: CutLatch) -> None:
    """It came while the board was made safe after the first."""
    latch.words[CUTS] += 1
    seen = latch.see()
    latch.words[CUTS] += 1
    latch.ended = seen
    assert (seen, latch.words[SEEN]) == (1, 1)
    with pytest.raises(BoardFault):
        latch.check()
    assert latch.words[SEEN] == 2


@pytest.mark.parametrize(
    ("cause", "why"),
    [
        (OVERDUE, A_MESSAGE),
        (SILENT, SILENCE),
        (0, "for no reason that is known"),
        (3, "for no reason that is known"),
    ],
)
def test_why_it_was_cut_is_told_as_far_as_it_is_known(
    latch: CutLatch, cause: int, why: str
) -> None:
    latch.words[CUTS] += 1
    latch.words[CAUSE] = cause
    assert latch.why == why
    with pytest.raises(BoardFault, match=why):
        latch.check()


def test_a_message_that_is_expected_is_told_to_the_stopper_until_it_is_over(
    latch: CutLatch,
) -> None:
    latch.expect(1_234)
    assert list(latch.words) == [1_234 if at == DUE_NS else 0 for at in range(len(latch.words))]
    latch.expect(0)
    assert not any(latch.words)
