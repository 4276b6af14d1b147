"""Where each rule of what the person says begins and ends, to the nanosecond."""

from __future__ import annotations

import math
from typing import get_args

import pytest

from etd.stabilize import said_electrode
from etd.stabilize.offset_estimate import Answer, OffsetEstimate
from etd.stabilize.said import FeltOffsets, Followed
from etd.stabilize.said_electrode import AGAIN_TIMES, ANSWERED_LOWERED_BY, LOWERED_BY, RISE_A_MINUTE

S = 1_000_000_000
#: Far from the zero of any clock.
NOW_NS = 7_000 * S
RISE_LOG = math.log(RISE_A_MINUTE)


class Array:
    """Some electrodes that are fired when a test says so. Times are in seconds from `NOW_NS`."""

    def __init__(self, electrodes: int = 2, *, may_raise: bool = True) -> None:
        self.offsets = FeltOffsets(electrodes, may_raise=may_raise)
        self._electrodes = range(electrodes)

    def fire(self, *at_s: float, only: int | None = None) -> None:
        for second in at_s:
            for electrode in self._electrodes if only is None else (only,):
                self.offsets.fired(electrode, NOW_NS + int(second * S))

    def fire_until(self, end_s: int, every_s: int = 30) -> None:
        self.fire(*range(0, end_s + 1, every_s))

    def say(self, answer: Answer, at_s: float, *about: int) -> Followed:
        return self.offsets.hear(answer, about or None, NOW_NS + int(at_s * S))

    def button(self, at_s: float, *about: int) -> None:
        self.offsets.lower(about or None, NOW_NS + int(at_s * S))

    def factor(self, electrode: int, at_s: float) -> float:
        return self.offsets.factor(electrode, NOW_NS + int(at_s * S))

    def waits_s(self, at_s: float, *about: int) -> float | None:
        waits_ns = self.offsets.waits_ns(about or None, NOW_NS + int(at_s * S))
        return None if waits_ns is None else waits_ns / S


def test_durations_and_what_is_told_are_those_of_the_page() -> None:
    assert (said_electrode.FELT_NS, said_electrode.MINUTE_NS) == (60 * S, 60 * S)
    durations = said_electrode.AT_ONCE_NS, said_electrode.LETS_RISE_NS, said_electrode.AGAIN_NS
    assert durations == (30 * S, 90 * S, 180 * S)
    assert get_args(Followed) == ("lowered", "gives_back", "raises", "nothing")


# --- insisting ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("again_s", "takes"),
    [
        (30.0, 0.2),
        (30.000_000_001, AGAIN_TIMES * LOWERED_BY),
        (180.0, AGAIN_TIMES * LOWERED_BY),
        (180.000_000_001, LOWERED_BY),
    ],
)
def test_how_long_the_same_word_again_takes_more(again_s: float, takes: float) -> None:
    array = Array()
    array.say("too_strong", 0, 0)
    array.say("too_strong", again_s, 0)
    left = (1.0 - LOWERED_BY) * (1.0 - takes)
    assert array.offsets.left(0) == pytest.approx(left, rel=1e-9)


def test_a_word_about_one_electrode_does_not_end_insisting_about_all() -> None:
    array = Array()
    array.say("too_strong", 0)
    array.fire(40)
    array.say("good", 40, 0)
    array.say("too_strong", 80)
    left = (1.0 - ANSWERED_LOWERED_BY) * (1.0 - AGAIN_TIMES * ANSWERED_LOWERED_BY)
    assert array.offsets.left(1) == pytest.approx(left, rel=1e-9)


# --- what a pulse has -----------------------------------------------------------------------------


def test_before_anything_is_said_nothing_is_taken_or_given() -> None:
    array = Array()
    assert array.factor(0, 0) == array.offsets.left(0) == 1.0
    array.fire(0)
    assert array.factor(0, 0) == array.offsets.left(0) == 1.0


def test_a_button_lowers_what_nobody_has_said_anything_of() -> None:
    array = Array()
    array.button(0)
    assert array.factor(0, 0) == array.offsets.left(0) == pytest.approx(1.0 - LOWERED_BY)
    # What was lowered stays so without a pulse.
    assert array.factor(0, 3_600) == pytest.approx(1.0 - LOWERED_BY)


def test_a_rise_is_of_what_was_fired_within_a_minute_and_no_limit_is_raised() -> None:
    array = Array()
    array.fire(0)
    array.say("too_weak", 0)
    assert array.factor(0, 60) == pytest.approx(RISE_A_MINUTE)
    assert array.factor(0, 60.000_000_001) == 1.0
    assert array.offsets.left(0) == 1.0


