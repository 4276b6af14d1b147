"""When what a person lets rise does rise: with the word, or once there is room for it."""

from __future__ import annotations

import pytest

from etd.stabilize.said import ANSWERED_LOWERED_BY, RISE_A_MINUTE, FeltOffsets

S = 1_000_000_000


def test_a_rise_comes_with_the_word_and_the_next_one_a_minute_after_it() -> None:
    offsets, reached = FeltOffsets(1, may_raise=True), []
    for second in range(120):
        offsets.fired(0, second * S)
        if second in (30, 89):
            offsets.hear("too_weak", None, second * S)
        reached.append(offsets.factors()[0])
    assert reached[29:31] == [1.0, pytest.approx(RISE_A_MINUTE)]
    assert reached[89] == reached[30]
    assert reached[90:120] == [pytest.approx(RISE_A_MINUTE**2)] * 30


def test_many_words_at_once_raise_now_and_once_more_after_a_minute() -> None:
    """The first has the room of this minute, the last that of the next, and no other has any."""
    offsets = FeltOffsets(1, may_raise=True)
    offsets.fired(0, 0)
    for _ in range(5):
        offsets.hear("too_weak", None, 0)
    for second in range(600):
        offsets.fired(0, second * S)
    assert offsets.factors()[0] == pytest.approx(RISE_A_MINUTE**2)


def test_what_a_word_had_no_room_for_comes_when_the_minute_is_over() -> None:
    """As far as one word goes: the answer before it came half a minute ago, none comes after it."""
    offsets, reached = FeltOffsets(1, may_raise=True), []
    for second in range(360):
        offsets.fired(0, second * S)
        if second in (30, 60):
            offsets.hear("too_weak", None, second * S)
        reached.append(offsets.factors()[0])
    assert reached[30] == reached[89] == pytest.approx(RISE_A_MINUTE)
    assert reached[90] == reached[359] == pytest.approx(RISE_A_MINUTE**2)


def test_good_at_once_after_too_strong_gives_it_back_a_minute_later() -> None:
    offsets = FeltOffsets(1, may_raise=False)
    offsets.fired(0, 0)
    offsets.hear("too_strong", None, 0)
    offsets.hear("good", None, 1)
    offsets.fired(0, 59 * S)
    assert offsets.factors()[0] == pytest.approx(1.0 - ANSWERED_LOWERED_BY)
    offsets.fired(0, 61 * S)
    assert offsets.factors()[0] == pytest.approx(1.0)


def test_a_program_that_repeats_a_word_says_it_once_in_half_a_minute() -> None:
    """A person whose answer is repeated has not judged anew: *good* afterwards takes it back."""
    left = []
    for times in (1, 1_000):
        offsets = FeltOffsets(1, may_raise=True)
        offsets.fired(0, 0)
        for number in range(times):
            offsets.hear("too_weak", None, number)
        for second in (40, 75, 110):
            offsets.fired(0, second * S)
            offsets.hear("good", None, second * S)
        left.append(offsets.factors()[0])
    assert left[0] == pytest.approx(left[1], abs=1e-6)
    assert left[0] < RISE_A_MINUTE


def test_it_is_known_how_long_a_rise_has_to_wait() -> None:
    offsets = FeltOffsets(2, may_raise=False)
    for electrode in range(2):
        offsets.fired(electrode, 0)
    offsets.hear("too_strong", (0,), 0)
    assert offsets.waits_ns(None, 0) is None, "nothing is to rise"
    offsets.hear("good", None, 20 * S)
    assert offsets.waits_ns(None, 20 * S) == 40 * S
    assert offsets.waits_ns((1,), 20 * S) is None
    offsets.fired(0, 61 * S)
    assert offsets.waits_ns(None, 61 * S) is None, "it has risen"
