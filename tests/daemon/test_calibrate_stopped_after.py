"""A stop after an answer, in a pause or a silent trial, is about the last presentation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from msgspec.structs import replace

import calibrate_scenes
from calibrate_scenes import EQUAL, REFERENCE
from etd.calibrate.answers import Answer, Question
from etd.calibrate.asking import Asking
from etd.calibrate.course import Course
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.progress import save_progress
from etd.calibrate.reach import Reach
from etd.calibrate.stimulator import NotDelivered
from etd.calibrate.trial import Stopped
from etd.protocol.errors import DaemonGone, Refused

ELECTRODE, OTHER = 0, 2
#: What is left of 400 uA, and of 300.
LEFT_UA, LEFT_OF_OTHER_UA = 363, 272
DOUBT = InDoubt(electrode=ELECTRODE, left_ua={ELECTRODE: LEFT_UA})
WORD = Stopped("stop", "too strong, by a button, a monitor or another program")
STOPS = (
    WORD,
    Refused("halted", "the wearer's stop"),
    Refused("no_lease", "it has lapsed"),
    DaemonGone("here", "no answer", "start it"),
    KeyboardInterrupt(),
)


class Says:
    """Answers in turn."""

    def __init__(self, answers: Iterable[Answer]) -> None:
        self._answers = list(answers)

    def answer(self, _: Question, __: Callable[[], None]) -> Answer:
        return self._answers.pop(0)

    def wants_stop(self) -> bool:
        return False


class Sitting(calibrate_scenes.Sittings):
    """One, trial by trial."""

    def asking(self, *answers: Answer) -> Asking:
        return Asking(
            self.kept,
            self.skin,
            Says(answers),
            lambda now: save_progress(self.path, now),
            lambda _: None,
            lambda *_: None,
        )


def present(asking: Asking, electrode: int = ELECTRODE, current_ua: int = 400) -> Answer:
    return asking.strength(electrode, Reach(3_000, current_ua), current_ua)


def raising(error: BaseException) -> Callable[..., None]:
    def raises(*_: object) -> None:
        raise error

    return raises


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_a_stop_in_the_pause_after_an_answer_is_about_what_was_answered(
    stop: BaseException, tmp_path: Path
) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("felt")
    present(asking)
    assert sitting.kept.in_doubt is None
    sitting.skin.pausing = raising(stop)
    with pytest.raises(type(stop)):
        present(asking, OTHER)
    assert sitting.kept.in_doubt == DOUBT


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_a_stop_in_a_silent_trial_is_about_what_came_before_it(
    stop: BaseException, tmp_path: Path
) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("felt")
    present(asking)
    pauses = iter((lambda: None, raising(stop)))
    sitting.skin.pausing = lambda: next(pauses)()
    with pytest.raises(type(stop)):
        asking.catch(OTHER, 500)
    assert sitting.skin.silences == 1
    assert sitting.kept.in_doubt == DOUBT


@pytest.mark.parametrize("answers", [("stop",), ("too_strong", "stop")])
def test_so_is_one_in_place_of_its_answer(answers: tuple[Answer, ...], tmp_path: Path) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("felt", *answers)
    present(asking)
    with pytest.raises(Stopped):
        asking.catch(OTHER, 500)
    assert sitting.kept.in_doubt == DOUBT


def test_and_one_after_it(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("felt", "too_strong", "felt")
    present(asking)
    asking.catch(OTHER, 500)
    sitting.skin.pausing = raising(WORD)
    with pytest.raises(Stopped):
        present(asking, OTHER)
    assert sitting.kept.in_doubt == DOUBT


def test_a_pause_at_a_silent_trial_says_that_all_was_bearable(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("felt", "pause")
    present(asking)
    with pytest.raises(Stopped):
        asking.catch(OTHER, 500)
    assert sitting.kept.in_doubt is None


@pytest.mark.parametrize(("second", "doubt"), [("felt", DOUBT), ("too_strong", None)])
def test_what_is_kept_as_too_strong_is_asked_no_second_time(
    second: Answer, doubt: InDoubt | None, tmp_path: Path
) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("too_strong", second)
    present(asking)
    sitting.skin.pausing = raising(WORD)
    with pytest.raises(Stopped):
        present(asking, OTHER)
    assert sitting.kept.in_doubt == doubt
    assert sitting.kept.lowered_ua == ({} if doubt else {ELECTRODE: LEFT_UA})


def test_a_stop_that_was_asked_about_is_not_asked_about_again(tmp_path: Path) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("stop", "felt", "felt")
    with pytest.raises(Stopped):
        present(asking)
    asking.settle_doubt()
    sitting.skin.pausing = raising(WORD)
    with pytest.raises(Stopped):
        present(asking)
    assert sitting.kept.in_doubt is None


@pytest.mark.parametrize(
    ("fired_ua", "left_ua"), [(0, {ELECTRODE: LEFT_UA}), (97, {OTHER: LEFT_OF_OTHER_UA})]
)
def test_after_what_was_delivered_in_part_a_stop_is_about_that(
    fired_ua: int, left_ua: dict[int, int], tmp_path: Path
) -> None:
    sitting = Sitting(tmp_path)
    asking = sitting.asking("felt")
    present(asking)
    sitting.skin.meanwhile = raising(NotDelivered(OTHER, "recontact", fired_ua))
    with pytest.raises(NotDelivered):
        present(asking, OTHER, 300)
    assert (sitting.kept.in_doubt is None) == (fired_ua == 0)
    sitting.skin.pausing = raising(WORD)
    with pytest.raises(Stopped):
        present(asking, ELECTRODE, 500)
    assert sitting.kept.in_doubt is not None
    assert sitting.kept.in_doubt.left_ua == left_ua


def test_a_reference_that_was_delivered_is_in_doubt_though_the_electrode_was_not(
    tmp_path: Path,
) -> None:
    sitting = Sitting(tmp_path, EQUAL)

    def lost(electrode: int, _: int) -> None:
        if electrode != REFERENCE:
            raise NotDelivered(electrode, "no contact", 0)

    sitting.skin.meanwhile = lost
    with pytest.raises(NotDelivered):
        sitting.asking().compared(ELECTRODE, Reach(2_000, 1_000), 1_000, REFERENCE, 1_700)
    assert sitting.skin.presented == [(REFERENCE, 1_700)]
    assert sitting.kept.in_doubt is not None
    assert REFERENCE in sitting.kept.in_doubt.left_ua


# --- between two courses, as between two states of a fit ------------------------------------------


def course_of(sitting: Sitting, *answers: Answer, last: InDoubt | None = None) -> Course:
    return Course(
        sitting.kept,
        sitting.skin,
        Says(answers),
        lambda: calibrate_scenes.TODAY,
        on_progress=lambda now: save_progress(sitting.path, now),
        last=last,
    )


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_a_stop_before_the_next_course_is_about_what_the_one_before_presented_last(
    stop: BaseException, tmp_path: Path
) -> None:
    """While it is waited for, and in the pause that it begins with."""
    sitting = Sitting(tmp_path)
    first = course_of(sitting, "not_felt", "felt", "pause")
    with pytest.raises(Stopped):
        first.run((ELECTRODE,))
    assert first.last is not None
    assert sitting.kept.in_doubt is None
    with pytest.raises(type(stop)):
        course_of(sitting, last=first.last).wait(raising(stop))
    assert sitting.kept.in_doubt == first.last
    save_progress(sitting.path, replace(sitting.kept, in_doubt=None))
    sitting.skin.pausing = raising(stop)
    with pytest.raises(type(stop)):
        course_of(sitting, last=first.last).run((OTHER,))
    assert sitting.kept.in_doubt == first.last


def test_it_is_asked_about_before_the_next_course_is_waited_for(tmp_path: Path) -> None:
    sitting, waited = Sitting(tmp_path), list[int | None]()
    save_progress(sitting.path, replace(sitting.kept, in_doubt=DOUBT))
    course = course_of(sitting, "too_strong")
    course.wait(lambda: waited.append(sitting.kept.lowered_ua.get(ELECTRODE)))
    assert waited == [LEFT_UA]
    assert sitting.kept.in_doubt is None


@pytest.mark.parametrize("ends", [Stopped("pause"), NotDelivered(0, "no contact", 0)])
def test_what_is_no_stop_says_nothing_of_it(ends: Exception, tmp_path: Path) -> None:
    sitting = Sitting(tmp_path)
    with pytest.raises(type(ends)):
        course_of(sitting, last=DOUBT).wait(raising(ends))
    assert sitting.kept.in_doubt is None
