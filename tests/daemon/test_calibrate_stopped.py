"""What was presented when it was stopped is asked about before anything else is presented."""

from __future__ import annotations

import json
import random
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

import calibrate_scenes
from calibrate_scenes import BASELINE, EQUAL, REFERENCE, ROW
from etd.calibrate.answers import ANSWERS, Answer, Question
from etd.calibrate.conditions import Conditions
from etd.calibrate.fitting import FitProgress, Fitting, load_fit
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.progress import Progress, load_progress, save_progress
from etd.calibrate.stimulator import NotDelivered
from etd.calibrate.trial import Stopped
from etd.protocol.calibration import Quality
from etd.protocol.errors import DaemonGone, FileError, Refused

FOUND = BASELINE.electrode[0]


class Says:
    """Answers in turn; what is an exception is raised in place of an answer."""

    def __init__(self, answers: Iterable[Answer | BaseException]) -> None:
        self._answers = list(answers)
        self.asked: list[Question] = []

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        self.asked.append(question)
        said = self._answers.pop(0)
        if isinstance(said, BaseException):
            raise said
        return said

    def wants_stop(self) -> bool:
        return False


class Sittings(calibrate_scenes.Sittings):
    """Each until one of the answers ends it."""

    def sit(
        self, *answers: Answer | BaseException, asks_sensation: bool = False
    ) -> tuple[list[tuple[int, int]], list[Question]]:
        """What was presented, by electrode and current, and asked."""
        before, says = len(self.skin.presented), Says(answers)
        course = self.course(says, asks_sensation=asks_sensation)
        try:
            course.run((0, 2, 3))
            course.feel_whole()
        except (Stopped, Refused, DaemonGone, KeyboardInterrupt):
            pass
        return self.skin.presented[before:], says.asked


HALTED = Refused("halted", "the wearer's stop")
LAPSED = Refused("no_lease", "it has lapsed")
GONE = DaemonGone("here", "no answer", "start it")


@pytest.mark.parametrize("ends", ["stop", HALTED, LAPSED, GONE, KeyboardInterrupt()])
def test_who_stops_it_is_asked_about_what_was_presented_last(
    ends: Answer | BaseException, tmp_path: Path
) -> None:
    """By a key, a button of the wearer's, the lease's or the daemon's end, that of the process."""
    sittings = Sittings(tmp_path)
    (*_, (_, borne_ua), (electrode, hurt_ua)), _ = sittings.sit("not_felt", "not_felt", ends)
    presented, asked = sittings.sit("pause")
    assert (presented, asked) == ([], [Question("stopped", electrode)])
    presented, asked = sittings.sit("too_strong", "not_felt", "not_felt", "not_felt", "pause")
    assert asked[0] == Question("stopped", electrode)
    assert asked[1].ask == "strength"
    assert max(ua for where, ua in presented if where == electrode) < hurt_ua
    assert sittings.kept.lowered_ua == {electrode: borne_ua}
    assert sittings.kept.in_doubt is None


@pytest.mark.parametrize("answer", ["not_felt", "felt", "comfortable"])
def test_what_was_bearable_is_presented_again(answer: Answer, tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)
    (*_, (electrode, shown_ua)), _ = sittings.sit("not_felt", "not_felt", "stop")
    said: list[Answer] = [answer, answer, "not_felt", "not_felt", "not_felt", "pause"]
    presented, asked = sittings.sit(*said)
    assert asked[1] == Question("stopped", electrode, is_again=True)
    assert (electrode, shown_ua) in presented
    assert sittings.kept.lowered_ua == {}


@pytest.mark.parametrize("slip", ["not_felt", "felt", "comfortable"])
def test_one_key_that_slipped_does_not_say_that_it_was_bearable(
    slip: Answer, tmp_path: Path
) -> None:
    """Nor does it where the second question is never answered."""
    sittings = Sittings(tmp_path)
    (*_, (_, borne_ua), (electrode, hurt_ua)), _ = sittings.sit("not_felt", "not_felt", "stop")
    for ends in ("pause", "stop", GONE):
        presented, asked = sittings.sit(slip, ends)
        assert (presented, [one.is_again for one in asked]) == ([], [False, True])
        assert sittings.kept.in_doubt is not None
    presented, _ = sittings.sit(slip, "too_strong", "not_felt", "not_felt", "not_felt", "pause")
    assert sittings.kept.lowered_ua == {electrode: borne_ua}
    assert max(ua for where, ua in presented if where == electrode) < hurt_ua


@pytest.mark.parametrize("is_last", [False, True])
@pytest.mark.parametrize(
    ("said", "lowered"),
    [
        (("neither", "second"), {"second"}),
        (("second", "neither"), {"second"}),
        (("first", "second"), {"first", "second"}),
        (("neither", "both"), {"first", "second"}),
    ],
)
def test_of_two_each_counts_that_is_named_once(
    said: tuple[Answer, ...], lowered: set[str], *, is_last: bool, tmp_path: Path
) -> None:
    places = {"first": 0 if is_last else REFERENCE, "second": REFERENCE if is_last else 0}
    doubt = InDoubt(
        electrode=0, reference=REFERENCE, is_reference_last=is_last, left_ua={0: 900, 1: 1_500}
    )
    sittings = Sittings(tmp_path, EQUAL)
    save_progress(sittings.path, Progress(conditions=EQUAL, in_doubt=doubt))
    _, asked = sittings.sit(*said, "pause")
    assert asked[1] == Question("stopped_which", 0, REFERENCE, is_last, is_again=True)
    assert set(sittings.kept.lowered_ua) == {places[one] for one in lowered}


