"""All electrodes at once, in the end: up to level 1, and what is too strong takes all down."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path

import pytest
from msgspec.structs import replace

from calibrate_scenes import ROW
from etd.calibrate.answers import Answer, Presentation, Question
from etd.calibrate.course import Course
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.progress import Progress, finished, load_progress, save_progress
from etd.calibrate.trial import Stopped, Unsettled
from etd.files.calibration import load_calibration, to_toml
from etd.protocol.calibration import ElectrodeLimits, current_of_felt
from etd.protocol.errors import FileError, Refused
from noisy_skin import NoisySkin

TODAY = datetime.date(2025, 3, 4)
FOUND = ElectrodeLimits(threshold_ua=300, comfortable_ua=1_500, cap_ua=1_800)
#: Half of its comfortable level is below its threshold, and half of its cap as well.
NEAR = replace(FOUND, threshold_ua=1_000)


class Says:
    """Answers in turn, then the last one; sure of what was too strong."""

    def __init__(self, answers: Iterable[Answer]) -> None:
        self._answers = list(answers)

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        if question.ask == "sure":
            return "too_strong"
        return self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]

    def wants_stop(self) -> bool:
        return False


def whole(
    tmp_path: Path, answers: Iterable[Answer], last: ElectrodeLimits = FOUND
) -> tuple[NoisySkin, Progress]:
    """Three felt electrodes and one that is not; what is in the file in the end."""
    path, skin = tmp_path / "P01.json", NoisySkin(4, 5)
    progress = Progress(
        conditions=ROW, found={0: FOUND, 1: FOUND, 2: replace(FOUND, felt=False), 3: last}
    )
    course = Course(
        progress, skin, Says(answers), lambda: TODAY,
        on_progress=lambda now: save_progress(path, now),
    )  # fmt: skip
    try:
        course.feel_whole()
    except Stopped:
        pass
    kept = load_progress(path, ROW)
    assert (kept.found, kept.is_whole_accepted) == (progress.found, progress.is_whole_accepted)
    return skin, kept


def test_each_is_told_of_with_the_rate_that_it_was_shown_at() -> None:
    told: list[Presentation] = []
    progress = Progress(conditions=ROW, found=dict.fromkeys(range(4), FOUND))
    course = Course(
        progress, NoisySkin(4, 5), Says(["felt"]), lambda: TODAY, on_presented=told.append
    )
    course.feel_whole()
    assert {(one.is_whole, one.rate_hz) for one in told} == {(True, 47.4)}


def test_all_felt_electrodes_come_together_by_tenths_up_to_level_1(tmp_path: Path) -> None:
    skin, kept = whole(tmp_path, ["felt"])
    currents = [each[0] for each in skin.wholes]
    assert (currents[0], currents[-1]) == (750, 1_500)
    assert all(after <= 1.1 * before + 1 for before, after in pairwise(currents))
    assert all(set(each) == {0, 1, 3} and len(set(each.values())) == 1 for each in skin.wholes)
    assert kept.found[0] == FOUND
    assert kept.is_whole_accepted
    assert finished(kept, TODAY, "test").is_whole_accepted


def test_too_strong_together_takes_all_down_to_the_step_before(tmp_path: Path) -> None:
    skin, kept = whole(tmp_path, ["felt", "felt", "felt", "too_strong"])
    third, last = skin.wholes[2][0], skin.wholes[3][0]
    assert len(skin.wholes) == 4
    assert third - 2 <= kept.found[0].comfortable_ua <= third < last
    assert kept.found[0].cap_ua < last * 1.1
    assert kept.found[0] == kept.found[1] == kept.found[3]
    assert kept.found[2].cap_ua == 1_800, "it was not felt, and not presented"
    assert kept.is_whole_accepted
    assert kept.lowered_ua == {}, "none of them was too strong alone"


def test_where_the_first_step_is_too_strong_it_begins_again_below(tmp_path: Path) -> None:
    skin, kept = whole(tmp_path, ["too_strong", "felt"])
    currents = [each[0] for each in skin.wholes]
    assert currents[:2] == [750, 340]
    assert currents[-1] == kept.found[0].comfortable_ua == 681
    assert kept.is_whole_accepted


@pytest.mark.parametrize("last", ["stop", "pause"])
def test_what_was_too_strong_together_is_kept_though_it_is_broken_off(
    tmp_path: Path, last: Answer
) -> None:
    skin, kept = whole(tmp_path, ["too_strong", last])
    assert kept.found[0].comfortable_ua == 681
    assert not kept.is_whole_accepted
    assert finished(kept, TODAY, "test").is_whole_accepted is None
    assert skin.stops == (last == "stop")


def test_all_of_it_is_not_presented_where_it_was_accepted_or_one_alone_is_felt() -> None:
    skin = NoisySkin(4, 5)
    for progress in (
        Progress(conditions=ROW, found={0: FOUND, 1: FOUND}, is_whole_accepted=True),
        Progress(conditions=ROW, found={0: FOUND, 1: replace(FOUND, felt=False)}),
    ):
        Course(progress, skin, Says(["felt"]), lambda: TODAY).feel_whole()
    assert skin.wholes == []


def test_where_it_never_stops_being_too_strong_it_is_given_up_or_nothing_is_left() -> None:
    skin, progress = NoisySkin(4, 5), Progress(conditions=ROW, found={0: FOUND, 1: FOUND})
    try:
        Course(progress, skin, Says(["too_strong"]), lambda: TODAY).feel_whole()
    except Unsettled:
        pass
    assert not progress.is_whole_accepted
    assert not progress.level_1_ua
    assert not progress.found[0].felt
    assert progress.found[0].felt_from_ua == FOUND.threshold_ua


def test_an_electrode_whose_cap_falls_below_its_threshold_is_not_felt_within_its_cap(
    tmp_path: Path,
) -> None:
    """And the file says from which current on it was."""
    skin, kept = whole(tmp_path, ["too_strong", "felt"], NEAR)
    limits = kept.found[3]
    assert not limits.felt
    assert limits.felt_from_ua == 1_000
    assert limits.threshold_ua == limits.comfortable_ua == limits.cap_ua == 818
    assert 3 not in skin.wholes[-1]
    assert kept.is_whole_accepted
    made = finished(kept, TODAY, "test")
    path = tmp_path / "P01.toml"
    path.write_text(to_toml(made), encoding="utf-8")
    assert load_calibration(path).electrode[3].felt_from_ua == 1_000
    with pytest.raises(Refused, match=r"felt from 1000 uA on.*cap of 818 uA"):
        current_of_felt(made, 3, 0.5)


def test_a_level_that_stays_at_its_threshold_is_presented_again_with_the_rest(
    tmp_path: Path,
) -> None:
    """It is not a step below what was too strong: nobody has accepted it with all others."""
    low = replace(NEAR, threshold_ua=1_400, cap_ua=2_400)
    skin, kept = whole(tmp_path, ["felt", "felt", "felt", "too_strong", "felt"], low)
    assert kept.found[3].threshold_ua == kept.found[3].comfortable_ua == 1_400
    assert kept.found[3].felt
    assert kept.is_whole_accepted
    assert skin.wholes[-1] == kept.level_1_ua
    assert len(skin.wholes) > 4


def test_what_was_accepted_before_it_was_too_strong_counts_for_no_later_pass(
    tmp_path: Path,
) -> None:
    """A level that stays at its threshold makes it begin again; the first step of that is too
    strong, as the skin is more sensitive by then.
    """
    low = replace(NEAR, threshold_ua=1_400, cap_ua=2_400)
    said: list[Answer] = ["felt", "felt", "felt", "too_strong", "too_strong", "felt"]
    skin, kept = whole(tmp_path, said, low)
    assert skin.wholes[4][0] == 453, "half of what the first pass had left of 1500 uA"
    assert kept.is_whole_accepted
    assert skin.wholes[-1] == kept.level_1_ua
    assert len(skin.wholes) > 5, "it is presented after that"


def test_all_together_are_accepted_anew_with_an_electrode_that_was_found_after_it() -> None:
    skin = NoisySkin(4, 11)
    progress = Progress(
        conditions=ROW, found={0: FOUND, 1: FOUND, 2: FOUND}, is_whole_accepted=True
    )
    Course(progress, skin, SimulatedPerson(skin.sense, 11), lambda: TODAY).run([3])
    assert progress.found[3].felt
    assert not progress.is_whole_accepted


def test_all_together_too_strong_at_every_level_is_told_as_that() -> None:
    """Where touch has adapted and pain has not, nothing may be left of any level."""
    progress = Progress(conditions=replace(ROW, electrodes=2), found={0: FOUND, 1: NEAR})
    while progress.level_1_ua:
        progress.take_down(1.1)
    assert set(progress.below_threshold) == {0, 1}
    with pytest.raises(FileError, match=r"something was too strong down to below .* --restart"):
        finished(progress, TODAY, "test")
