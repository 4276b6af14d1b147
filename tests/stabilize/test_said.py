"""What a person says of the strength: each rule of it, whatever is said, when, and of what."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import get_args

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from etd.stabilize.offset_estimate import BAND, Answer
from etd.stabilize.said import FeltOffsets
from etd.stabilize.said_electrode import (
    AGAIN_NS,
    ANSWERED_LOWERED_BY,
    FELT_NS,
    LETS_RISE_NS,
    LOWERED_BY,
    MOST,
    RISE_A_MINUTE,
)

pytestmark = pytest.mark.slow

N = 3
S = 1_000_000_000
MINUTE = 60 * S


@dataclass(frozen=True)
class Moment:
    """So long after the one before: pulses at some electrodes, and perhaps a word."""

    after_ns: int
    fired: frozenset[int]
    answer: Answer | None
    about: tuple[int, ...] | None


electrodes = st.integers(0, N - 1)
moments = st.builds(
    Moment,
    st.one_of(st.integers(0, 20 * S), st.integers(0, 3 * MINUTE)),
    st.frozensets(electrodes),
    st.one_of(st.none(), st.sampled_from(get_args(Answer))),
    st.one_of(st.none(), st.lists(electrodes, min_size=1, max_size=N).map(tuple)),
)
stories = st.lists(moments, max_size=60)
#: How fast use is felt less, by the measurement.
fadings = st.sampled_from((0.0, 0.03, 0.5))


class Played:
    """Offsets that a story is told to, with the time."""

    def __init__(self, fades: float = 0.0, *, may_raise: bool = True) -> None:
        self.offsets = FeltOffsets(N, may_raise=may_raise, fades_a_minute=fades)
        self.now_ns = 0

    def fire(self, moment: Moment) -> None:
        self.now_ns += moment.after_ns
        for electrode in sorted(moment.fired):
            self.offsets.fired(electrode, self.now_ns)

    def say(self, moment: Moment) -> None:
        if moment.answer is not None:
            self.offsets.hear(moment.answer, moment.about, self.now_ns)


@given(stories, fadings)
def test_no_factor_is_ever_above_the_most(story: list[Moment], fades: float) -> None:
    played = Played(fades)
    for moment in story:
        played.fire(moment)
        played.say(moment)
        assert max(played.offsets.factors()) <= MOST + 1e-9


@given(stories, fadings)
def test_a_factor_rises_by_at_most_five_percent_a_minute(story: list[Moment], fades: float) -> None:
    """In any minute all its rises together, whatever it fell by in between."""
    played = Played(fades)
    rises: list[list[tuple[int, float]]] = [[] for _ in range(N)]
    for moment in story:
        for does in (played.fire, played.say):
            before = played.offsets.factors()
            does(moment)
            for each, now, was in zip(rises, played.offsets.factors(), before, strict=True):
                if now > was:
                    each.append((played.now_ns, math.log(now / was)))
        for each in rises:
            lately = [by for at_ns, by in each if played.now_ns - at_ns < MINUTE]
            assert sum(lately) <= math.log(RISE_A_MINUTE) + 1e-9


@given(stories, fadings)
def test_nothing_rises_within_a_minute_of_too_strong(story: list[Moment], fades: float) -> None:
    """By a button or by the holder of the lease, with any words after it."""
    played = Played(fades)
    for moment in story:
        played.fire(moment)
        played.say(moment)
    played.offsets.lower(None, played.now_ns)
    lowered, until_ns = played.offsets.factors(), played.now_ns + MINUTE
    for moment in story:
        played.fire(moment)
        if played.now_ns >= until_ns:
            break
        played.say(moment)
        for now, most in zip(played.offsets.factors(), lowered, strict=True):
            assert now <= most + 1e-9


@given(stories, fadings)
def test_an_electrode_that_was_not_fired_in_the_last_minute_does_not_rise(
    story: list[Moment], fades: float
) -> None:
    played, fired_ns = Played(fades), dict.fromkeys(range(N), -10 * MINUTE)
    for moment in story:
        before = played.offsets.factors()
        played.fire(moment)
        for electrode in range(N):
            if played.now_ns - fired_ns[electrode] > FELT_NS:
                assert played.offsets.factors()[electrode] <= before[electrode] + 1e-9
        fired_ns |= dict.fromkeys(moment.fired, played.now_ns)
        said = played.offsets.factors()
        played.say(moment)
        # A word is never a rise in itself.
        for now, was in zip(played.offsets.factors(), said, strict=True):
            assert now <= was + 1e-9 or moment.answer != "too_strong"


@given(stories)
def test_a_word_lets_nothing_rise_by_more_than_five_percent_or_after_its_time(
    story: list[Moment],
) -> None:
    played, said_ns, most = Played(), -10 * MINUTE, (1.0,) * N
    for moment in story:
        before = played.offsets.factors()
        played.fire(moment)
        if played.now_ns - said_ns >= LETS_RISE_NS:
            most = before
        for now, at_most in zip(played.offsets.factors(), most, strict=True):
            assert now <= at_most + 1e-9
        if moment.answer is not None:
            said_ns = played.now_ns
            most = tuple(RISE_A_MINUTE * factor for factor in played.offsets.factors())
        played.say(moment)


@given(stories, st.one_of(st.none(), st.just((1,))))
def test_too_strong_lowers_at_once_whatever_was_said_before(
    story: list[Moment], about: tuple[int, ...] | None
) -> None:
    played = Played()
    for moment in story:
        played.fire(moment)
        played.say(moment)
    before = played.offsets.factors()
    left = [played.offsets.left(electrode) for electrode in range(N)]
    played.offsets.lower(about, played.now_ns)
    lowered = range(N) if about is None else about
    for electrode in range(N):
        at_most = (1.0 - LOWERED_BY) if electrode in lowered else 1.0
        assert played.offsets.factors()[electrode] <= before[electrode] * at_most + FELT_NS * 1e-12
        # A named current is not raised, so a rise is nothing that could be taken from it.
        assert played.offsets.left(electrode) <= left[electrode] * at_most + 1e-9


@given(stories)
def test_too_weak_lowers_nothing_and_good_nothing_below_the_frames_own(
    story: list[Moment],
) -> None:
    played = Played()
    for moment in story:
        played.fire(moment)
        before = played.offsets.factors()
        played.say(moment)
        for was, now in zip(before, played.offsets.factors(), strict=True):
            if moment.answer == "too_weak":
                assert now >= was - 1e-9
            if moment.answer == "good":
                assert now >= min(was, 1.0) - 1e-9


@given(stories)
def test_who_only_says_too_strong_never_raises_anything(story: list[Moment]) -> None:
    played = Played()
    for moment in story:
        before = played.offsets.factors()
        played.fire(moment)
        if moment.answer is not None:
            played.offsets.lower(moment.about, played.now_ns)
        for was, now in zip(before, played.offsets.factors(), strict=True):
            assert now <= was + 1e-9


@given(stories)
def test_a_reset_leaves_nothing_of_what_was_said(story: list[Moment]) -> None:
    told, fresh = Played(), Played()
    for moment in story:
        told.fire(moment)
        told.say(moment)
    told.offsets.reset()
    fresh.now_ns = told.now_ns
    assert told.offsets.factors() == (1.0,) * N
    assert told.offsets.is_idle
    for moment in story:
        for played in (told, fresh):
            played.fire(moment)
            played.say(moment)
        assert told.offsets.factors() == fresh.offsets.factors()


@given(stories)
def test_a_lone_too_strong_takes_the_same_whatever_was_said_before(story: list[Moment]) -> None:
    played = Played()
    for moment in story:
        played.fire(moment)
        played.say(moment)
    played.now_ns += AGAIN_NS + 1
    count = len(played.offsets.factors())
    before = [played.offsets.factor(electrode, played.now_ns) for electrode in range(count)]
    played.offsets.hear("too_strong", None, played.now_ns)
    for was, now in zip(before, played.offsets.factors(), strict=True):
        assert now == pytest.approx((1.0 - ANSWERED_LOWERED_BY) * was)


@example([Moment(0, frozenset({0}), "too_weak", None),
          Moment(FELT_NS + 1, frozenset(), None, None)], 0)  # fmt: skip
@given(stories, electrodes)
def test_a_first_word_of_one_electrode_takes_the_same_whatever_was_said_of_others(
    story: list[Moment], about: int
) -> None:
    """By whomever: a stranger's word on another one is none on this one."""
    played = Played()
    for moment in story:
        played.fire(moment)
        if moment.about is None or about not in moment.about:
            played.say(moment)
    # Of what its next pulse would have had: a rise that no pulse has any more is lost as well.
    before = played.offsets.factor(about, played.now_ns)
    played.offsets.hear("too_strong", (about,), played.now_ns)
    assert played.offsets.factors()[about] == pytest.approx((1.0 - LOWERED_BY) * before)