def test_it_is_in_the_file_before_it_is_presented_until_it_is_answered(tmp_path: Path) -> None:
    """A process that is killed, or a computer without power, says nothing any more."""
    sittings, while_presented = Sittings(tmp_path), list[InDoubt | None]()
    sittings.skin.meanwhile = lambda *_: while_presented.append(sittings.kept.in_doubt)
    while_asked = list[InDoubt | None]()

    class Looks(Says):
        def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
            while_asked.append(sittings.kept.in_doubt)
            return super().answer(question, keep)

    with pytest.raises(Stopped):
        sittings.course(Looks(["not_felt", "felt", "pause"])).run((0,))
    shown = [ua for _, ua in sittings.skin.presented]
    assert while_presented == while_asked
    assert len(while_presented) == len(shown) == 3
    for doubt, current_ua in zip(while_presented, shown, strict=True):
        assert doubt is not None
        assert doubt.left_ua[0] < current_ua
    assert sittings.kept.in_doubt is None, "what was asked is no doubt"


def test_an_answer_that_never_came_says_nothing_of_it(tmp_path: Path) -> None:
    """A program of a study's own that breaks off, with an error of its own."""
    sittings = Sittings(tmp_path)
    with pytest.raises(IndexError):
        sittings.course(Says(["not_felt"])).run((0,))
    assert sittings.kept.in_doubt is not None


def test_it_is_asked_until_it_is_answered(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)
    sittings.sit("not_felt", "stop")
    for ends in ("stop", "pause", GONE, HALTED):
        presented, asked = sittings.sit(ends)
        assert (presented, [one.ask for one in asked]) == ([], ["stopped"])
    assert sittings.skin.stops == 2
    _, asked = sittings.sit("felt", "felt", "pause")
    assert [one.ask for one in asked] == ["stopped", "stopped", "strength"]
    _, asked = sittings.sit("pause")
    assert [one.ask for one in asked] == ["strength"]


def test_a_pause_says_that_it_was_bearable(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)
    sittings.sit("not_felt", "pause")
    assert sittings.kept.in_doubt is None


def test_what_is_stopped_while_it_is_presented_is_in_doubt(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)

    def stops(_: int, current_ua: int) -> None:
        if current_ua > 220:
            raise Stopped("stop")

    sittings.skin.meanwhile = stops
    sittings.sit("not_felt", "not_felt", "not_felt")
    assert sittings.kept.in_doubt is not None
    assert 200 <= sittings.kept.in_doubt.left_ua[0] <= 220


def test_what_was_not_delivered_was_not_felt(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)

    def lost(electrode: int, _: int) -> None:
        raise NotDelivered(electrode, "no contact", 0)

    sittings.skin.meanwhile = lost
    sittings.sit("not_felt", "not_felt", "not_felt")
    assert sittings.kept.in_doubt is None


def test_a_stop_at_the_second_question_was_said_already(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)
    (*_, (_, borne_ua), (electrode, _)), _ = sittings.sit(
        "not_felt", "not_felt", "too_strong", "stop"
    )
    assert sittings.kept.lowered_ua == {electrode: borne_ua}
    assert sittings.kept.in_doubt is None


@pytest.mark.parametrize(
    ("answer", "lowered"),
    [("neither", set()), ("first", {"first"}), ("second", {"second"}), ("both", {0, REFERENCE})],
)
@pytest.mark.parametrize("is_last", [False, True])
def test_of_two_it_is_asked_which_one(
    answer: Answer, lowered: set[str | int], *, is_last: bool, tmp_path: Path
) -> None:
    """Without the reference no electrode can be made as strong: it ends there."""
    places = {"first": 0 if is_last else REFERENCE, "second": REFERENCE if is_last else 0}
    expected = {places.get(str(one), one) for one in lowered}
    sittings = Sittings(tmp_path, EQUAL)
    doubt = InDoubt(
        electrode=0, reference=REFERENCE, is_reference_last=is_last, left_ua={0: 900, 1: 1_500}
    )
    save_progress(sittings.path, Progress(conditions=EQUAL, in_doubt=doubt))
    answers: list[Answer] = ["both"] if answer == "both" else [answer, answer]
    presented, asked = sittings.sit(*answers, "pause")
    assert asked[0] == Question("stopped_which", 0, REFERENCE, is_last)
    assert set(sittings.kept.lowered_ua) == expected
    assert (not presented) == (REFERENCE in expected)