def test_what_was_felt_is_what_was_fired_within_a_minute() -> None:
    array = Array(3)
    array.fire(0, only=1)
    array.fire(1, only=2)
    at_ns = NOW_NS + 60 * S
    assert array.offsets.felt(at_ns) == (1, 2)
    assert array.offsets.felt(at_ns + 1) == (2,)
    assert [array.offsets.was_felt(electrode, at_ns) for electrode in range(3)] == [
        *(False, True, True)
    ]


# --- rises ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("pulse_s", "rises"), [(89.9, True), (91.0, False), (95.0, False)])
def test_a_word_lets_rise_for_a_minute_and_a_half(pulse_s: float, *, rises: bool) -> None:
    array = Array(may_raise=False)
    array.fire(0)
    array.say("too_strong", 0, 0)
    array.say("good", 1, 0)
    array.fire(59, pulse_s)
    assert array.factor(0, pulse_s) == pytest.approx(1.0 if rises else 1.0 - LOWERED_BY, abs=0.003)


def test_what_a_word_still_lets_rise_is_lost_with_too_strong() -> None:
    """Of a button at 2 s; the word before it would let rise until 91 s."""
    array = Array(may_raise=False)
    array.fire(0)
    array.say("too_strong", 0, 0)
    array.say("good", 1, 0)
    array.button(2, 1)
    array.button(2, 0)
    left = array.offsets.left(0)
    array.fire(30, 62.5, 80)
    assert array.factor(0, 80) == left < 1.0 - LOWERED_BY


def test_how_long_the_next_rise_has_to_wait() -> None:
    array = Array(may_raise=False)
    array.fire(0)
    array.say("too_strong", 0, 0)
    array.say("too_strong", 20, 1)
    assert array.waits_s(20) is None, "nothing has been said that lets rise"
    array.say("good", 25)
    assert array.waits_s(25) == 35.0
    assert array.waits_s(25, 1) == 55.0
    array.fire(30, 59, 61)
    assert array.waits_s(62, 0) is None, "it has risen by all that it may"
    assert array.waits_s(62, 1) == 18.0


def test_what_has_risen_at_once_is_not_said_to_wait_for_the_rest() -> None:
    """2 % come back at 70 s, which leaves room for 3 % at 75 s and for the rest at 130 s."""
    array = Array()
    array.fire(0)
    array.say("too_strong", 0)
    array.fire(50, 70)
    array.say("good", 70)
    array.say("too_weak", 75, 0)
    came_back = -math.log(1.0 - ANSWERED_LOWERED_BY)
    assert math.log(array.factor(0, 75)) == pytest.approx(RISE_LOG - came_back)
    assert array.waits_s(75) is None
    assert array.waits_s(76) == 54.0


# --- what is told ---------------------------------------------------------------------------------


def test_of_one_that_comes_back_and_one_that_rises_it_is_told_that_some_are_raised() -> None:
    array = Array()
    array.say("too_strong", 0, 0)
    array.say("too_strong", 200, 0)
    array.fire(260)
    assert array.say("too_weak", 261) == "raises"
    assert array.factor(0, 261) < 1.0 < array.factor(1, 261)


def test_what_only_comes_back_is_not_told_as_raised() -> None:
    array = Array()
    array.say("too_strong", 0, 0)
    array.say("too_strong", 200, 0)
    array.fire(260)
    assert array.say("too_weak", 261, 0) == "gives_back"


def test_a_button_before_the_first_pulse_is_about_the_frames_own_strength() -> None:
    array = Array()
    array.button(0)
    array.button(200)
    array.fire(260)
    assert array.say("too_weak", 261) == "gives_back"


def test_good_that_takes_a_rise_from_one_of_two_is_told_as_lowering() -> None:
    array = Array()
    array.fire(0)
    array.say("too_weak", 0, 0)
    array.fire_until(720)
    assert array.say("good", 720) == "lowered"
    assert 1.0 < array.factor(0, 720) < RISE_A_MINUTE
    assert array.factor(1, 720) == 1.0


# --- the estimates --------------------------------------------------------------------------------


def test_what_is_said_of_one_electrode_raises_that_one() -> None:
    array = Array()
    array.fire(0)
    assert array.say("too_weak", 0, 1) == "raises"
    assert array.factor(0, 0) == 1.0
    assert array.factor(1, 0) == pytest.approx(RISE_A_MINUTE)


def test_two_electrodes_of_which_the_same_is_said_within_seconds_are_two_answers() -> None:
    array = Array()
    array.fire(0)
    array.say("too_weak", 0, 0)
    array.say("too_weak", 1, 1)
    assert array.factor(1, 1) == pytest.approx(RISE_A_MINUTE)


def test_another_word_within_seconds_is_another_answer() -> None:
    array = Array()
    array.fire(0)
    assert array.say("good", 0) == "nothing"
    assert array.say("too_weak", 10) == "raises"


