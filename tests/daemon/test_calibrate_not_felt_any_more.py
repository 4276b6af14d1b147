"""An electrode that is felt only from above what too strong has left of it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from calibrate_scenes import ROW, TODAY
from etd.calibrate.answers import Answer, Question
from etd.calibrate.course import Course
from etd.calibrate.progress import Progress, finished
from etd.cli.doubts import doubts_of
from etd.protocol.calibration import ElectrodeLimits
from noisy_skin import NoisySkin

FROM_UA = 980
OTHER = ElectrodeLimits(threshold_ua=500, comfortable_ua=700, cap_ua=800)


class Person:
    """Feels what is `FROM_UA` and more, until the threshold is found; then as it is told, the last
    for ever.
    """

    def __init__(self, skin: NoisySkin, then: list[Answer]) -> None:
        self._skin, self._then = skin, then
        self.found: int | None = None

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        if question.ask == "sure":
            return "too_strong"
        if self.found is None:
            return "felt" if self._skin.presented[-1][1] >= FROM_UA else "not_felt"
        return self._then.pop(0) if len(self._then) > 1 else self._then[0]

    def wants_stop(self) -> bool:
        return False

    def threshold_found(self, electrode: int) -> None:
        self.found = electrode


def calibrated(*then: Answer) -> Progress:
    skin = NoisySkin(4, 5)
    person = Person(skin, list(then))
    progress = Progress(conditions=ROW, found=dict.fromkeys((1, 2, 3), OTHER))
    Course(progress, skin, person, lambda: TODAY, on_threshold=person.threshold_found).run((0,))
    return progress


@pytest.mark.parametrize(
    "then", [("too_strong", "not_felt"), ("too_strong", "too_strong", "not_felt")]
)
def test_what_was_too_strong_and_is_not_felt_a_step_below_is_no_level(
    then: tuple[Answer, ...],
) -> None:
    progress = calibrated(*then)
    found = progress.found[0]
    assert not found.felt
    assert found.felt_from_ua is not None
    assert found.felt_from_ua == pytest.approx(FROM_UA, rel=0.05)
    assert found.threshold_ua == found.comfortable_ua == found.cap_ua < found.felt_from_ua
    assert found.cap_ua <= progress.lowered_ua[0]
    said = " ".join(doubts_of(finished(progress, TODAY, "test")))
    assert f"electrode 0 (felt from {found.felt_from_ua} uA on" in said


def test_what_was_too_strong_down_to_nothing_is_no_level() -> None:
    found = calibrated("too_strong").found[0]
    assert (found.felt, found.cap_ua) == (False, 0)
    assert found.felt_from_ua == pytest.approx(FROM_UA, rel=0.05)


def test_what_is_felt_a_step_below_is_its_threshold() -> None:
    found = calibrated("too_strong", "felt").found[0]
    assert found.felt
    assert found.felt_from_ua is None
    assert found.threshold_ua == found.cap_ua < FROM_UA


def test_at_its_threshold_it_may_be_missed() -> None:
    """There it is felt half of the time."""
    found = calibrated("not_felt", "too_strong").found[0]
    assert found.felt
    assert found.threshold_ua <= found.cap_ua
