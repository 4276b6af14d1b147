"""The trials of a calibration: each is told once, and is in a file before the next one begins."""

from __future__ import annotations

import csv
import datetime
import resource
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from calibrate_scenes import BASELINE, EQUAL, ROW, TODAY
from etd.calibrate.answers import Answer, Ask, Presentation, Question
from etd.calibrate.conditions import Conditions
from etd.calibrate.course import Course
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.progress import (
    Progress,
    check_progress_folder,
    load_progress,
    save_progress,
)
from etd.calibrate.trial import Stopped
from etd.cli.trials_file import COLUMNS, TrialsFile, new_trials_path
from etd.protocol.errors import FileError, Refused
from noisy_skin import NoisySkin

BEGUN = datetime.datetime(2025, 3, 4, 15, 6, 7, tzinfo=datetime.UTC)
WALL_NS = 1_741_100_000_000_000_000
Trial = tuple[Presentation, Ask, Answer | None]


class Says:
    """Answers in turn, then what comes last again and again; an exception is raised. The second is
    always too strong.
    """

    def __init__(self, answers: Iterable[Answer | Exception]) -> None:
        self._answers = list(answers)

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        if question.ask != "strength":
            return "too_strong" if question.ask == "compare" else "second"
        given = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        if isinstance(given, Exception):
            raise given
        return given

    def wants_stop(self) -> bool:
        return False


def told(
    answers: Iterable[Answer | Exception],
    conditions: Conditions = ROW,
) -> tuple[list[Trial], NoisySkin, Progress]:
    trials: list[Trial] = []
    skin, progress = NoisySkin(4, 5), Progress(conditions=conditions)

    def answered(presented: Presentation, ask: Ask, answer: Answer | None) -> None:
        trials.append((presented, ask, answer))

    baseline = BASELINE if conditions.reference is not None else None
    course = Course(
        progress,
        skin,
        Says(answers),
        lambda: TODAY,
        baseline=baseline,
        on_answered=answered,
    )
    try:
        course.run((0,))
    except (Stopped, Refused):
        pass
    return trials, skin, progress


# --- what is told ---------------------------------------------------------------------------------


def test_every_presentation_is_told_once_with_its_answer() -> None:
    skin, trials = NoisySkin(4, 5), []
    progress = Progress(conditions=ROW)
    person = SimulatedPerson(skin.sense, 1)
    Course(
        progress,
        skin,
        person,
        lambda: TODAY,
        on_answered=lambda shown, ask, answer: trials.append((shown, ask, answer)),
    ).run(range(4))
    once = [(shown, ask) for shown, ask, _ in trials if ask != "sure"]
    assert [(shown.electrode, shown.current_ua) for shown, _ in once] == skin.presented
    assert len(once) == progress.presentations
    assert {ask for _, ask in once} == {"strength"}
    assert None not in {answer for _, _, answer in trials}


def test_what_a_stop_or_a_pause_answers_is_told() -> None:
    for ending in ("stop", "pause"):
        trials, skin, _ = told(["not_felt", ending])
        assert [answer for _, _, answer in trials] == ["not_felt", ending]
        assert skin.stops == (ending == "stop")


def test_what_was_presented_and_is_not_answered_is_told_without_an_answer() -> None:
    trials, skin, _ = told(["not_felt", Refused("halted", "the wearer stopped it")])
    assert [answer for _, _, answer in trials] == ["not_felt", None]
    assert len(skin.presented) == 2


def test_a_comparison_names_what_it_was_compared_with_and_which_was_too_strong() -> None:
    trials, _, _ = told(["felt"], EQUAL)
    compared, which = trials[-2:]
    assert (compared[1], compared[2]) == ("compare", "too_strong")
    assert (which[1], which[2]) == ("which", "second")
    assert which[0] is compared[0], "it is another question about the same presentation"
    assert (compared[0].reference, compared[0].reference_ua) == (1, 1_700)


