"""How much *too strong* takes that is said again: of the same, at once, within minutes."""

from __future__ import annotations

import pytest

from etd.stabilize.offset_estimate import Answer
from etd.stabilize.said import FeltOffsets
from etd.stabilize.said_electrode import (
    AGAIN_NS,
    AGAIN_TIMES,
    ANSWERED_LOWERED_BY,
    AT_ONCE_NS,
    AT_ONCE_TIMES,
    HARDLY_ANYTHING,
    LOWERED_BY,
    MOST_LOWERED_BY,
)

S = 1_000_000_000


def test_each_of_eight_electrodes_said_once_is_lowered_once() -> None:
    offsets = FeltOffsets(8, may_raise=True)
    for electrode in range(8):
        offsets.fired(electrode, 0)
    for electrode in range(8):
        offsets.hear("too_strong", (electrode,), 4 * electrode * S)
    assert offsets.factors() == pytest.approx((1.0 - LOWERED_BY,) * 8)


def test_words_of_all_are_insisted_on_apart_from_words_of_one() -> None:
    offsets = FeltOffsets(2, may_raise=True)
    offsets.hear("too_strong", (0,), 0)
    offsets.hear("too_strong", None, 1 * S)
    offsets.hear("too_strong", (0,), 2 * S)
    offsets.hear("too_strong", None, 3 * S)
    common = (1.0 - ANSWERED_LOWERED_BY) * (1.0 - AT_ONCE_TIMES * LOWERED_BY)
    own = (1.0 - LOWERED_BY) * (1.0 - AT_ONCE_TIMES * LOWERED_BY)
    assert offsets.factors() == pytest.approx((common * own, common))


@pytest.mark.parametrize("about", [None, (0,)])
def test_whose_word_it_is_counts_for_a_first_one_about_all_alone(
    about: tuple[int, ...] | None,
) -> None:
    answered, pressed = FeltOffsets(1, may_raise=True), FeltOffsets(1, may_raise=True)
    firsts = (1.0 - (LOWERED_BY if about else ANSWERED_LOWERED_BY), 1.0 - LOWERED_BY)
    for second in range(4):
        answered.hear("too_strong", about, second * S)
        pressed.lower(about, second * S)
        assert (answered.factors()[0] / firsts[0]) == pytest.approx(
            pressed.factors()[0] / firsts[1]
        )


def test_one_who_presses_after_an_answer_about_all_is_relieved_at_once() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    offsets.hear("too_strong", None, 0)
    offsets.lower(None, AT_ONCE_NS)
    once, again = 1.0 - ANSWERED_LOWERED_BY, 1.0 - AT_ONCE_TIMES * LOWERED_BY
    assert offsets.factors()[0] == pytest.approx(once * again)


def test_said_again_at_once_it_takes_a_fifth_and_never_more_than_half() -> None:
    offsets, steps = FeltOffsets(1, may_raise=True), []
    for second in range(8):
        offsets.fired(0, second * S)
        before = offsets.factors()[0]
        offsets.hear("too_strong", None, second * S)
        steps.append(1.0 - offsets.factors()[0] / before)
    assert steps[0] == pytest.approx(ANSWERED_LOWERED_BY)
    assert steps[1] == pytest.approx(AT_ONCE_TIMES * LOWERED_BY)
    assert steps[2:] == pytest.approx([MOST_LOWERED_BY] * 6)


def test_it_is_the_same_word_for_minutes_and_a_first_one_after_them() -> None:
    offsets = FeltOffsets(1, may_raise=False)
    assert offsets.hear("too_strong", None, 0) == "lowered"
    offsets.hear("too_strong", None, AT_ONCE_NS + 1)
    again = (1.0 - ANSWERED_LOWERED_BY) * (1.0 - AGAIN_TIMES * ANSWERED_LOWERED_BY)
    assert offsets.factors()[0] == pytest.approx(again)
    offsets.hear("too_strong", None, AT_ONCE_NS + AGAIN_NS + 2)
    assert offsets.factors()[0] == pytest.approx(again * (1.0 - ANSWERED_LOWERED_BY))


@pytest.mark.parametrize("contrary", ["good", "too_weak"])
@pytest.mark.parametrize("about", [None, (0,)])
def test_another_answer_in_between_ends_the_minutes_of_insisting(
    contrary: Answer, about: tuple[int, ...] | None
) -> None:
    offsets = FeltOffsets(2, may_raise=False)
    offsets.hear("too_strong", about, 0)
    offsets.hear(contrary, about, AT_ONCE_NS)
    before = offsets.factors()[0]
    offsets.hear("too_strong", about, AT_ONCE_NS + 1)
    first = LOWERED_BY if about else ANSWERED_LOWERED_BY
    assert offsets.factors()[0] == pytest.approx((1.0 - first) * before)


def test_a_program_that_says_good_does_not_hold_back_who_presses() -> None:
    offsets = FeltOffsets(1, may_raise=False)
    offsets.fired(0, 0)
    offsets.lower(None, 0)
    offsets.hear("good", None, S)
    offsets.lower(None, 2 * S)
    at_once = (1.0 - LOWERED_BY) * (1.0 - AT_ONCE_TIMES * LOWERED_BY)
    assert offsets.factors()[0] == pytest.approx(at_once)


def test_of_one_electrode_it_ends_the_minutes_of_that_one_alone() -> None:
    offsets = FeltOffsets(2, may_raise=False)
    offsets.hear("too_strong", (0, 1), 0)
    offsets.hear("good", (0,), AT_ONCE_NS)
    offsets.hear("too_strong", (0, 1), AT_ONCE_NS + 1)
    once = 1.0 - LOWERED_BY
    assert offsets.factors() == pytest.approx((once**2, once * (1.0 - AGAIN_TIMES * LOWERED_BY)))


@pytest.mark.parametrize(("times", "rises"), [(5, True), (6, False)])
def test_what_has_left_hardly_anything_is_not_given_back(times: int, rises: bool) -> None:
    offsets = FeltOffsets(1, may_raise=False)
    offsets.fired(0, 0)
    for _ in range(times):
        offsets.hear("too_strong", (0,), 0)
    left = offsets.factors()[0]
    assert (left > HARDLY_ANYTHING) == rises
    for second in range(1, 200):
        offsets.fired(0, second * S)
    for minute in range(3, 20):
        for second in range(60):
            offsets.fired(0, (60 * minute + second) * S)
        did = offsets.hear("too_weak", (0,), (60 * minute + 59) * S)
        assert (did == "gives_back") == rises or did == "nothing"
    assert (offsets.factors()[0] > left) == rises
