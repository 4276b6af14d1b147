"""How much an answer speaks against laws, and when it is enough."""

from __future__ import annotations

import math
import random
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.stabilize.law_watch import HARDLY, REFUTED, SAME_WORD_NS, LawWatch
from etd.stabilize.offset_estimate import Answer

MINUTE_NS = 60_000_000_000


class Asked:
    """Once a minute, while laws give half as much again."""

    def __init__(self) -> None:
        self.watch = LawWatch()
        self.now_ns = 0

    def says(self, answer: Answer, gave: float = 1.5) -> None:
        self.now_ns += MINUTE_NS
        self.watch.hear(answer, gave, self.now_ns)

    def said(self, answers: str) -> Asked:
        """`x`: against them; any other letter: good."""
        for each in answers:
            self.says("too_strong" if each == "x" else "good")
        return self


def chance(answer: Answer, above: float) -> float:
    """That a person says it of a strength so far above what is wanted: a figure of docs and
    decisions, by another formula than the estimate's. Good within 0.15, with edges of 0.05, and
    one answer of five is another than the right one.
    """
    strong = 1.0 / (1.0 + math.exp(-(above - 0.15) / 0.05))
    weak = 1.0 / (1.0 + math.exp((above + 0.15) / 0.05))
    right = {"too_strong": strong, "too_weak": weak, "good": 1.0 - strong - weak}[answer]
    return 0.8 * right + 0.1 * (1.0 - right)


def test_what_speaks_against_laws() -> None:
    asked = Asked()
    for _ in range(9):
        asked.says("too_strong", 0.5)
        asked.says("too_weak", 1.5)
        asked.says("good", 2.0)
        asked.says("good", 0.5)
    assert (asked.watch.against, asked.watch.answers) == (0, 0)
    asked.says("too_strong", 1.5)
    asked.says("too_weak", 0.6)
    asked.says("too_strong", 3.0)
    assert (asked.watch.against, asked.watch.answers) == (3, 3)
    assert not asked.watch.is_refuted
    asked.says("too_weak", 0.2)
    assert asked.watch.is_refuted
    asked.watch.reset()
    assert not asked.watch.is_refuted
    assert (asked.watch.against, asked.watch.answers) == (0, 0)


def test_a_word_against_a_small_change_counts_a_little() -> None:
    asked = Asked()
    for number in range(1, 8):
        asked.says("too_strong", 1.1)
        assert (asked.watch.against, asked.watch.answers) == (number, number)
        assert not asked.watch.is_refuted
    asked.says("too_strong", 1.1)
    assert asked.watch.is_refuted


def test_of_what_laws_hardly_changed_no_word_counts() -> None:
    """Nor does it stand for the word that is said within half a minute of it."""
    asked = Asked().said("xxxx")
    for gave in (math.exp(0.99 * HARDLY), math.exp(-0.99 * HARDLY), 1.0):
        asked.watch.hear("good", gave, asked.now_ns + 1)
    assert asked.watch.is_refuted
    assert asked.watch.answers == 4
    asked.watch.hear("good", math.exp(HARDLY + 1e-9), asked.now_ns + MINUTE_NS)
    assert asked.watch.answers == 5


@pytest.mark.parametrize(
    ("answers", "against"), [("xxxx", 4), ("xx.xxx", 5), ("xxx.xx", 5), ("....xxxx", 4)]
)
def test_so_many_are_enough(answers: str, against: int) -> None:
    assert not Asked().said(answers[:-1]).watch.is_refuted
    asked = Asked().said(answers)
    assert asked.watch.is_refuted
    assert asked.watch.against == against
    assert asked.watch.answers == len(answers.lstrip("."))


@pytest.mark.parametrize("answers", ["xxx", "xx.xx", "x.x.x.x.x.x", "xxx..xx"])
def test_so_many_are_not(answers: str) -> None:
    assert not Asked().said(answers).watch.is_refuted


def test_what_was_good_for_an_hour_excuses_nothing() -> None:
    assert Asked().said("." * 60 + "xxxx").watch.is_refuted


@given(
    st.lists(
        st.tuples(
            st.sampled_from(get_args(Answer)),
            st.one_of(st.floats(0.3, 3.0), st.sampled_from([1.0, 1.2, 1.5])),
        ),
        max_size=20,
    )
)
def test_it_is_the_most_that_any_of_the_last_answers_say(said: list[tuple[Answer, float]]) -> None:
    """Of all that end now, the stretch whose answers are the likeliest if laws do harm, compared
    with how likely they are if laws help; by their products, which are no sum that begins anew.
    """
    asked = Asked()
    for answer, gave in said:
        asked.says(answer, gave)
    counts = [(answer, math.log(gave)) for answer, gave in said if abs(math.log(gave)) >= HARDLY]
    likelier = [1.0]
    for begin in range(len(counts)):
        harm = help_ = 1.0
        for answer, above in counts[begin:]:
            harm *= chance(answer, above)
            help_ *= chance(answer, 0.0)
        likelier.append(harm / help_)
    assert asked.watch.is_refuted == (max(likelier) >= math.exp(REFUTED))


def test_within_half_a_minute_the_last_word_counts() -> None:
    assert SAME_WORD_NS == 30_000_000_000
    watch = LawWatch()
    for minute in range(4):
        watch.hear("good", 1.5, MINUTE_NS * minute)
        watch.hear("too_strong", 1.5, MINUTE_NS * minute + 1)
    assert watch.against == watch.answers == 4
    watch.hear("good", 1.5, MINUTE_NS * 3 + SAME_WORD_NS - 1)
    assert (watch.against, watch.answers) == (3, 4)
    assert not watch.is_refuted
    watch.hear("too_strong", 1.5, MINUTE_NS * 3 + SAME_WORD_NS)
    assert (watch.against, watch.answers) == (4, 5)


def off_within(answers: int, wrong: float, persons: int = 1_500) -> float:
    """Of so many persons: for whom laws are off within so many answers. They give and take about a
    quarter, by chance, and this part of it is felt beside what was wanted.
    """
    drawn, off = random.Random(1), 0
    for _ in range(persons):
        asked = Asked()
        for _ in range(answers):
            above = drawn.gauss(0.0, 0.26)
            felt = (math.exp(above * wrong)) ** 1.2
            right: Answer = "too_strong" if felt > 1.2 else "too_weak" if felt < 1 / 1.2 else "good"
            others = [other for other in get_args(Answer) if other != right]
            asked.says(right if drawn.random() < 0.8 else drawn.choice(others), math.exp(above))
            if asked.watch.is_refuted:
                off += 1
                break
    return off / persons


def test_how_likely_the_page_says_that_it_is() -> None:
    assert off_within(60, wrong=0.0) < 0.012
    assert off_within(10, wrong=1.0) == pytest.approx(0.67, abs=0.04)
    assert off_within(20, wrong=1.0) == pytest.approx(0.97, abs=0.02)
    assert off_within(60, wrong=0.4) == pytest.approx(0.4, abs=0.05)
