"""What counts against laws, and when it is enough."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.stabilize.law_watch import (
    IF_THEY_HARM,
    IF_THEY_HELP,
    REFUTED,
    SAME_WORD_NS,
    LawWatch,
)
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
        """`x`: against them; any other letter is not."""
        for each in answers:
            self.says("too_strong" if each == "x" else "good")
        return self


def test_what_counts_against_laws() -> None:
    asked = Asked()
    for _ in range(9):
        asked.says("too_strong", 0.5)
        asked.says("too_weak", 1.5)
        asked.says("good", 2.0)
        asked.says("too_strong", 1.1)
        asked.says("too_weak", 0.9)
    assert asked.watch.against == 0
    asked.says("too_strong", 1.11)
    asked.says("too_weak", 0.89)
    asked.says("too_strong", 3.0)
    assert (asked.watch.against, asked.watch.answers) == (3, 3)
    assert not asked.watch.is_refuted
    asked.says("too_weak", 0.2)
    assert asked.watch.is_refuted
    asked.watch.reset()
    assert not asked.watch.is_refuted
    assert (asked.watch.against, asked.watch.answers) == (0, 0)


@pytest.mark.parametrize("answers", ["xxxx", "xx.xx", "x.xx.x", "xx..xx", "x.x.x.x.x", "xx.x..xx"])
def test_so_many_are_enough(answers: str) -> None:
    assert not Asked().said(answers[:-1]).watch.is_refuted
    asked = Asked().said(answers)
    assert asked.watch.is_refuted
    assert asked.watch.against == answers.count("x")
    assert asked.watch.answers == len(answers)


@pytest.mark.parametrize("answers", ["xxx", "x.x.x.x", "xx...xx", "x...x...x...x...x...x"])
def test_so_many_are_not(answers: str) -> None:
    assert not Asked().said(answers).watch.is_refuted


def test_what_was_good_for_an_hour_excuses_nothing() -> None:
    assert Asked().said("." * 60 + "xxxx").watch.is_refuted


@given(st.text("x.", max_size=30))
def test_it_is_the_most_that_any_of_the_last_answers_say(answers: str) -> None:
    """Of all that end now, the stretch whose answers are the likeliest if laws do harm, compared
    with how likely they are if laws help; by their products, which are no sum that begins anew.
    """
    watch = Asked().said(answers).watch
    likelier = [1.0]
    for begin in range(len(answers)):
        harm = help_ = 1.0
        for each in answers[begin:]:
            harm *= IF_THEY_HARM if each == "x" else 1.0 - IF_THEY_HARM
            help_ *= IF_THEY_HELP if each == "x" else 1.0 - IF_THEY_HELP
        likelier.append(harm / help_)
    assert watch.is_refuted == (max(likelier) >= math.exp(REFUTED))


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


def _off_within(chance: float, answers: int) -> float:
    """The probability that laws are off within so many answers, each against them by this chance.

    Played with the watch itself: each course that is alike so far is one, with its probability.
    """
    courses = {"": 1.0}
    off = 0.0
    for _ in range(answers):
        found: dict[str, float] = {}
        for course, likely in courses.items():
            for said, by in (("x", chance), (".", 1.0 - chance)):
                watch = Asked().said(course + said).watch
                if watch.is_refuted:
                    off += likely * by
                    continue
                # Only these two are what the next answers go by, in any order.
                alike = "x" * watch.against + "." * (watch.answers - watch.against)
                found[alike] = found.get(alike, 0.0) + likely * by
        courses = found
    return off


@pytest.mark.parametrize(
    ("chance", "answers", "said"),
    [(0.1, 60, 0.05), (0.2, 60, 0.49), (0.5, 10, 0.68), (0.5, 20, 0.95), (0.8, 6, 0.9)],
)
def test_how_likely_the_page_says_that_it_is(chance: float, answers: int, said: float) -> None:
    assert _off_within(chance, answers) == pytest.approx(said, abs=0.006)