@given(stories)
def test_where_raising_is_not_allowed_nothing_is_ever_above_the_frames_own(
    story: list[Moment],
) -> None:
    played = Played(may_raise=False)
    for moment in story:
        played.fire(moment)
        played.say(moment)
        assert max(played.offsets.factors()) <= 1.0


@given(stories)
def test_where_raising_is_not_allowed_too_strong_takes_the_same_all_the_same(
    story: list[Moment],
) -> None:
    """From where each is: the permission changes nothing of what lowers."""
    factors = []
    for may_raise in (False, True):
        played = Played(may_raise=may_raise)
        for moment in story:
            played.fire(moment)
            if moment.answer == "too_strong":
                played.say(moment)
        factors.append(played.offsets.factors())
    assert factors[0] == factors[1]


def test_what_was_lowered_comes_back_where_raising_is_not_allowed() -> None:
    offsets = FeltOffsets(1, may_raise=False)
    hold(offsets, "too_strong", 1)
    hold(offsets, "good", 3, 1)
    assert offsets.factors()[0] == pytest.approx(1.0)
    lowered = insisted(offsets, 3, 10 * 60)
    hold(offsets, "too_weak", 25, 14)
    assert lowered < 0.7
    assert offsets.factors()[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("may_raise", "did"), [(False, "nothing"), (True, "raises")])
