"""When what a person lets rise does rise: with the word, or once there is room for it."""

from __future__ import annotations

import pytest

from etd.stabilize.offset_estimate import Answer
from etd.stabilize.said import FeltOffsets
from etd.stabilize.said_electrode import ANSWERED_LOWERED_BY, FELT_NS, RISE_A_MINUTE

S = 1_000_000_000


def reached(said_at_s: tuple[int, ...], until_s: int) -> list[float]:
    """The factor at each second, with a pulse a second, where *too weak* is said at these."""
    offsets, found = FeltOffsets(1, may_raise=True), []
    for second in range(until_s):
        offsets.fired(0, second * S)
        if second in said_at_s:
            offsets.hear("too_weak", None, second * S)
        found.append(offsets.factors()[0])
    return found


def test_a_rise_comes_with_the_word_and_the_next_one_a_minute_after_it() -> None:
    found = reached((30, 89), 120)
    assert found[29:31] == [1.0, pytest.approx(RISE_A_MINUTE)]
    assert found[89] == found[30]
    assert found[90:120] == [pytest.approx(RISE_A_MINUTE**2)] * 30


@pytest.mark.parametrize(("later_s", "left"), [(60, 1.05), (61, 1.0)])
def test_too_strong_is_taken_from_what_a_pulse_would_have_by_then(
    later_s: int, left: float
) -> None:
    """After a minute without one that is the frame's own."""
    offsets = FeltOffsets(1, may_raise=True)
    offsets.fired(0, 0)
    offsets.hear("too_weak", None, 0)
    assert offsets.factors()[0] == pytest.approx(1.05)
    offsets.hear("too_strong", None, later_s * S)
    assert offsets.factors()[0] == pytest.approx(left * (1.0 - ANSWERED_LOWERED_BY))


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
    found = reached((30, 60), 360)
    assert found[30] == found[89] == pytest.approx(RISE_A_MINUTE)
    assert found[90] == found[359] == pytest.approx(RISE_A_MINUTE**2)


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


@pytest.mark.parametrize("weak", [1, 2, 5])
def test_good_adds_nothing_to_a_rise_whatever_is_expected(weak: int) -> None:
    """Who is content with what has been raised gets that, or less."""
    offsets = FeltOffsets(1, may_raise=True)
    for number in range(weak):
        offsets.fired(0, number * 61 * S)
        assert offsets.hear("too_weak", None, number * 61 * S) == "raises"
    raised = offsets.factors()[0]
    assert raised > 1.04
    for number in range(weak, weak + 3):
        offsets.fired(0, number * 61 * S)
        assert offsets.hear("good", None, number * 61 * S) != "raises"
        assert offsets.factors()[0] <= raised
        raised = offsets.factors()[0]


def test_too_weak_of_a_small_fall_gives_it_back_and_raises_nothing_while_less_is_expected() -> None:
    """Where raising is allowed as well: two of four answers were *too strong*."""
    offsets = FeltOffsets(1, may_raise=True)
    said: tuple[tuple[int, Answer], ...] = ((0, "too_strong"), (100, "too_strong"), (200, "good"))
    for second, answer in said:
        offsets.fired(0, second * S)
        offsets.hear(answer, None, second * S)
    offsets.fired(0, 259 * S)
    assert offsets.hear("too_weak", None, 270 * S) == "gives_back"
    for second in range(270, 400, 10):
        offsets.fired(0, second * S)
    assert offsets.factors()[0] == pytest.approx(1.0)


def test_good_takes_no_more_than_what_waits_for_room() -> None:
    """A rise that the minute had no room for is not wanted any more."""
    offsets = FeltOffsets(1, may_raise=True)
    for second in (0, 30):
        offsets.fired(0, second * S)
        offsets.hear("too_weak", None, second * S)
    offsets.hear("good", None, 40 * S)
    for second in range(40, 300, 10):
        offsets.fired(0, second * S)
    assert offsets.factors()[0] <= RISE_A_MINUTE + 1e-9


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


def test_an_electrode_that_is_not_fired_any_more_is_not_waited_for() -> None:
    offsets = FeltOffsets(2, may_raise=False)
    for electrode in range(2):
        offsets.fired(electrode, 0)
    offsets.hear("too_strong", (0,), 0)
    offsets.hear("good", None, 1)
    offsets.fired(1, 200 * S)
    offsets.hear("good", None, 200 * S)
    assert offsets.waits_ns(None, 200 * S) is None


def test_the_same_word_after_too_strong_is_another_answer() -> None:
    """Once more too weak, of what *too strong* has left, is believed as a first one is."""
    offsets = FeltOffsets(1, may_raise=False)
    offsets.fired(0, 0)
    offsets.hear("too_weak", None, 0)
    for second in (1, 2):
        offsets.hear("too_strong", (0,), second * S)
    lowered = offsets.factors()[0]
    offsets.hear("too_weak", None, 3 * S)
    for second in (40, 80):
        offsets.fired(0, second * S)
    assert offsets.factors()[0] == pytest.approx(RISE_A_MINUTE * lowered)


def test_a_rise_is_lost_where_nothing_was_fired_for_more_than_a_minute() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    offsets.fired(0, 0)
    offsets.hear("too_weak", None, 0)
    assert offsets.factors()[0] > 1.0
    offsets.fired(0, FELT_NS + S)
    assert offsets.factors()[0] == 1.0


def raised_and_too_strong(minutes: int) -> tuple[FeltOffsets, float]:
    """So many words raised it; then one *too strong*, and what there was before that."""
    offsets = FeltOffsets(1, may_raise=True)
    for second in range(60 * minutes):
        offsets.fired(0, second * S)
        if second % 60 == 0:
            offsets.hear("too_weak", None, second * S)
    before = offsets.factors()[0]
    offsets.hear("too_strong", None, (60 * minutes - 1) * S)
    return offsets, before


def test_too_strong_takes_of_a_rise_once_and_of_a_named_current() -> None:
    offsets, before = raised_and_too_strong(2)
    part = 1.0 - ANSWERED_LOWERED_BY
    assert before == pytest.approx(RISE_A_MINUTE**2)
    assert offsets.factors()[0] == pytest.approx(part * before)
    assert offsets.below(0) == 1.0, "of the frame's own nothing is taken"
    assert offsets.left(0) == pytest.approx(part)


def test_below_the_frames_own_both_are_alike() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    assert (offsets.below(0), offsets.left(0)) == (1.0, 1.0)
    for second in range(62):
        offsets.fired(0, second * S)
    offsets.hear("too_strong", None, 0)
    assert offsets.below(0) == offsets.left(0) == offsets.factors()[0]
    assert offsets.below(0) == pytest.approx(1.0 - ANSWERED_LOWERED_BY)
    offsets.hear("good", None, 61 * S)
    assert offsets.below(0) == offsets.left(0) == 1.0