@pytest.mark.parametrize("now", [ROW, replace(EQUAL, reference=2)])
def test_what_was_a_reference_before_it_was_begun_anew_ends_nothing(
    now: Conditions, tmp_path: Path
) -> None:
    doubt = InDoubt(electrode=0, reference=REFERENCE, left_ua={0: 900, REFERENCE: 1_500})
    sittings = Sittings(tmp_path, now)
    save_progress(sittings.path, Progress(conditions=now, in_doubt=doubt))
    felt: list[Answer] = ["felt"] * 40
    presented, _ = sittings.sit("both", *felt, "pause")
    assert sittings.kept.lowered_ua == {0: 900, REFERENCE: 1_500}
    assert presented


def test_a_stop_at_a_comparison_keeps_both(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path, EQUAL)
    led_up: list[Answer] = ["felt"] * 7
    sittings.sit(*led_up, "weaker", "stop")
    doubt = sittings.kept.in_doubt
    assert doubt is not None
    assert (doubt.electrode, doubt.reference) == (0, REFERENCE)
    assert set(doubt.left_ua) == {0, REFERENCE}


def test_all_at_once_are_taken_down_where_that_was_too_strong(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)
    found = dict.fromkeys(range(4), FOUND)
    save_progress(sittings.path, Progress(conditions=ROW, found=found))
    sittings.sit("felt", "felt", "stop")
    last = sittings.skin.wholes[-1]
    _, asked = sittings.sit("too_strong", "stop")
    assert [one.ask for one in asked] == ["stopped_whole", "whole"]
    assert all(sittings.kept.found[one].comfortable_ua < ua for one, ua in last.items())
    assert not sittings.kept.is_whole_accepted


@pytest.mark.parametrize("before", [(), (get_args(Quality)[0],)])
def test_a_stop_at_what_it_feels_like_and_where_is_asked_about_as_well(
    before: tuple[Answer, ...], tmp_path: Path
) -> None:
    sittings = Sittings(tmp_path)
    save_progress(sittings.path, Progress(conditions=ROW, found=dict.fromkeys(range(4), FOUND)))
    sittings.sit(*before, "stop", asks_sensation=True)
    assert sittings.kept.in_doubt == InDoubt(electrode=0, left_ua={0: int(1_700 / 1.1)})
    sittings.sit("too_strong", "pause", asks_sensation=True)
    assert 0 not in sittings.kept.found


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32), hurts=st.integers(1, 4))
def test_however_often_it_is_stopped_in_pain_nothing_as_strong_comes_again(
    seed: int, hurts: int
) -> None:
    said: list[Answer] = random.Random(seed).choices(
        [*ANSWERS["strength"][:3], "stop"], [8, 8, 2, hurts], k=150
    )
    with tempfile.TemporaryDirectory() as folder:
        sittings, hurt_ua = Sittings(Path(folder)), dict[int, int]()
        left, was_stopped = [*said, "stop"], False
        while left:
            count = left.index("stop") + 1
            heard, left = left[:count], left[count:]
            first: tuple[Answer, ...] = ("too_strong",) if was_stopped else ()
            presented, _ = sittings.sit(*first, *heard)
            assert all(ua < hurt_ua.get(electrode, 9_999) for electrode, ua in presented)
            if len(presented) < count:
                break
            electrode, current_ua = presented[count - 1]
            hurt_ua[electrode] = min(current_ua, hurt_ua.get(electrode, 9_999))
            was_stopped = True


def test_a_file_that_doubts_what_there_is_not_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=ROW, in_doubt=InDoubt(electrode=0, left_ua={7: 100})))
    with pytest.raises(FileError, match="no such electrode"):
        load_progress(path, ROW)


def test_a_file_of_before_it_was_kept_is_read(tmp_path: Path) -> None:
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=ROW, presentations=7))
    content = json.loads(path.read_text())
    del content["in_doubt"]
    path.write_text(json.dumps(content))
    assert load_progress(path, ROW) == Progress(conditions=ROW, presentations=7)


# --- in a fit ------------------------------------------------------------------------------------


def fit_progress(in_doubt: InDoubt | None = None) -> FitProgress:
    return FitProgress(
        conditions=ROW, electrodes=(0, 1, 2, 3), seed=1, board="kajimoto-hv507", leak_ohm=66_000,
        in_doubt=in_doubt,
    )  # fmt: skip


def test_a_fit_that_is_stopped_asks_when_it_goes_on(tmp_path: Path) -> None:
    doubt = InDoubt(electrode=2, left_ua={2: 700})
    progress, path = fit_progress(), tmp_path / "fit.json"
    fitting = Fitting(progress, BASELINE)
    of_state = fitting.progress_of_state()
    of_state.in_doubt = doubt
    fitting.lower(of_state)
    save_progress(path, progress)
    again = Fitting(load_fit(path, fit_progress()), BASELINE).progress_of_state()
    assert again.in_doubt == doubt
    again.in_doubt = None
    fitting.lower(again)
    assert progress.in_doubt is None


def test_a_fit_that_doubts_what_it_does_not_ask_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    save_progress(path, fit_progress(InDoubt(electrode=9)))
    with pytest.raises(FileError, match="names what was not asked"):
        load_fit(path, fit_progress())