def test_it_is_told_what_an_answer_did(*, may_raise: bool, did: str) -> None:
    offsets = FeltOffsets(1, may_raise=may_raise)
    offsets.fired(0, 0)
    assert offsets.hear("good", None, 0) == "nothing"
    assert offsets.hear("too_strong", None, 1) == "lowered"
    assert offsets.hear("good", None, 2) == "gives_back"
    offsets.reset()
    offsets.fired(0, 0)
    assert [offsets.hear("too_weak", None, second * S) for second in range(3)] == [did] * 3


def test_good_that_takes_from_a_rise_is_told_as_lowering() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    hold(offsets, "good", 5)
    hold(offsets, "too_weak", 1, 5)
    for second in range(6 * 60, 7 * 60):
        offsets.fired(0, second * S)
    before = offsets.factors()[0]
    assert offsets.hear("good", None, 7 * MINUTE) == "lowered"
    assert 1.0 <= offsets.factors()[0] < before


@given(stories)
def test_without_a_too_weak_nothing_is_ever_above_the_frames_own(story: list[Moment]) -> None:
    played = Played()
    for moment in story:
        played.fire(moment)
        if moment.answer != "too_weak":
            played.say(moment)
        assert max(played.offsets.factors()) <= 1.0


def test_good_of_all_raises_none_above_its_own_though_one_had_fallen_alone() -> None:
    """The mean of all, beside what is known of that one, is then estimated above the frame's."""
    played = Played()
    every = frozenset(range(N))
    for moment in (
        Moment(0, every, "too_strong", (0,)),
        Moment(0, every, "good", None),
        *[Moment(40 * S, every, "good", None)] * 3,
        Moment(40 * S, every, None, None),
    ):
        played.fire(moment)
        played.say(moment)
    assert played.offsets.factors() == pytest.approx((1.0,) * N)
    assert max(played.offsets.factors()) <= 1.0


def test_said_three_times_within_seconds_three_fifths_are_gone() -> None:
    assert insisted(FeltOffsets(1, may_raise=True), 3) == pytest.approx(0.392, abs=0.001)


def test_said_five_times_in_minutes_half_is_gone() -> None:
    offsets = FeltOffsets(1, may_raise=False)
    hold(offsets, "too_strong", 5)
    assert offsets.factors()[0] == pytest.approx(0.494, abs=0.001)