@pytest.mark.parametrize(("again_s", "counts"), [(59.999_999_999, False), (60.0, True)])
def test_the_same_word_counts_again_after_half_a_minute(again_s: float, *, counts: bool) -> None:
    """*Good* at a strength speaks for it, each time a little more."""
    array, own = Array(), OffsetEstimate()
    array.fire(0, 59)
    for at_s in (0.0, 30.0, again_s):
        array.say("good", at_s, 0)
        if at_s != again_s or counts:
            own.hear("good", 0.0, NOW_NS + int(at_s * S))
    array.say("too_weak", 61, 0)
    own.hear("too_weak", 0.0, NOW_NS + 61 * S)
    expected = own.mean(NOW_NS + 61 * S)
    assert 0.0 < expected < RISE_LOG, "what rises at once is what is expected"
    assert math.log(array.factor(0, 61)) == pytest.approx(expected, rel=1e-9)


def test_what_is_said_of_all_is_about_their_mean() -> None:
    """One of two is raised already: *good* is said of half of that."""
    array, own, common = Array(), OffsetEstimate(), OffsetEstimate()
    array.fire(0)
    array.say("too_weak", 0, 0)
    own.hear("too_weak", 0.0, NOW_NS)
    array.fire_until(60)
    at_ns = NOW_NS + 60 * S
    array.say("too_weak", 60)
    common.hear("too_weak", (RISE_LOG - own.mean(at_ns)) / 2.0, at_ns)
    expected = common.mean(at_ns)
    assert math.log(array.factor(1, 60)) == pytest.approx(min(expected, RISE_LOG), rel=1e-9)
    array.fire(90, 120)
    at_ns = NOW_NS + 120 * S
    offsets = [math.log(array.factor(electrode, 120)) for electrode in (0, 1)]
    array.say("good", 120)
    common.hear("good", (sum(offsets) - own.mean(at_ns)) / 2.0, at_ns)
    expected = min(common.mean(at_ns), offsets[1])
    assert expected < offsets[1]
    assert math.log(array.factor(1, 120)) == pytest.approx(expected, rel=1e-9)


def test_what_is_said_of_one_is_about_what_it_has_beside_all() -> None:
    """Twelve minutes later little is left of what all had said; *good* of one speaks for the rise
    that it has beside that.
    """
    array, own, common = Array(), OffsetEstimate(), OffsetEstimate()
    array.fire(0)
    array.say("too_weak", 0)
    common.hear("too_weak", 0.0, NOW_NS)
    array.fire_until(720)
    at_ns = NOW_NS + 720 * S
    array.say("good", 720, 1)
    own.hear("good", RISE_LOG - common.mean(at_ns), at_ns)
    expected = common.mean(at_ns) + own.mean(at_ns)
    assert expected < RISE_LOG
    assert math.log(array.factor(1, 720)) == pytest.approx(expected, rel=1e-9)
    assert array.factor(0, 720) == pytest.approx(RISE_A_MINUTE)


def test_good_keeps_a_part_of_what_too_weak_has_raised() -> None:
    array = Array()
    array.fire(0)
    array.say("too_weak", 0)
    array.fire_until(60)
    array.say("too_weak", 60)
    array.fire(90, 120)
    array.say("good", 120)
    assert array.factor(0, 120) > RISE_A_MINUTE


def test_what_one_word_cannot_bring_above_the_frames_own_gives_back() -> None:
    """Whatever the estimate says after three of them, who has lost a fifth gets it back first."""
    array = Array()
    array.fire(0)
    array.say("too_weak", 0, 0)
    array.say("too_strong", 3, 0)
    array.say("too_weak", 6, 0)
    array.say("too_strong", 9, 0)
    assert array.say("too_weak", 12, 0) == "gives_back"
    assert array.factor(0, 12) < 1.0 / RISE_A_MINUTE


def test_good_of_a_small_fall_that_is_not_expected_gives_back_the_frames_own() -> None:
    """And no more, though *too weak* was said before."""
    array = Array()
    array.fire(0)
    array.say("too_weak", 0)
    array.fire(30, 61)
    array.say("too_strong", 61)
    array.fire(90, 122)
    array.say("too_strong", 122)
    assert array.factor(0, 122) < 1.0
    array.fire(150, 190)
    array.say("good", 190)
    array.fire(*range(190, 280, 10))
    assert array.factor(0, 280) == 1.0


def test_what_is_said_of_all_where_nothing_was_fired_is_about_the_frames_own() -> None:
    """As where all were fired at it."""
    left = []
    for was_fired in (False, True):
        array = Array()
        if was_fired:
            array.fire(0)
        array.say("too_strong", 0)
        for at_s in (61, 92, 123):
            array.fire(at_s)
            array.say("too_weak", at_s)
        array.fire(*range(123, 213, 10))
        left.append(array.factor(0, 212))
    assert left[0] == left[1] > 1.0
