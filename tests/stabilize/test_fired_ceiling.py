"""What an electrode gets after *too strong* of a pulse that another limit had lowered."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.stabilize.fired_ceiling import FiredCeiling
from etd.stabilize.said_electrode import LETS_RISE_NS, MINUTE_NS, RISE_A_MINUTE

FIRED_UA, NOW_NS = 1_000.0, 7 * MINUTE_NS


def lowered(left: float = 0.8) -> FiredCeiling:
    return FiredCeiling(FIRED_UA, NOW_NS, left, NOW_NS)


def fire(made: FiredCeiling, at_ns: int) -> None:
    """As strong as it lets through, all the time until then."""
    made.fired(int(made.most_ua), at_ns)


def word(made: FiredCeiling, at_ns: int, *, is_weak: bool) -> bool:
    """Of a pulse that it bound a moment before."""
    fire(made, at_ns - 1)
    return made.let_rise(at_ns, is_weak=is_weak)


def test_each_word_takes_of_what_was_fired_or_is_left() -> None:
    made = lowered()
    assert made.most_ua == pytest.approx(800.0)
    made.lower(FIRED_UA, 0.5, NOW_NS)
    assert made.most_ua == pytest.approx(400.0), "no pulse was fired in between"
    made.lower(300.0, 0.5, NOW_NS)
    assert made.most_ua == pytest.approx(150.0)


def test_within_a_minute_nothing_rises_and_then_with_a_pulse() -> None:
    made = lowered()
    assert word(made, NOW_NS + 1, is_weak=False)
    fire(made, NOW_NS + MINUTE_NS - 1)
    assert made.most_ua == pytest.approx(800.0)
    fire(made, NOW_NS + MINUTE_NS)
    assert made.most_ua == pytest.approx(800.0 * RISE_A_MINUTE)
    fire(made, NOW_NS + 3 * MINUTE_NS)
    assert made.most_ua == pytest.approx(800.0 * RISE_A_MINUTE), "a word is for one rise"


def test_a_pulse_that_ended_before_the_word_raises_nothing() -> None:
    """It was under way when the word was heard."""
    made = lowered()
    fire(made, NOW_NS - 1)
    assert made.most_ua == pytest.approx(800.0)


@pytest.mark.parametrize(("early_ns", "rises"), [(1, True), (0, False)])
def test_a_word_is_forgotten(early_ns: int, rises: bool) -> None:
    made = lowered()
    word(made, NOW_NS + 2, is_weak=True)
    fire(made, NOW_NS + MINUTE_NS - 1)
    fire(made, NOW_NS + 2 + LETS_RISE_NS - early_ns)
    assert made.most_ua == pytest.approx(800.0 * (RISE_A_MINUTE if rises else 1.0))


def test_too_strong_ends_what_an_earlier_word_lets_rise() -> None:
    made = lowered()
    word(made, NOW_NS + 1, is_weak=True)
    made.lower(800.0, 0.5, NOW_NS + 2)
    fire(made, NOW_NS + 2 + MINUTE_NS)
    assert made.most_ua == pytest.approx(400.0)


def test_good_reaches_what_was_too_strong_and_no_more() -> None:
    made, now_ns = lowered(), NOW_NS
    for _ in range(4):
        now_ns += MINUTE_NS
        assert word(made, now_ns, is_weak=False)
    assert made.most_ua == pytest.approx(800.0 * RISE_A_MINUTE**4)
    word(made, now_ns + MINUTE_NS, is_weak=False)
    assert made.most_ua == pytest.approx(FIRED_UA)
    assert not word(made, now_ns + 2 * MINUTE_NS, is_weak=False)
    assert word(made, now_ns + 3 * MINUTE_NS, is_weak=True)
    assert made.most_ua == pytest.approx(FIRED_UA * RISE_A_MINUTE)
    assert not word(made, now_ns + 4 * MINUTE_NS, is_weak=False)
    assert made.most_ua == pytest.approx(FIRED_UA * RISE_A_MINUTE), "good lowers nothing"


def test_good_reaches_what_the_last_word_was_of() -> None:
    made = lowered()
    made.lower(800.0, 0.9, NOW_NS)
    for minute in range(1, 9):
        word(made, NOW_NS + minute * MINUTE_NS, is_weak=False)
    assert made.most_ua == pytest.approx(800.0)


def test_two_words_in_a_minute_share_its_room() -> None:
    made = lowered()
    for second in (60, 80, 119):
        word(made, NOW_NS + second * MINUTE_NS // 60, is_weak=True)
    assert made.most_ua == pytest.approx(800.0 * RISE_A_MINUTE)
    fire(made, NOW_NS + 2 * MINUTE_NS)
    assert made.most_ua == pytest.approx(800.0 * RISE_A_MINUTE**2)


def test_it_binds_for_a_minute_after_a_pulse_at_it() -> None:
    made = lowered()
    assert made.binds(NOW_NS + MINUTE_NS)
    assert not made.binds(NOW_NS + MINUTE_NS + 1)
    made.fired(799, NOW_NS + 2 * MINUTE_NS)
    assert not made.binds(NOW_NS + 2 * MINUTE_NS), "a weaker one"
    made.fired(800, NOW_NS + 3 * MINUTE_NS)
    assert made.binds(NOW_NS + 4 * MINUTE_NS)


def test_a_rise_is_lost_where_it_bound_nothing_for_a_minute() -> None:
    made = lowered()
    assert word(made, NOW_NS + 20 * MINUTE_NS // 60, is_weak=True)
    assert made.waits_ns(NOW_NS + LETS_RISE_NS - 2) is None
    for after_ns in (LETS_RISE_NS - 1, LETS_RISE_NS):
        fire(made, NOW_NS + after_ns)
    assert made.most_ua == pytest.approx(800.0)
    assert made.waits_ns(NOW_NS + LETS_RISE_NS) is None


def test_a_word_that_is_forgotten_is_not_waited_for() -> None:
    made = lowered()
    word(made, NOW_NS + 1, is_weak=True)
    assert made.waits_ns(NOW_NS + 1) == MINUTE_NS - 1
    fire(made, NOW_NS + MINUTE_NS - 1)
    assert made.waits_ns(NOW_NS + 1 + LETS_RISE_NS) is None
    assert made.waits_ns(NOW_NS + LETS_RISE_NS) is not None


def test_it_comes_down_to_a_floor_of_which_nothing_is_fired() -> None:
    made = lowered()
    for _ in range(3):
        made.lower(0.0, 1e-300, NOW_NS)
    assert 0.0 < made.most_ua < 1.0
    assert not made.let_rise(NOW_NS, is_weak=True)


@given(
    steps=st.lists(
        st.tuples(
            st.integers(0, 2 * MINUTE_NS),
            st.sampled_from(["good", "too_weak", "too_strong", "pulse"]),
        ),
        max_size=40,
    )
)
def test_in_any_minute_it_rises_by_a_twentieth_at_most(steps: list[tuple[int, str]]) -> None:
    made, now_ns = lowered(), NOW_NS
    was: list[tuple[int, float]] = [(now_ns, made.most_ua)]
    for after_ns, what in steps:
        now_ns += after_ns
        if what == "too_strong":
            made.lower(made.most_ua, 0.95, now_ns)
        elif what == "pulse":
            fire(made, now_ns)
        else:
            word(made, now_ns, is_weak=what == "too_weak")
        now_ua = made.most_ua
        lately = [ua for at_ns, ua in was if now_ns - at_ns < MINUTE_NS]
        for before_ua in lately:
            assert math.log(now_ua / before_ua) <= math.log(RISE_A_MINUTE) + 1e-9
        was.append((now_ns, now_ua))