def test_however_often_it_is_said_there_is_an_answer() -> None:
    """It comes down to a floor of which nothing is fired, and that is no 0 to divide by."""
    assert 0.0 < insisted(FeltOffsets(1, may_raise=True), 2_000) < 2e-6


def insisted(offsets: FeltOffsets, times: int, from_second: int = 0) -> float:
    """What is left when it was said so often, each second."""
    for second in range(from_second, from_second + times):
        offsets.fired(0, second * S)
        offsets.hear("too_strong", None, second * S)
    return offsets.factors()[0]


def hold(offsets: FeltOffsets, answer: Answer, minutes: int, from_minute: int = 0) -> None:
    """The same word each minute, and a pulse a second in between."""
    for second in range(from_minute * 60, (from_minute + minutes) * 60):
        offsets.fired(0, second * S)
        if second % 60 == 59:
            offsets.hear(answer, None, second * S)


def test_too_weak_again_and_again_comes_to_the_most_after_minutes() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    hold(offsets, "too_weak", 3)
    assert offsets.factors()[0] == pytest.approx(RISE_A_MINUTE**3)
    hold(offsets, "too_weak", 10, 3)
    assert offsets.factors()[0] == pytest.approx(MOST)


def test_good_leaves_what_is_good() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    hold(offsets, "good", 10)
    assert offsets.factors()[0] == pytest.approx(1.0, abs=0.01)


def test_one_too_strong_among_many_good_is_taken_back_by_the_next_good() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    hold(offsets, "good", 5)
    hold(offsets, "too_strong", 1, 5)
    assert offsets.factors()[0] == pytest.approx(1.0 - ANSWERED_LOWERED_BY)
    hold(offsets, "good", 3, 6)
    assert offsets.factors()[0] == pytest.approx(1.0)


def test_one_too_weak_among_many_good_is_nearly_taken_back_by_the_next_good() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    hold(offsets, "good", 5)
    hold(offsets, "too_weak", 1, 5)
    hold(offsets, "good", 3, 6)
    assert 1.0 <= offsets.factors()[0] < 1.02


def test_good_keeps_a_fall_that_was_insisted_on() -> None:
    """What lies deeper than anybody calls good is not given back by the next good."""
    offsets = FeltOffsets(1, may_raise=True)
    lowered = insisted(offsets, 3)
    assert math.log(lowered) < -BAND
    hold(offsets, "good", 5, 1)
    assert lowered <= offsets.factors()[0] < math.exp(BAND) * lowered


def test_too_weak_gives_back_what_was_insisted_on_by_five_percent_a_minute() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    lowered = insisted(offsets, 3)
    hold(offsets, "too_weak", 4, 1)
    assert offsets.factors()[0] == pytest.approx(lowered * RISE_A_MINUTE**4)
    hold(offsets, "too_weak", 20, 5)
    assert offsets.factors()[0] > 1.0


def test_what_is_said_of_one_electrode_is_of_that_one() -> None:
    offsets = FeltOffsets(N, may_raise=True)
    for electrode in range(N):
        offsets.fired(electrode, S)
    offsets.hear("too_strong", (1,), S)
    assert [factor < 1.0 for factor in offsets.factors()] == [False, True, False]


@given(stories, electrodes)
def test_no_pulse_is_raised_after_a_minute_without_one(story: list[Moment], which: int) -> None:
    """Not the first one either, which is asked for before it is fired."""
    played, fired_ns = Played(), -10 * MINUTE
    for moment in story:
        played.now_ns += moment.after_ns
        factor = played.offsets.factor(which, played.now_ns)
        assert factor <= 1.0 or played.now_ns - fired_ns <= FELT_NS
        played.fire(Moment(0, moment.fired, None, None))
        if which in moment.fired:
            fired_ns = played.now_ns
        played.say(moment)


def test_too_weak_keeps_a_rise_whose_reasons_are_long_forgotten() -> None:
    offsets = FeltOffsets(1, may_raise=True)
    hold(offsets, "too_weak", 14)
    raised = offsets.factors()[0]
    for second in range(14 * 60, 74 * 60, 30):
        offsets.fired(0, second * S)
    offsets.hear("too_weak", None, 74 * MINUTE - 30 * S)
    assert offsets.factors()[0] == pytest.approx(raised)
