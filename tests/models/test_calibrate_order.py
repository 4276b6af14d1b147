"""The random order of electrodes, and the silent trials among the others."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from calibrate_scenes import FOUND, ROW
from etd.calibrate.answers import Answer, Presentation, Question
from etd.calibrate.course import MOST_DRIFT, Course
from etd.calibrate.order import CATCH_IN, IN_PLAY, drawn, is_catch, shuffled
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.progress import Progress, finished, load_progress, save_progress
from etd.calibrate.trial import Stopped
from etd.cli.false_alarms import said_of_false_alarms
from etd.files.calibration import load_calibration, to_toml
from etd.protocol.calibration import Method
from etd.protocol.errors import FileError
from noisy_skin import NoisySkin

TODAY = datetime.date(2025, 3, 4)
EACH = range(16)
CONDITIONS = replace(ROW, array="grid-4x4", electrodes=16, method="staircase")


class Person(SimulatedPerson):
    """Answers silence as told, and pauses at a given trial."""

    def __init__(self, skin: NoisySkin, silent: Answer = "not_felt", pause_at: int = -1) -> None:
        super().__init__(skin.sense, 7)
        self._skin = skin
        self._silent: Answer = silent
        self._left = pause_at

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        self._left -= 1
        if self._left == -1:
            return "pause"
        if self._skin.sense(question.electrode).strength == 0.0:
            return self._silent
        return super().answer(question, keep)


def sat(
    seed: int | None = 5, silent: Answer = "not_felt", skin: NoisySkin | None = None
) -> tuple[Progress, list[Presentation]]:
    progress, shown = Progress(conditions=CONDITIONS, seed=seed), list[Presentation]()
    skin = skin or NoisySkin(16, 31)
    person = Person(skin, silent)
    Course(progress, skin, person, lambda: TODAY, on_presented=shown.append).run(EACH)
    return progress, shown


@given(seed=st.integers(0, 2**31 - 1), block=st.integers(0, 500))
def test_one_trial_in_eight_is_silent(seed: int, block: int) -> None:
    trials = range(block * CATCH_IN, (block + 1) * CATCH_IN)
    assert sum(is_catch(seed, trial) for trial in trials) == 1


def test_the_silent_ones_are_at_places_that_nobody_can_know() -> None:
    places = [trial % CATCH_IN for trial in range(8_000) if is_catch(1, trial)]
    assert all(80 < places.count(place) < 180 for place in range(CATCH_IN))


@given(seed=st.integers(0, 2**31 - 1), wanted=st.sets(st.integers(0, 15)))
def test_the_order_is_the_same_whatever_of_it_is_left(seed: int, wanted: set[int]) -> None:
    whole = shuffled(seed, 16, EACH)
    assert sorted(whole) == list(EACH)
    assert shuffled(seed, 16, wanted) == [one for one in whole if one in wanted]


def test_without_a_seed_it_goes_on_as_before_there_was_one() -> None:
    assert shuffled(None, 16, EACH) == list(EACH)
    assert drawn(None, 3, {9, 4}) == 4
    progress, shown = sat(None)
    assert [one.electrode for one in shown] == sorted(one.electrode for one in shown)
    assert progress.catch_trials == 0
    made = finished(progress, TODAY, "test")
    assert (made.seed, made.catch_trials, made.false_alarm_rate) == (None, None, None)


def test_electrodes_take_turns_after_the_first_which_comes_alone() -> None:
    progress, shown = sat()
    order = [one.electrode for one in shown]
    alone = next(trial for trial, one in enumerate(order) if one != order[0])
    assert alone >= sum(one == order[0] for one in order) / 2, "it is asked again later"
    later = order[alone:]
    changes = sum(one != other for one, other in pairwise(later))
    assert changes > 0.6 * len(later)
    assert order[0] == shuffled(5, 16, EACH)[0]
    assert max(len(set(later[place : place + 8])) for place in range(len(later))) <= 2 * IN_PLAY
    assert progress.missing == ()
    assert sat()[1] == shown
    assert sat(6)[1] != shown


def test_catch_trials_are_silent_look_like_others_and_are_counted() -> None:
    skin = NoisySkin(16, 31)
    progress, shown = sat(skin=skin)
    silent = [one for one in shown if one.is_catch]
    assert progress.catch_trials == len(silent) == skin.silences
    assert len(shown) - len(silent) == len(skin.presented)
    assert progress.presentations // 8 <= len(silent) <= progress.presentations // 8 + 1
    assert {(one.current_ua, one.commanded_ua) for one in silent} == {(0, 0)}
    for trial, one in enumerate(shown):
        if one.is_catch:
            after = next(other for other in shown[trial:] if not other.is_catch
                         and other.electrode == one.electrode)  # fmt: skip
            assert one.stands_for_ua == after.current_ua


@pytest.mark.parametrize(("silent", "rate"), [("not_felt", 0.0), ("felt", 1.0), ("too_strong", 1)])
def test_what_is_felt_of_silence_is_a_false_alarm_and_lowers_nothing(
    silent: Answer, rate: float, tmp_path: Path
) -> None:
    progress, shown = sat(silent=silent)
    quiet, _ = sat()
    assert progress.found == quiet.found
    assert progress.lowered_ua == quiet.lowered_ua
    made = finished(progress, TODAY, "test")
    assert (made.seed, made.false_alarm_rate) == (5, rate)
    assert made.catch_trials == sum(one.is_catch for one in shown)
    path = tmp_path / "P01.toml"
    path.write_text(to_toml(made))
    assert load_calibration(path) == made
    assert (said_of_false_alarms(made) is None) == (rate == 0.0)


@pytest.mark.parametrize(
    ("rate", "said"), [(0.1, None), (0.11, "P01 felt 11% of 40 silent trials"), (None, None)]
)
def test_more_than_a_tenth_of_false_alarms_is_told(rate: float | None, said: str | None) -> None:
    made = finished(Progress(conditions=ROW, found={0: FOUND}), TODAY, "test")
    told = said_of_false_alarms(replace(made, catch_trials=40, false_alarm_rate=rate))
    assert told is None if said is None else said in (told or "")


@pytest.mark.parametrize("pause_at", [150, 260])
def test_an_interrupted_calibration_keeps_its_order(pause_at: int, tmp_path: Path) -> None:
    path, skin = tmp_path / "P01.json", NoisySkin(16, 31)
    before, after = list[Presentation](), list[Presentation]()

    def course(progress: Progress, person: Person, shown: list[Presentation]) -> Course:
        return Course(
            progress, skin, person, lambda: TODAY,
            on_progress=lambda now: save_progress(path, now), on_presented=shown.append,
        )  # fmt: skip

    begun = Progress(conditions=CONDITIONS, seed=5)
    with pytest.raises(Stopped):
        course(begun, Person(skin, pause_at=pause_at), before).run(EACH)
    kept = load_progress(path, CONDITIONS)
    assert kept.seed == 5
    done = set(kept.found)
    assert 0 < len(done) < 16
    course(kept, Person(skin), after).run(EACH)
    order = [one for one in shuffled(5, 16, EACH) if one not in done]
    assert list(dict.fromkeys(one.electrode for one in after if one.electrode in order[:4]))
    assert {one.electrode for one in after[:6]} <= set(order[:IN_PLAY])
    assert kept.catch_trials * CATCH_IN - CATCH_IN <= kept.presentations


def test_another_seed_does_not_go_on_with_it(tmp_path: Path) -> None:
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=ROW, seed=5))
    assert load_progress(path, ROW, 5).seed == 5
    with pytest.raises(FileError, match="the saved progress has 5, this calibration 6"):
        load_progress(path, ROW, 6)


def test_counts_that_cannot_be_are_refused_and_old_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=ROW, presentations=9, catch_trials=1, false_alarms=2))
    with pytest.raises(FileError, match="2 of 1 catch trials"):
        load_progress(path, ROW)
    save_progress(path, Progress(conditions=ROW, presentations=9))
    content = json.loads(path.read_text())
    for key in ("seed", "catch_trials", "false_alarms"):
        del content[key]
    path.write_text(json.dumps(content))
    assert load_progress(path, ROW) == Progress(conditions=ROW, presentations=9)


# --- what is asked besides ------------------------------------------------------------------------


class Asked(Person):
    """Says what it feels like, and keeps the questions."""

    def __init__(self, skin: NoisySkin, quality: Answer = "prickling") -> None:
        super().__init__(skin)
        self._quality: Answer = quality
        self.asked: list[Question] = []

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        self.asked.append(question)
        if question.ask == "quality":
            return self._quality
        if question.ask == "sure" and self.asked[-2].ask == "quality":
            self._quality = "vibration"
            return "too_strong"
        return "around" if question.ask == "place" else super().answer(question, keep)


def test_quality_and_place_are_asked_once_of_each_felt_electrode(tmp_path: Path) -> None:
    skin, progress = NoisySkin(16, 31), Progress(conditions=CONDITIONS, seed=5)
    person, shown = Asked(skin), list[Presentation]()
    Course(
        progress, skin, person, lambda: TODAY, asks_sensation=True, on_presented=shown.append
    ).run(EACH)
    qualities = [one.electrode for one in person.asked if one.ask == "quality"]
    assert sorted(qualities) == list(EACH)
    assert {(one.quality, one.place) for one in progress.found.values()} == {
        ("prickling", "around")
    }
    made = finished(progress, TODAY, "test")
    path = tmp_path / "P01.toml"
    path.write_text(to_toml(made))
    assert load_calibration(path) == made
    assert {(one.quality, one.place) for one in sat()[0].found.values()} == {(None, None)}


def test_a_comfortable_level_too_strong_when_it_is_asked_about_is_found_again_below() -> None:
    skin, progress = NoisySkin(16, 31), Progress(conditions=CONDITIONS, seed=5)
    first = shuffled(5, 16, EACH)[0]
    Course(progress, skin, Asked(skin, "too_strong"), lambda: TODAY, asks_sensation=True).run(EACH)
    assert progress.missing == ()
    assert progress.found[first].cap_ua <= progress.lowered_ua[first]
    assert progress.found[first].quality == "vibration"


def test_what_a_slip_or_a_pause_kept_from_being_asked_is_asked_all_the_same() -> None:
    """A slip at the first question about quality, a pause at the third one."""
    skin, progress = NoisySkin(16, 31), Progress(conditions=CONDITIONS, seed=5)
    asked: list[Question] = []

    class Slipping(Asked):
        def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
            asked.append(question)
            qualities = sum(one.ask == "quality" for one in asked)
            if question.ask == "quality" and qualities in (1, 4):
                return "too_strong" if qualities == 1 else "pause"
            return "comfortable" if question.ask == "sure" else super().answer(question, keep)

    def course() -> Course:
        return Course(progress, skin, Slipping(skin), lambda: TODAY, asks_sensation=True)

    with pytest.raises(Stopped):
        course().run(EACH)
    first = next(at for at, one in enumerate(asked) if one.ask == "quality")
    assert [one.ask for one in asked[first : first + 4]] == ["quality", "sure", "quality", "place"]
    paused = asked[-1].electrode
    assert progress.found[paused].quality is None
    course().run(EACH)
    assert progress.lowered_ua == {}
    assert {one.quality for one in progress.found.values()} == {"prickling"}
    of_paused = [one for one in asked if one.ask == "quality" and one.electrode == paused]
    assert len(of_paused) == 2
    assert len(progress.found) == 16


def told_drifts(
    progress: Progress, skin: NoisySkin, on_found: Callable[[int], None], electrodes: int
) -> list[tuple[float, bool]]:
    """Each drift that a whole course tells of, and whether it is at least so much."""
    drifts: list[tuple[float, bool]] = []
    Course(
        progress,
        skin,
        Person(skin),
        lambda: TODAY,
        on_found=on_found,
        on_drift=lambda *told: drifts.append(told),
    ).run(range(electrodes))
    return drifts


@pytest.mark.parametrize("times", [1.0, 1.5])
@pytest.mark.parametrize("electrodes", [2, 4, 5, 6, 8, 16])
def test_the_first_electrode_is_asked_again_and_a_rest_is_due_where_it_has_drifted(
    times: float, electrodes: int
) -> None:
    """After eight electrodes, or half of them."""
    skin = NoisySkin(16, 31)
    progress = Progress(conditions=replace(CONDITIONS, electrodes=electrodes), seed=5)
    found: dict[int, object] = {}

    def drift(_: int) -> None:
        if not found:
            found.update(progress.found)
            skin.threshold_ua = [times * value for value in skin.threshold_ua]
            skin.pain_ua = [5.0 * value for value in skin.pain_ua]

    skin.pain_ua = [5.0 * value for value in skin.pain_ua]
    drifts = told_drifts(progress, skin, drift, electrodes)
    assert progress.drift == pytest.approx(times - 1.0, abs=0.1)
    assert drifts == ([(progress.drift, False)] if times > 1.0 else [])
    (first,) = found
    assert progress.found[first] == found[first], "its figures stay"
    assert progress.missing == ()
    assert finished(progress, TODAY, "test").drift == progress.drift


def test_a_check_of_drift_that_a_pause_came_before_is_made_when_it_goes_on() -> None:
    skin = NoisySkin(16, 31)
    skin.pain_ua = [5.0 * value for value in skin.pain_ua]
    progress = Progress(conditions=replace(CONDITIONS, electrodes=8), seed=5)

    def pause(_: int) -> None:
        if len(progress.found) == 4:
            raise Stopped("pause")

    with pytest.raises(Stopped):
        told_drifts(progress, skin, pause, 8)
    at_the_pause = progress.drift
    assert at_the_pause is None
    skin.threshold_ua = [1.5 * value for value in skin.threshold_ua]
    (told,) = told_drifts(progress, skin, lambda _: None, 8)
    assert told == (progress.drift, False)
    assert told[0] > MOST_DRIFT
    told_drifts(progress, skin, lambda _: None, 8)
    assert progress.drift == told[0], "nothing is left for which it would matter"


@pytest.mark.parametrize("method", ["staircase", "limits"])
@pytest.mark.parametrize("capped_by", ["limit", "pain"])
def test_a_drift_that_ends_at_the_cap_is_at_least_so_much_and_a_rest_is_due(
    method: Method, capped_by: str
) -> None:
    """The cap is 12 % above the threshold, which rises by 60 %: nothing there is felt any more."""
    skin = NoisySkin(16, 31)
    skin.threshold_ua = [1_000.0] * 16
    skin.pain_ua = [1_120.0 if capped_by == "pain" else 9_000.0] * 16
    cap_ua = 1_120 if capped_by == "limit" else 4_000
    conditions = replace(CONDITIONS, electrodes=8, cap_ua=cap_ua, method=method)
    progress = Progress(conditions=conditions, seed=5)

    def drift(_: int) -> None:
        skin.threshold_ua, skin.pain_ua = [1_600.0] * 16, [9_000.0] * 16

    drifts = told_drifts(progress, skin, drift, 8)
    assert progress.drift is not None
    assert progress.drift < MOST_DRIFT, "as far as it can be seen"
    assert progress.is_drift_least
    assert drifts == [(progress.drift, True)]
    made = finished(progress, TODAY, "test")
    assert (made.drift, made.is_drift_least) == (progress.drift, True)
