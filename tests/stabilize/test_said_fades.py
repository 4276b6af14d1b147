"""Of whom it was measured how fast use is felt less: *good* makes up for what is lost meanwhile."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.stabilize.offset_estimate import BAND, Answer
from etd.stabilize.said import FeltOffsets
from etd.stabilize.said_electrode import MOST, RISE_A_MINUTE, fades_a_minute

S = 1_000_000_000


class Used:
    """Electrodes in use once a second, and how fast that is felt less."""

    def __init__(self, fades: float, *, may_raise: bool = True, electrodes: int = 1) -> None:
        self.offsets = FeltOffsets(electrodes, may_raise=may_raise, fades_a_minute=fades)
        self.now_ns = 0
        self.offsets.fired(0, 0)

    def use(self, seconds: int, each: int = 1) -> None:
        for _ in range(0, seconds, each):
            self.now_ns += each * S
            self.offsets.fired(0, self.now_ns)

    def say(self, answer: Answer) -> str:
        return self.offsets.hear(answer, None, self.now_ns)

    def each_minute(self, *answers: Answer) -> float:
        for answer in answers:
            self.use(60)
            self.say(answer)
        return self.factor

    @property
    def factor(self) -> float:
        return self.offsets.factor(0, self.now_ns)

    def makes_up_for(self, minutes: float, fades: float = 0.03) -> bool:
        """For all of it or a little less: it was called good after that had been lost."""
        lost = fades * minutes
        return 0.75 * lost <= math.log(self.factor) <= lost + 1e-9


def test_good_after_a_minute_makes_up_for_that_minute() -> None:
    used = Used(0.03)
    used.use(60)
    assert used.say("good") == "raises"
    assert used.makes_up_for(1)
    risen = used.factor
    used.use(600)
    assert used.factor == risen, "nothing rises without a word"


def test_good_once_a_minute_holds_what_is_felt() -> None:
    used = Used(0.03)
    for minute in range(1, 6):
        used.each_minute("good")
        assert used.makes_up_for(minute)


def test_good_after_many_minutes_makes_up_for_one_since_it_is_good_now() -> None:
    used = Used(0.03)
    used.use(600)
    used.say("good")
    assert used.makes_up_for(1)


def test_good_said_all_the_time_makes_up_for_no_more_than_time_has_taken() -> None:
    used = Used(0.03)
    for second in range(1, 300):
        used.use(1)
        used.say("good")
        assert math.log(used.factor) <= 0.03 * second / 60 + 1e-9
    assert used.makes_up_for(5)


def test_nothing_is_made_up_for_where_it_was_not_measured_or_may_not_be() -> None:
    for used in (Used(0.0), Used(0.03, may_raise=False)):
        used.use(60)
        assert used.say("good") == "nothing"
        assert used.factor == 1.0


def test_five_percent_a_minute_and_a_fifth_in_all_are_the_most_however_fast_it_fades() -> None:
    used = Used(5.0)
    for minute in range(1, 10):
        used.each_minute("good")
        assert used.factor <= min(RISE_A_MINUTE**minute, MOST) + 1e-9
        if minute < 3:
            assert used.factor == pytest.approx(RISE_A_MINUTE**minute)


def test_pulses_that_come_now_and_then_are_no_use() -> None:
    """It was measured with one a second."""
    used = Used(0.03)
    used.use(600, each=3)
    assert used.say("good") == "nothing"
    assert used.factor == 1.0
    used.use(60, each=2)
    assert used.say("good") == "raises"


def test_two_seconds_apart_are_use_and_not_a_nanosecond_more() -> None:
    for more, did in ((0, "raises"), (1, "nothing")):
        used = Used(0.03)
        for _ in range(30):
            used.now_ns += 2 * S + more
            used.offsets.fired(0, used.now_ns)
        assert used.say("good") == did


def test_a_pulse_a_minute_after_the_last_one_is_of_the_same_use() -> None:
    used = Used(0.03)
    used.use(60)
    used.now_ns += 60 * S
    used.offsets.fired(0, used.now_ns)
    used.say("good")
    assert used.makes_up_for(1)


def test_what_too_weak_has_raised_is_beyond_what_was_lost() -> None:
    used = Used(0.03)
    used.use(1)
    used.say("too_weak")
    risen = used.factor
    assert used.each_minute("good") <= risen


def test_good_makes_up_for_a_minute_once() -> None:
    used = Used(0.03)
    used.use(600)
    used.say("good")
    risen = used.factor
    used.use(10)
    used.say("good")
    assert used.factor <= risen * math.exp(0.03 / 6.0) + 1e-9


def test_of_a_deep_fall_no_more_comes_back_by_what_was_measured() -> None:
    """Also where *too weak* was said of it."""

    def left(fades: float) -> float:
        used = Used(fades)
        used.use(300)
        for _ in range(3):
            used.say("too_strong")
        return used.each_minute("too_weak", *("good",) * 12)

    assert left(0.04) <= left(0.0) + 1e-9
    assert left(0.0) < 0.8


@pytest.mark.parametrize("by_button", [True, False])
def test_after_too_strong_good_gives_back_what_it_took_and_no_more(*, by_button: bool) -> None:
    """However often it is said, and however long the use had lasted."""
    used = Used(0.05)
    used.use(600)
    if by_button:
        used.offsets.lower(None, used.now_ns)
    else:
        used.say("too_strong")
    assert used.factor < 1.0
    used.use(60)
    for _ in range(12):
        assert used.each_minute("good") <= 1.0 + 1e-9
    assert used.factor == pytest.approx(1.0)


def test_after_too_strong_of_a_rise_good_adds_nothing_to_what_that_left() -> None:
    used = Used(0.05)
    used.each_minute("good", "good", "good")
    left = used.each_minute("too_strong")
    assert left > 1.0
    assert used.each_minute("good") > 1.0 + 0.5 * (left - 1.0), "nor takes it all"
    for _ in range(10):
        assert used.each_minute("good") <= left + 1e-9


def test_too_weak_lets_good_make_up_for_use_again() -> None:
    used = Used(0.05)
    used.each_minute("good", "too_strong")
    risen = used.each_minute("too_weak", "too_weak")
    assert used.each_minute("good") > risen


@given(
    st.lists(st.sampled_from(["good", "too_weak", "too_strong"]), max_size=12),
    st.floats(0.0, 1.0),
    st.integers(1, 12),
)
def test_whatever_was_said_before_nothing_is_good_above_what_was_too_strong(
    words: list[Answer], fades: float, times: int
) -> None:
    used = Used(fades)
    used.each_minute(*words)
    too_strong = used.factor
    used.use(60)
    used.say("too_strong")
    for _ in range(times):
        assert used.each_minute("good") <= max(too_strong, 1.0) + 1e-9


@pytest.mark.parametrize("about", [None, (0,)])
def test_a_minute_without_a_pulse_lets_touch_recover_and_it_begins_anew(
    about: tuple[int, ...] | None,
) -> None:
    used = Used(0.03)
    used.use(240)
    used.offsets.hear("good", about, used.now_ns)
    assert used.factor > 1.0
    used.now_ns += 61 * S
    used.offsets.fired(0, used.now_ns)
    assert used.factor == 1.0
    used.use(30)
    used.offsets.hear("good", about, used.now_ns)
    # It was good after four minutes without any more, which speaks against what is expected.
    assert used.factor == 1.0


def test_what_was_measured_changes_nothing_where_nothing_may_rise() -> None:
    """Nor what comes back of a deep fall, by the estimate."""

    def left(fades: float) -> float:
        used = Used(fades, may_raise=False)
        used.each_minute("good", "good", "good", "too_strong", "too_strong", "too_strong")
        used.say("too_strong")
        return used.each_minute("good", "good", "too_weak")

    assert left(0.04) == left(0.0) == pytest.approx(0.658, abs=0.001)


def test_a_minute_without_a_pulse_begins_anew_also_before_anything_was_said() -> None:
    used = Used(0.03)
    used.use(240)
    used.now_ns += 60 * S
    used.use(31)
    used.say("good")
    assert used.makes_up_for(0.5)


def test_what_was_not_in_use_is_not_made_up_for() -> None:
    """Each electrode has its own time in use."""
    used = Used(0.03, electrodes=2)
    used.use(60)
    used.offsets.fired(1, used.now_ns)
    used.say("good")
    first, second = used.offsets.factors()
    assert math.log(first) > 0.02
    assert second == 1.0


def test_a_word_about_one_electrode_is_beside_what_is_expected_too() -> None:
    used = Used(0.03)
    used.use(60)
    assert used.offsets.hear("good", (0,), used.now_ns) == "raises"
    assert used.makes_up_for(1)


@given(st.lists(st.sampled_from(["too_weak", "good", "too_strong"]), max_size=20), st.floats(0, 1))
def test_good_raises_by_no_more_than_use_is_measured_to_take(
    words: list[Answer], fades: float
) -> None:
    used = Used(fades)
    for word in words:
        used.use(60)
        before = used.factor
        used.say(word)
        most = min(math.exp(fades), RISE_A_MINUTE) if word != "too_weak" else RISE_A_MINUTE
        # *Good* may give back as well, up to the frame's own.
        assert used.factor <= min(MOST, max(before * most, 1.0)) + 1e-9


@pytest.mark.parametrize(("from_s", "rate"), [(600.0, BAND / 20.0), (300.0, BAND / 10.0)])
def test_who_says_weaker_is_taken_to_have_lost_half_of_what_is_good_anyway(
    from_s: float, rate: float
) -> None:
    assert fades_a_minute(from_s) == pytest.approx(rate)


@given(st.floats(1e-6, 1e6))
def test_no_measurement_lets_more_rise_than_the_limits_do(from_s: float) -> None:
    assert 0.0 < fades_a_minute(from_s) <= math.log(RISE_A_MINUTE)