def test_a_stop_and_what_was_too_strong_come_before_a_trial_that_cannot_be_written() -> None:
    def full(_: Presentation, __: Ask, answer: Answer | None) -> None:
        if answer in ("too_strong", "stop"):
            raise FileError("trials", "", "the disk is full", "")

    skin, progress = NoisySkin(4, 5), Progress(conditions=ROW)
    for answer in ("too_strong", "stop"):
        course = Course(progress, skin, Says([answer]), lambda: TODAY, on_answered=full)
        with pytest.raises(FileError, match="disk is full"):
            course.run((0,))
    assert progress.lowered_ua[0] < 200
    assert skin.stops == 1


# --- the file -------------------------------------------------------------------------------------


class Clock:
    now_ns = 5_000_000_000


def trials_file(path: Path, clock: Clock) -> TrialsFile:
    return TrialsFile(path, ROW, lambda: clock.now_ns, lambda: WALL_NS)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


@contextmanager
def no_room() -> Iterator[None]:
    """For more in any file: what is written fails, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_trial_that_finds_no_room_is_told_and_the_end_of_the_file_says_nothing_else(
    tmp_path: Path,
) -> None:
    path, clock = tmp_path / "trials.tsv", Clock()
    file = trials_file(path, clock)
    presented = Presentation(3, 700, 700, begun_ns=clock.now_ns)
    file.answered(presented, "strength", "not_felt")
    with no_room():
        with pytest.raises(FileError, match=r"the trial could not be written .* then continue it"):
            file.answered(presented, "strength", "felt")
        file.close()
    assert file.name == str(path)


def test_a_folder_that_takes_no_results_is_told_before_anybody_is_asked(tmp_path: Path) -> None:
    progress = Progress(conditions=ROW, seed=1)
    nowhere = Path("/proc/none/P01.json")
    with pytest.raises(FileError, match="could not be saved"):
        check_progress_folder(nowhere)
    with pytest.raises(FileError, match="it keeps what was saved before"):
        save_progress(nowhere, progress)
    path = tmp_path / "new" / "P01.json"
    check_progress_folder(path)
    assert list(path.parent.iterdir()) == []
    save_progress(path, progress)
    with no_room(), pytest.raises(FileError, match="could not be saved"):
        save_progress(path, progress)
    assert load_progress(path, ROW) == progress


def test_of_two_that_begin_in_one_second_each_has_its_own_file(tmp_path: Path) -> None:
    """Both chose their name before either had a trial."""
    clock, names = Clock(), []
    path = new_trials_path(tmp_path, "P01", "pad-8", BEGUN)
    both = [trials_file(path, clock), trials_file(path, clock), trials_file(path, clock)]
    for file in both:
        file.answered(Presentation(0, 200, 198, clock.now_ns), "strength", "felt")
        file.close()
        assert file.name is not None
        names.append(Path(file.name))
    stem = path.name.removesuffix("_trials.tsv")
    assert [name.name for name in names] == [
        path.name, f"{stem}-2_trials.tsv", f"{stem}-3_trials.tsv"
    ]  # fmt: skip
    assert [len(rows(name)) for name in names] == [1, 1, 1]


def test_what_is_saved_is_of_its_board_and_finger(tmp_path: Path) -> None:
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=ROW, seed=1, made_on="one, finger tender:7"))
    assert load_progress(path, ROW, made_on="one, finger tender:7").seed == 1
    for other in ("one", "two, finger tender:7"):
        with pytest.raises(FileError, match=f"is of one, finger tender:7, this board is {other}"):
            load_progress(path, ROW, made_on=other)


def test_what_does_not_say_of_which_board_it_is_goes_on_with_none(tmp_path: Path) -> None:
    """It may be of a fake one."""
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=ROW, seed=1))
    with pytest.raises(FileError, match="a board that it does not name, this board is one"):
        load_progress(path, ROW, made_on="one")
    assert load_progress(path, ROW).made_on is None


def test_a_train_that_was_slower_than_asked_for_is_in_the_file_as_it_was(tmp_path: Path) -> None:
    path, clock = tmp_path / "trials.tsv", Clock()
    presented = Presentation(3, 850, 848, begun_ns=0, is_whole=True, rate_hz=47.4)
    file = trials_file(path, clock)
    file.answered(presented, "whole", "felt")
    file.close()
    (row,) = rows(path)
    assert (row["rate_hz"], row["duration"]) == ("47.4", "0.211")


def test_each_trial_is_in_the_file_before_the_next(tmp_path: Path) -> None:
    path, clock = tmp_path / "trials.tsv", Clock()
    file = trials_file(path, clock)
    assert file.name is None, "there was no trial, so there is no file"
    assert not path.exists()
    presented = Presentation(3, 850, 848, begun_ns=5_000_000_000, resistance_ohm=52_000)
    clock.now_ns = 5_750_000_000
    file.answered(presented, "strength", "felt")
    assert file.name == str(path)
    (row,) = rows(path)
    assert list(row) == list(COLUMNS)
    assert row == {
        "onset": "0.000",
        "duration": "0.167",
        "time": row["time"],
        "trial": "1",
        "electrode": "3",
        "current_ua": "850",
        "commanded_ua": "848",
        "reference": "n/a",
        "reference_ua": "n/a",
        "reference_place": "n/a",
        "question": "strength",
        "answer": "felt",
        "response_time": "0.750",
        "resistance_ohm": "52000",
        "method": "limits",
        "width_us": "100",
        "rate_hz": "60",
        "pulses": "10",
        "polarity": "anodic",
    }
    at = datetime.datetime.fromisoformat(row["time"])
    assert at.utcoffset() is not None
    assert at.timestamp() == pytest.approx((5_000_000_000 + WALL_NS) / 1e9, abs=0.001)

    compared = Presentation(2, 900, 899, begun_ns=7_500_000_000, reference=1, reference_ua=700)
    file.answered(compared, "compare", "too_strong")
    file.answered(compared, "which", None)
    _, second, third = rows(path)
    assert (second["onset"], second["reference"], second["reference_ua"]) == ("2.500", "1", "700")
    assert (second["trial"], third["trial"]) == ("2", "2")
    assert (third["answer"], third["response_time"]) == ("n/a", "n/a")
    file.close()


def test_a_trial_that_cannot_be_written_says_where(tmp_path: Path) -> None:
    path = tmp_path / "gone" / "trials.tsv"
    with pytest.raises(FileError, match="could not be written") as caught:
        trials_file(path, Clock()).answered(Presentation(3, 850, 848, 0), "strength", "felt")
    assert caught.value.file == str(path)


def test_a_file_that_appeared_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "trials.tsv"
    file = trials_file(path, Clock())
    path.write_text("mine")
    with pytest.raises(FileError):
        file.answered(Presentation(3, 850, 848, 0), "strength", "felt")
    assert path.read_text() == "mine"


def test_the_name_says_person_array_and_time_and_is_a_new_one(tmp_path: Path) -> None:
    first = new_trials_path(tmp_path, "P01", "pad-8", BEGUN)
    assert first == tmp_path / "P01_pad-8_20250304-150607_trials.tsv"
    first.write_text("mine")
    again = new_trials_path(tmp_path, "P01", "pad-8", BEGUN)
    assert again.name == "P01_pad-8_20250304-150607-2_trials.tsv"
    odd = new_trials_path(tmp_path, "P01", "../my array", BEGUN)
    assert (odd.parent, odd.name) == (tmp_path, "P01_..-my-array_20250304-150607_trials.tsv")


def test_a_name_that_is_given_is_used_and_must_be_new(tmp_path: Path) -> None:
    given = tmp_path / "mine.tsv"
    assert new_trials_path(tmp_path, "P01", "pad-8", BEGUN, given) == given
    given.write_text("mine")
    with pytest.raises(FileError, match="is not overwritten"):
        new_trials_path(tmp_path, "P01", "pad-8", BEGUN, given)
