"""Equal strength: it does not depend on which of two comes second, and has silent trials."""

from __future__ import annotations

import datetime
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from calibrate_scenes import ROW
from etd.calibrate.answers import Answer, Ask, Presentation, Question
from etd.calibrate.course import Course
from etd.calibrate.equal_strength import default_reference
from etd.calibrate.order import CATCH_IN
from etd.calibrate.person import ResponseModel, SimulatedPerson
from etd.calibrate.progress import Progress, finished
from etd.cli.false_alarms import said_of_false_alarms
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import Refused
from noisy_skin import NoisySkin

TODAY = datetime.date(2025, 3, 4)
CONDITIONS = replace(ROW, electrodes=16, array="grid-4x4", cap_ua=4_000)


def baseline_on(skin: NoisySkin) -> Calibration:
    begun = Progress(conditions=CONDITIONS)
    Course(begun, skin, SimulatedPerson(skin.sense, 19), lambda: TODAY).run(range(16))
    return finished(begun, TODAY, "test")


def test_equal_strength_does_not_depend_on_what_comes_second() -> None:
    """The second of two feels stronger by a seventh: half of the electrodes' comparisons end with
    the reference, so that it is in neither's favor.
    """
    skin = NoisySkin(16, 19)
    skin.pain_ua = [4.0 * value for value in skin.threshold_ua]
    made = baseline_on(skin)
    shown: list[Presentation] = []
    medians = []
    for seed in (None, 3):
        progress = Progress(
            conditions=replace(CONDITIONS, method="equalize", reference=5), seed=seed
        )
        person = SimulatedPerson(skin.sense, 8, ResponseModel(second=0.14))
        course = Course(
            progress, skin, person, lambda: TODAY, baseline=made, on_presented=shown.append
        )
        found = course.run(range(16)).found
        reference = found[5].comfortable_ua / skin.threshold_ua[5]
        strong = sorted(
            limits.comfortable_ua / skin.threshold_ua[where] / reference
            for where, limits in found.items()
            if where != 5 and limits.comfortable_ua < limits.cap_ua
        )
        assert len(strong) >= 12
        medians.append(strong[len(strong) // 2])
    assert medians[0] < 0.92
    assert abs(medians[1] - 1.0) < 0.04
    lasts = [one.is_reference_last for one in shown if one.reference == 5]
    assert 0.15 < sum(lasts) / len(lasts) < 0.4, "half of the second round"


# --- silent trials -------------------------------------------------------------------------------


TURNED: dict[Answer, Answer] = {"weaker": "stronger", "stronger": "weaker"}


class OfSilence(SimulatedPerson):
    """Answers as told that silence is to the reference, and which of them was too strong."""

    def __init__(self, skin: NoisySkin, silent: Answer | None, which: str = "electrode") -> None:
        super().__init__(skin.sense, 8)
        self._skin = skin
        self._silent = silent
        self._which_is = which
        self.asked: list[Ask] = []

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        is_silent = self._skin.sense(question.electrode).strength == 0.0
        if self._silent is None or not is_silent:
            return super().answer(question, keep)
        self.asked.append(question.ask)
        if question.ask == "compare":
            super().answer(question, keep)
            return (
                TURNED.get(self._silent, self._silent)
                if question.is_reference_last
                else (self._silent)
            )
        if self._which_is == "neither":
            self._silent = "weaker"
            return "neither"
        if self._which_is == "both":
            return "both"
        is_first = question.is_reference_last == (self._which_is == "electrode")
        return "first" if is_first else "second"


@pytest.fixture(scope="module")
def skin() -> NoisySkin:
    made = NoisySkin(16, 19)
    made.pain_ua = [4.0 * value for value in made.threshold_ua]
    return made


@pytest.fixture(scope="module")
def baseline(skin: NoisySkin) -> Calibration:
    return baseline_on(skin)


def equalized(
    skin: NoisySkin, baseline: Calibration, person: SimulatedPerson
) -> tuple[Progress, list[Presentation]]:
    shown: list[Presentation] = []
    progress = Progress(
        conditions=replace(CONDITIONS, method="equalize", reference=5, baseline="P01"), seed=3
    )
    Course(progress, skin, person, lambda: TODAY, baseline=baseline, on_presented=shown.append).run(
        range(16)
    )
    return progress, shown


def test_one_comparison_in_eight_has_silence_in_the_electrodes_place(
    skin: NoisySkin, baseline: Calibration
) -> None:
    begun = len(skin.presented)
    progress, shown = equalized(skin, baseline, OfSilence(skin, None))
    presented = skin.presented[begun:]
    silent = [one for one in shown if one.is_catch]
    trials = [one for one in shown if one.reference is not None]
    assert len(silent) == pytest.approx(len(trials) / CATCH_IN, abs=2.0)
    assert progress.catch_trials == len(silent)
    assert progress.false_alarms == 0
    assert progress.presentations == len(shown)
    assert {(one.current_ua, one.commanded_ua, one.reference) for one in silent} == {(0, 0, 5)}
    assert {one.is_reference_last for one in silent} == {False, True}
    of_reference = sum(electrode == 5 for electrode, _ in presented)
    led_up = sum(one.reference is None for one in shown)
    assert of_reference == len(trials) + led_up, "the reference comes in each comparison"
    assert len(presented) == of_reference + len(trials) - len(silent)
    for trial, one in enumerate(shown):
        if one.is_catch:
            after = next(other for other in shown[trial:] if not other.is_catch
                         and other.electrode == one.electrode)  # fmt: skip
            assert one.stands_for_ua == after.current_ua


@pytest.mark.parametrize("silent", ["weaker", "same", "stronger", "too_strong"])
def test_silence_as_strong_as_the_reference_is_a_false_alarm_and_changes_nothing_else(
    silent: Answer, skin: NoisySkin, baseline: Calibration
) -> None:
    quiet, _ = equalized(skin, baseline, OfSilence(skin, "weaker"))
    progress, _ = equalized(skin, baseline, OfSilence(skin, silent))
    assert progress.found == quiet.found
    assert progress.lowered_ua == quiet.lowered_ua
    made = finished(progress, TODAY, "test")
    assert made.false_alarm_rate == (0.0 if silent == "weaker" else 1.0)
    said = said_of_false_alarms(made)
    assert (said is None) == (silent == "weaker")
    assert said is None or "P01 called silence as strong as the reference in 100% of" in said


@pytest.mark.parametrize("which", ["reference", "both"])
def test_a_reference_too_strong_beside_silence_ends_it_as_always(
    which: str, skin: NoisySkin, baseline: Calibration
) -> None:
    shown: list[Presentation] = []
    progress = Progress(
        conditions=replace(CONDITIONS, method="equalize", reference=5, baseline="P01"), seed=3
    )
    course = Course(
        progress, skin, OfSilence(skin, "too_strong", which), lambda: TODAY,
        baseline=baseline, on_presented=shown.append,
    )  # fmt: skip
    with pytest.raises(Refused, match="the reference, electrode 5, is too strong"):
        course.run(range(16))
    assert shown[-1].is_catch
    assert progress.lowered_ua == {5: int(baseline.electrode[5].comfortable_ua / 1.1)}


def test_neither_beside_silence_asks_again(skin: NoisySkin, baseline: Calibration) -> None:
    person = OfSilence(skin, "too_strong", "neither")
    progress, _ = equalized(skin, baseline, person)
    assert person.asked[:3] == ["compare", "which", "compare"]
    assert (progress.false_alarms, progress.lowered_ua) == (0, {})


# --- the reference, again ------------------------------------------------------------------------


def limits(comfortable_ua: int, cap_ua: int, *, felt: bool = True) -> ElectrodeLimits:
    return ElectrodeLimits(
        threshold_ua=500, comfortable_ua=comfortable_ua, cap_ua=cap_ua, felt=felt
    )


ROOMY, TIGHT, UNFELT = limits(1_000, 1_200), limits(1_000, 1_050), limits(1_000, 3_000, felt=False)


@pytest.mark.parametrize(
    ("electrodes", "reference"),
    [
        ([ROOMY, ROOMY, ROOMY, ROOMY, ROOMY], 2),
        ([ROOMY, TIGHT, UNFELT, TIGHT, TIGHT], 0),
        ([TIGHT, TIGHT, limits(1_001, 1_050), TIGHT, TIGHT], 2),
        ([TIGHT, limits(1_000, 1_100), TIGHT, TIGHT, UNFELT], 1),
        ([UNFELT, UNFELT, UNFELT, limits(1_000, 1_000), UNFELT], 3),
        ([limits(1_000, 9_000), ROOMY, limits(1_003, 1_203), ROOMY, ROOMY], 2),
    ],
)
def test_the_reference_has_room_above_it_and_is_near_the_middle(
    electrodes: list[ElectrodeLimits], reference: int, baseline: Calibration
) -> None:
    row = replace(baseline, electrode=tuple(electrodes))
    assert default_reference(row, [0.0, 1.0, 2.0, 3.0, 4.0], [0.0] * 5) == reference
    assert default_reference(None, [0.0, 1.0, 2.0], [0.0] * 3) == 1


def test_what_is_left_out_is_no_reference(baseline: Calibration) -> None:
    """It would be presented in every comparison."""
    each = [ElectrodeLimits(threshold_ua=500, comfortable_ua=700, cap_ua=840)] * 5
    row = replace(baseline, electrode=tuple(each))
    x_mm, y_mm = [0.0, 1.0, 2.0, 3.0, 4.0], [0.0] * 5
    assert default_reference(row, x_mm, y_mm, {2}) == 1
    assert default_reference(row, x_mm, y_mm, {2, 1}) == 3
    # One that was not felt is refused as a reference, with a sentence.
    row = replace(row, electrode=(*each[:4], replace(each[4], felt=False)))
    assert default_reference(row, x_mm, y_mm, range(4)) == 4


class MissingTheReference(SimulatedPerson):
    """Does not feel the reference alone at its level, so many times after so many other answers."""

    def __init__(self, skin: NoisySkin, at_ua: int, times: int, after: int = 0) -> None:
        super().__init__(skin.sense, 8)
        self._skin, self._at_ua, self._left, self._after = skin, at_ua, times, after
        self.missed = 0

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        self._after -= 1
        is_it = question.ask == "strength" and self._skin.presented[-1] == (5, self._at_ua)
        if is_it and self._after < 0 and self._left > 0:
            self._left, self.missed = self._left - 1, self.missed + 1
            return "not_felt"
        return super().answer(question, keep)


@pytest.mark.parametrize("after", [0, 60])
def test_a_reference_that_is_not_felt_any_more_is_refused(
    after: int, skin: NoisySkin, baseline: Calibration
) -> None:
    """In the beginning, and when it is gone up to again after eight electrodes."""
    person = MissingTheReference(skin, baseline.electrode[5].comfortable_ua, 2, after)
    with pytest.raises(Refused, match="electrode 5, is not felt any more") as refused:
        equalized(skin, baseline, person)
    assert refused.value.electrode == 5
    assert person.missed == 2


def test_one_miss_of_the_reference_is_asked_again(skin: NoisySkin, baseline: Calibration) -> None:
    person = MissingTheReference(skin, baseline.electrode[5].comfortable_ua, 1)
    progress, shown = equalized(skin, baseline, person)
    assert person.missed == 1
    assert progress.missing == ()
    begun = [at for at, one in enumerate(shown) if one.reference is None and one.current_ua
             == baseline.electrode[5].threshold_ua]  # fmt: skip
    assert len(begun) == 2, "before the first comparison, and after eight electrodes"
