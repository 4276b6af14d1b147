"""All electrodes in use for minutes: what is shown, when it is asked, and which answers count."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from calibrate_scenes import FOUND, ROW
from etd.calibrate.adaptation import (
    LIES_PART,
    QUESTIONS,
    USE_S,
    TooStrongInUse,
    adaptation_of,
    before_use,
    currents_in_use,
    in_use,
    take_down_from_use,
    take_down_on_the_way,
)
from etd.calibrate.answers import ANSWERS, Answer, Ask, Presentation, Question
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.person import Felt, ResponseModel, SimulatedPerson
from etd.calibrate.progress import Progress
from etd.calibrate.reach import RISE
from etd.calibrate.stimulator import Delivered
from etd.calibrate.trial import Stopped, TooStrongSaid
from etd.protocol.calibration import Calibration, current_of_level
from etd.protocol.errors import DaemonGone

TODAY = datetime.date(2026, 1, 15)
CURRENTS_UA = {0: 1_500, 2: 1_700}
#: What a presentation takes of the second that it has.
SHOWN_S = 0.3


class UsedSkin:
    """Implements `Presenter`: whole presentations, on time that passes with each, and a strength
    that falls to `falls_to` with a time constant of three minutes of use.
    """

    def __init__(self, falls_to: float = 1.0, shown_s: float = SHOWN_S) -> None:
        self.now_s = 1_000.0
        self._shown_s = shown_s
        self.shown: list[tuple[float, dict[int, int]]] = []
        self.is_stopped = False
        self._falls_to = falls_to

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        self.shown.append((self.now_s, dict(currents_ua)))
        self.now_s += self._shown_s
        electrode = max(currents_ua, key=currents_ua.__getitem__)
        begun_ns = int(self.shown[-1][0] * 1e9)
        return Delivered(electrode, currents_ua[electrode], None, begun_ns, rate_hz=47.4)

    def sense(self, electrode: int) -> Felt:
        assert electrode == 2, "the one with the highest current stands for all"
        left = math.exp(-len(self.shown) / 180.0)
        return Felt(2.0 * (self._falls_to + (1.0 - self._falls_to) * left), 0.0)

    def pause(self, seconds: float) -> None:
        assert seconds > 0.0, "there is time left"
        self.now_s += seconds

    def stop(self) -> None:
        self.is_stopped = True

    def keep(self) -> None:
        """No lease lapses here."""

    def present(self, electrode: int, current_ua: int) -> Delivered:
        raise AssertionError("all of them are in use")

    def silence(self, electrode: int) -> Delivered:
        raise AssertionError("all of them are in use")


class Says:
    """Answers in turn, then the last one; each takes two seconds."""

    def __init__(self, skin: UsedSkin, answers: Iterable[Answer]) -> None:
        self._skin = skin
        self._answers = list(answers)
        self.asked_s: list[float] = []

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        assert question.ask in ("in_use", "sure_in_use")
        self.asked_s.append(self._skin.now_s)
        self._skin.now_s += 2.0
        return self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]

    def wants_stop(self) -> bool:
        return False


def asked(skin: UsedSkin, answers: Iterable[Answer], use_s: float = USE_S) -> list[Answer]:
    return in_use(skin, Says(skin, answers), CURRENTS_UA, use_s, lambda: skin.now_s)


def test_it_is_shown_once_a_second_and_asked_alike_over_the_time() -> None:
    skin = UsedSkin()
    says = Says(skin, ["same"])
    assert in_use(skin, says, CURRENTS_UA, USE_S, lambda: skin.now_s) == ["same"] * QUESTIONS
    assert len(skin.shown) == USE_S
    assert all(shown == CURRENTS_UA for _, shown in skin.shown)
    apart = {round(after - before, 6) for before, after in pairwise(says.asked_s)}
    assert apart == {USE_S / QUESTIONS + 2.0}, "an answer's time is not use"
    steps = [after - before for (before, _), (after, _) in pairwise(skin.shown)]
    assert {round(step, 6) for step in steps} == {1.0, 3.0}


@given(st.floats(QUESTIONS, 3_600.0))
def test_every_duration_is_used_whole(use_s: float) -> None:
    skin = UsedSkin()
    asked(skin, ["same"], use_s)
    used_s = skin.now_s - 1_000.0 - 2.0 * QUESTIONS
    assert use_s - 1e-6 <= used_s <= use_s + QUESTIONS * SHOWN_S


def test_the_finger_lies_for_a_part_of_the_time_that_it_is_in_use_for() -> None:
    assert LIES_PART * USE_S == 300.0


def test_a_presentation_that_takes_its_whole_second_is_followed_at_once() -> None:
    skin = UsedSkin(shown_s=1.0)
    asked(skin, ["same"], 2.0 * QUESTIONS)
    assert len(skin.shown) == 2 * QUESTIONS


def in_turn(*each: tuple[int, Answer]) -> list[Answer]:
    return [answer for count, answer in each for _ in range(count)]


def test_the_second_half_of_the_answers_counts() -> None:
    half = QUESTIONS // 2
    found = adaptation_of(in_turn((half, "weaker"), (half, "same")), USE_S, TODAY)
    assert (found.answers, found.weaker, found.stronger) == (half, 0, 0)
    late = in_turn((half, "same"), (2, "stronger"), (half - 2, "weaker"))
    found = adaptation_of(late, USE_S, TODAY)
    assert (found.answers, found.weaker, found.stronger) == (half, half - 2, 2)
    assert (found.use_s, found.date) == (USE_S, TODAY)
    assert found.why_not_in(TODAY) is None


@pytest.mark.parametrize(
    ("answers", "first"),
    [
        (in_turn((10, "same"), (30, "weaker")), 11),
        (in_turn((11, "same"), (29, "weaker")), 12),
        (in_turn((40, "weaker")), 1),
        # An error on either side of it moves nothing.
        (in_turn((2, "same"), (1, "weaker"), (7, "same"), (29, "weaker"), (1, "same")), 11),
        # *Stronger* is as little *weaker* as *same* is.
        (in_turn((10, "stronger"), (30, "weaker")), 11),
        # Of two that explain it alike, the later one: less is made up for.
        (in_turn((4, "same"), (1, "weaker"), (1, "same"), (34, "weaker")), 7),
        (in_turn((40, "same")), 41),
    ],
)
def test_it_is_weaker_from_where_the_fewest_answers_are_errors(
    answers: list[Answer], first: int
) -> None:
    found = adaptation_of(answers, USE_S, TODAY)
    assert found.weaker_from_s == pytest.approx(first * USE_S / QUESTIONS)


def test_each_question_is_told_of_with_what_was_shown_last() -> None:
    skin, shown, told = UsedSkin(), list[Presentation](), list[Presentation]()
    in_use(
        skin, Says(skin, ["same"]), CURRENTS_UA, 1.5 * QUESTIONS, lambda: skin.now_s,
        on_presented=shown.append, on_answered=lambda presented, *_: told.append(presented),
    )  # fmt: skip
    assert shown == told
    assert len(told) == QUESTIONS
    assert all(one.is_whole and one.electrode == 2 for one in told)
    assert {one.rate_hz for one in told} == {47.4}, "as it was shown"
    assert {(one.current_ua, one.commanded_ua) for one in told} == {(1_700, 1_700)}
    assert [one.begun_ns for one in told] == [int(at_s * 1e9) for at_s, _ in skin.shown[1::2]]


def test_what_the_daemon_refuses_while_it_is_asked_is_no_answer() -> None:
    skin, told = UsedSkin(), list[Answer | None]()

    class Gone(Says):
        def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
            raise DaemonGone("here", "no answer")

    with pytest.raises(DaemonGone):
        in_use(
            skin, Gone(skin, ["same"]), CURRENTS_UA, USE_S, lambda: skin.now_s,
            on_answered=lambda _, __, answer: told.append(answer),
        )  # fmt: skip
    assert told == [None]


@pytest.mark.parametrize(("ending", "is_stopped"), [("stop", True), ("pause", False)])
def test_it_ends_with_a_key(ending: Answer, *, is_stopped: bool) -> None:
    skin, told = UsedSkin(), list[tuple[Ask, Answer | None]]()

    def answered(_: Presentation, ask: Ask, answer: Answer | None) -> None:
        told.append((ask, answer))

    with pytest.raises(Stopped) as ended:
        in_use(
            skin, Says(skin, ["same", ending]), CURRENTS_UA, USE_S, lambda: skin.now_s,
            on_answered=answered,
        )  # fmt: skip
    assert (ended.value.answer, skin.is_stopped) == (ending, is_stopped)
    assert told == [("in_use", "same"), ("in_use", ending)]


def test_what_is_too_strong_ends_it_and_is_not_shown_again() -> None:
    skin, told = UsedSkin(), []
    with pytest.raises(TooStrongInUse, match="after 30 s of use") as ended:
        in_use(
            skin, Says(skin, ["same", "too_strong"]), CURRENTS_UA, USE_S, lambda: skin.now_s,
            on_too_strong=lambda: told.append(len(skin.shown)),
        )  # fmt: skip
    assert ended.value.used_s == 30.0
    assert len(skin.shown) == 30
    assert told == [30]


def test_a_key_that_slipped_is_taken_back_before_anything_is_shown_again() -> None:
    skin, told = UsedSkin(), list[tuple[str, int]]()
    found = in_use(
        skin, Says(skin, ["same", "too_strong", "weaker", "same"]), CURRENTS_UA, USE_S,
        lambda: skin.now_s,
        on_too_strong=lambda: told.append(("too strong", len(skin.shown))),
        on_slip=lambda: told.append(("slip", len(skin.shown))),
    )  # fmt: skip
    assert told == [("too strong", 30), ("slip", 30)]
    assert found == ["same", "weaker", *["same"] * (QUESTIONS - 2)]


@pytest.mark.parametrize("ending", ["stop", "pause"])
def test_too_strong_counts_where_a_key_ends_it_before_it_is_certain(ending: Answer) -> None:
    """Who is in pain presses what comes to hand; and it ends as that key always ends it."""
    skin, told = UsedSkin(), []
    with pytest.raises(Stopped) as ended:
        in_use(
            skin, Says(skin, ["same", "too_strong", ending]), CURRENTS_UA, USE_S,
            lambda: skin.now_s, on_too_strong=lambda: told.append(len(skin.shown)),
        )  # fmt: skip
    assert ended.value.answer == ending
    assert skin.is_stopped == (ending == "stop")
    assert told == [30]


@pytest.mark.parametrize("asked_before", range(3))
def test_too_strong_by_a_word_that_answers_nothing_counts_once(asked_before: int) -> None:
    """At a question: of use, of use again, or whether a key has slipped: then it counts already."""

    class Told(Says):
        def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
            if len(self.asked_s) == asked_before:
                raise TooStrongSaid
            return super().answer(question, keep)

    skin, told = UsedSkin(), []
    with pytest.raises(TooStrongSaid):
        in_use(
            skin, Told(skin, ["same", "too_strong"]), CURRENTS_UA, USE_S, lambda: skin.now_s,
            on_too_strong=lambda: told.append(len(skin.shown)),
        )  # fmt: skip
    assert told == [15 * min(asked_before + 1, 2)]


def test_too_strong_by_a_word_counts_while_it_is_in_use() -> None:
    class Told(UsedSkin):
        def pause(self, seconds: float) -> None:
            if len(self.shown) == 7:
                raise TooStrongSaid
            super().pause(seconds)

    skin, told = Told(), []
    with pytest.raises(TooStrongSaid):
        in_use(
            skin, Says(skin, ["same"]), CURRENTS_UA, USE_S, lambda: skin.now_s,
            on_too_strong=lambda: told.append(len(skin.shown)),
        )  # fmt: skip
    assert told == [7]


@pytest.mark.parametrize(
    ("times", "accepted_ua", "left"),
    [
        # Of a presentation that is in doubt, whatever was accepted before it.
        (1.5, None, 1.0 / 1.5),
        (1.5, 2_000, 1.0 / 1.5),
        # After its answer: a step below it.
        (None, 2_000, 2_000 / 2_222 / RISE),
        # Nothing was presented yet, or it is taken down already.
        (None, None, 1.0),
    ],
)
def test_what_a_word_calls_too_strong_on_the_way_up_takes_the_levels_below_it(
    times: float | None, accepted_ua: int | None, left: float
) -> None:
    low = replace(FOUND, threshold_ua=100)
    doubt = None if times is None else InDoubt(electrode=0, times=times)
    whole = Progress(conditions=ROW, found={0: low, 1: low}, in_doubt=doubt)
    # All together were accepted in the answer before the word.
    whole.is_whole_accepted = True
    accepted = None
    if accepted_ua is not None:
        accepted = Presentation(0, accepted_ua, accepted_ua, 0, is_whole=True)
    take_down_on_the_way(whole, accepted)
    assert whole.is_whole_accepted == (left == 1.0)
    for limits in whole.found.values():
        assert limits.comfortable_ua == pytest.approx(low.comfortable_ua * left, abs=1)
        assert limits.cap_ua == pytest.approx(low.cap_ua * left, abs=1)


@pytest.mark.parametrize("ended", [DaemonGone("main", "it was ended"), KeyboardInterrupt()])
def test_too_strong_counts_where_the_daemon_or_the_terminal_is_gone_before_it_is_certain(
    ended: BaseException,
) -> None:
    class Gone(Says):
        def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
            if question.ask == "sure_in_use":
                raise ended
            return super().answer(question, keep)

    skin, told = UsedSkin(), []
    with pytest.raises(type(ended)):
        in_use(
            skin, Gone(skin, ["too_strong"]), CURRENTS_UA, USE_S, lambda: skin.now_s,
            on_too_strong=lambda: told.append(True),
        )  # fmt: skip
    assert told == [True]


def test_the_levels_in_use_are_of_what_was_accepted_of_all_together() -> None:
    unfelt = replace(FOUND, felt=False)
    made = Calibration(
        participant="P01", body_site="fingertip", array="row", polarity="anodic", width_us=100,
        rate_hz=60.0, returns="all", date=TODAY, program="test", electrode=(FOUND, unfelt, FOUND),
    )  # fmt: skip
    whole = before_use(ROW, made)
    level_ua = current_of_level(FOUND, 0.6, 1.0)
    assert currents_in_use(whole, 1.0) == {0: level_ua, 2: level_ua}
    assert whole.is_whole_due, "it is felt anew: the skin may have changed"
    whole.take_down(1.3)
    assert max(currents_in_use(whole, 1.0).values()) < level_ua
    assert currents_in_use(whole, 2.0)[0] > currents_in_use(whole, 1.0)[0]


def test_what_was_too_strong_in_use_is_above_level_1_from_then_on() -> None:
    """A step below, on each electrode, and nothing is accepted any more."""
    other = replace(FOUND, threshold_ua=500, comfortable_ua=1_800, cap_ua=1_900)
    whole = Progress(conditions=ROW, found={0: FOUND, 1: other}, is_whole_accepted=True)
    before_ua = currents_in_use(whole, 1.0)
    take_down_from_use(whole, 1.0)
    assert not whole.is_whole_accepted
    for electrode, limits in whole.found.items():
        assert limits.comfortable_ua <= before_ua[electrode] / RISE + 1
    nearest = max(limits.comfortable_ua / before_ua[one] for one, limits in whole.found.items())
    assert nearest == pytest.approx(1.0 / RISE, rel=0.01), "a step, and no more than that"


def test_an_electrode_without_a_level_1_is_not_in_use() -> None:
    none = replace(FOUND, threshold_ua=0, comfortable_ua=0, cap_ua=10)
    least = replace(FOUND, threshold_ua=0, comfortable_ua=1, cap_ua=10)
    whole = Progress(conditions=ROW, found={0: none, 1: least})
    assert currents_in_use(whole, 1.0) == {1: 1}
    take_down_from_use(whole, 1.0)
    assert whole.found[1].cap_ua < 10


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("falls_to", "raises"), [(1.0, False), (0.95, False), (0.5, True)])
def test_a_simulated_person_says_what_their_skin_does(
    falls_to: float, seed: int, *, raises: bool
) -> None:
    skin = UsedSkin(falls_to)
    person = SimulatedPerson(skin.sense, seed, ResponseModel(lapses=0.05, slips=0.03))
    answers = in_use(skin, person, CURRENTS_UA, USE_S, lambda: skin.now_s)
    assert set(answers) <= set(ANSWERS["in_use"])
    found = adaptation_of(answers, USE_S, TODAY)
    assert (found.why_not_in(TODAY) is None) == raises, found
