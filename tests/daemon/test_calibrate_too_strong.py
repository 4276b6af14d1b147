"""What was too strong: kept at once, and in force for all that comes on that electrode."""

from __future__ import annotations

import itertools
import json
import random
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

import calibrate_scenes
from calibrate_scenes import BASELINE, EQUAL, REFERENCE, ROW, TODAY
from etd.calibrate.answers import ANSWERS, Answer, Question
from etd.calibrate.course import Course
from etd.calibrate.progress import Progress, finished, load_progress, save_progress
from etd.calibrate.reach import Reach
from etd.calibrate.stimulator import Delivered
from etd.calibrate.trial import Stopped
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.errors import FileError, Refused
from noisy_skin import NoisySkin

EACH = range(4)


class Says:
    """Answers in turn, and the last one for ever; looks at each question before it answers. What
    it called too strong it is sure of.
    """

    def __init__(
        self, answers: Iterable[Answer], look: Callable[[Question], None] = lambda _: None
    ) -> None:
        said = list(answers)
        self._answers = itertools.chain(said, itertools.repeat(said[-1]))
        self._look = look

    def answer(self, question: Question, _: Callable[[], None]) -> Answer:
        self._look(question)
        return "too_strong" if question.ask == "sure" else next(self._answers)

    def wants_stop(self) -> bool:
        return False


class Sittings(calibrate_scenes.Sittings):
    """Each until it is paused or over."""

    def sit(
        self,
        answers: Iterable[Answer],
        electrodes: Iterable[int] = EACH,
        look: Callable[[Question], None] = lambda _: None,
    ) -> list[tuple[int, int]]:
        """What was presented, by electrode and current."""
        before = len(self.skin.presented)
        course = self.course(Says(answers, look))
        try:
            course.run(tuple(electrodes))
        except Stopped:
            pass
        finally:
            self.left = course.left
        return self.skin.presented[before:]


def not_felt(times: int, *then: Answer) -> list[Answer]:
    misses: list[Answer] = ["not_felt"]
    return [*misses * times, *then]


def led_up() -> list[Answer]:
    """To the reference, from its threshold to what was comfortable."""
    return ["felt"] * 7


def test_what_was_too_strong_does_not_come_again_after_a_pause(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path)
    *_, (electrode, hurt_ua), _ = sittings.sit(not_felt(5, "too_strong", "pause"))
    assert electrode == 0
    again = sittings.sit(not_felt(20, "pause"), (0,))
    assert len(again) > 10
    assert max(current_ua for _, current_ua in again) < hurt_ua


def test_it_is_in_the_file_before_anything_else_is_presented(tmp_path: Path) -> None:
    sittings, in_file = Sittings(tmp_path), []

    def look(electrode: int, _: int) -> None:
        in_file.append(sittings.kept.lowered_ua if sittings.path.exists() else None)

    sittings.skin.meanwhile = look
    (_, hurt_ua), *_ = sittings.sit(["too_strong", "pause"])
    assert in_file == [{}, {0: int(hurt_ua / 1.1)}]


def test_an_electrode_that_did_not_settle_is_tried_again_below_it(tmp_path: Path) -> None:
    """A staircase never turns where everything is felt."""
    sittings = Sittings(tmp_path, replace(ROW, method="staircase"))
    first = sittings.sit(not_felt(4, "too_strong", "felt"), (0,))
    assert "no result after" in sittings.left[0]
    again = sittings.sit(not_felt(9, "pause"), (0,))
    assert max(again) < max(first) == first[4]


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), hurts=st.integers(1, 4))
def test_however_often_it_is_broken_off_nothing_as_strong_comes_again(
    seed: int, hurts: int
) -> None:
    """By somebody who answers by chance, so that electrodes are settled as well."""
    said: list[Answer] = random.Random(seed).choices(
        [*ANSWERS["strength"], "pause"], [8, 8, 2, hurts, 1], k=250
    )
    with tempfile.TemporaryDirectory() as folder:
        sittings, hurt_ua = Sittings(Path(folder)), dict[int, int]()
        left = [*said, "pause"]
        while left:
            count = left.index("pause") + 1
            heard, left = left[:count], left[count:]
            presented = sittings.sit(heard)
            for (electrode, current_ua), answer in zip(presented, heard, strict=False):
                assert current_ua < hurt_ua.get(electrode, 9_999)
                if answer == "too_strong":
                    hurt_ua[electrode] = current_ua
        found = sittings.kept.found if sittings.path.exists() else {}
        assert all(limits.cap_ua < hurt_ua.get(where, 9_999) for where, limits in found.items())


def test_what_is_left_out_gets_no_more_than_too_strong_has_left() -> None:
    found = ElectrodeLimits(threshold_ua=1_000, comfortable_ua=1_500, cap_ua=1_800)
    progress = Progress(conditions=ROW, found={0: found, 1: found}, lowered_ua={2: 300, 3: 1_200})
    made = finished(progress, TODAY, "test").electrode
    assert [(limits.cap_ua, limits.felt) for limits in made[2:]] == [(300, False), (1_000, False)]


def test_files_of_before_it_was_kept_are_read(tmp_path: Path) -> None:
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=ROW, presentations=7))
    content = json.loads(path.read_text())
    del content["lowered_ua"]
    path.write_text(json.dumps(content))
    assert load_progress(path, ROW) == Progress(conditions=ROW, presentations=7)


@pytest.mark.parametrize(
    ("lowered_ua", "said"),
    [
        ({4: 300}, "no such electrode: the array has 0 to 3"),
        ({0: 1_799}, "its cap of 1800 uA is above lowered_ua, 1799 uA"),
        ({1: -1}, "it is not a progress file"),
    ],
)
def test_a_file_that_does_not_hold_together_is_not_gone_on_with(
    tmp_path: Path, lowered_ua: dict[int, int], said: str
) -> None:
    path = tmp_path / "P01.json"
    found = ElectrodeLimits(threshold_ua=1_000, comfortable_ua=1_500, cap_ua=1_800)
    save_progress(path, Progress(conditions=ROW, found={0: found}, lowered_ua=lowered_ua))
    with pytest.raises(FileError, match=said):
        load_progress(path, ROW)


@pytest.mark.parametrize(("instead", "kept"), [("too_strong", {0: 181}), ("felt", {})])
def test_it_is_asked_again_whether_it_was_too_strong_and_kept_until_it_was_not(
    instead: Answer, kept: dict[int, int], tmp_path: Path
) -> None:
    """The first presentation is of 200 uA."""
    path, skin, asked = tmp_path / "P01.json", NoisySkin(4, 5), list[tuple[Question, object]]()
    answers: list[Answer] = ["too_strong", instead, "pause"]

    class Slips:
        def answer(self, question: Question, _: Callable[[], None]) -> Answer:
            saved = load_progress(path, ROW).lowered_ua if path.exists() else None
            asked.append((question, saved))
            return answers.pop(0)

        def wants_stop(self) -> bool:
            return False

    course = Course(
        Progress(conditions=ROW), skin, Slips(), lambda: TODAY,
        on_progress=lambda now: save_progress(path, now),
    )  # fmt: skip
    with pytest.raises(Stopped):
        course.run(EACH)
    assert asked[:2] == [(Question("strength", 0), {}), (Question("sure", 0), {0: 181})]
    assert load_progress(path, ROW).lowered_ua == kept
    assert len(skin.presented) == 2, "the second question is about the same presentation"


def test_what_was_lowered_stays_the_lowest_and_takes_back_what_was_found_above() -> None:
    found = ElectrodeLimits(threshold_ua=1_000, comfortable_ua=1_500, cap_ua=1_800)
    progress = Progress(conditions=ROW, found={0: found, 1: found})
    progress.lower(0, 1_800)
    progress.lower(1, 1_700)
    progress.lower(1, 1_750)
    assert progress.lowered_ua == {0: 1_800, 1: 1_700}
    assert list(progress.found) == [0]
    assert progress.troubled == (1,)


def test_a_reach_begins_below_what_was_too_strong_before() -> None:
    reach = Reach(3_000, 500, lowered_ua=400)
    assert (reach.most_ua, reach.cap_ua, reach.is_cap_felt) == (400, 400, True)
    assert not Reach(3_000, 500).is_cap_felt


# --- of two that were compared ---------------------------------------------------------------


def test_it_is_asked_which_of_two_was_too_strong_and_the_second_is_lowered(tmp_path: Path) -> None:
    sittings = Sittings(tmp_path, EQUAL)
    asked: list[Question] = []
    said: list[Answer] = [*led_up(), "weaker", "weaker", "too_strong", "second", "pause"]
    presented = sittings.sit(said, (0,), asked.append)
    compared = [ua for where, ua in presented if where == 0]
    assert asked[-2] == Question("which", 0, REFERENCE)
    assert compared == [1_000, 1_100, 1_210, 1_100]
    assert sittings.kept.lowered_ua == {0: 1_100}


def test_where_neither_was_too_strong_it_is_compared_again_and_nothing_is_lowered(
    tmp_path: Path,
) -> None:
    sittings = Sittings(tmp_path, EQUAL)
    asked: list[Question] = []
    said: list[Answer] = [*led_up(), "weaker", "too_strong", "neither", "weaker", "pause"]
    presented = sittings.sit(said, (0,), asked.append)
    assert [question.ask for question in asked[-4:]] == ["compare", "which", "compare", "compare"]
    assert [ua for where, ua in presented if where == 0] == [1_000, 1_100, 1_210]
    assert sittings.kept.lowered_ua == {}


def test_after_the_reference_in_the_second_place_the_first_is_the_electrode() -> None:
    """Each electrode is lowered, never the reference, wherever that came."""
    asked: list[Question] = []

    class Compares:
        def answer(self, question: Question, _: Callable[[], None]) -> Answer:
            if question.ask == "strength":
                return "felt"
            asked.append(question)
            if question.ask == "which":
                return "first" if question.is_reference_last else "second"
            return "too_strong" if len(asked) > 4 else "same"

        def wants_stop(self) -> bool:
            return False

    skin, progress = NoisySkin(4, 5), Progress(conditions=EQUAL, seed=3)
    Course(progress, skin, Compares(), lambda: TODAY, baseline=BASELINE).run(EACH)
    assert {one.is_reference_last for one in asked if one.ask == "which"} == {True, False}
    assert REFERENCE not in progress.lowered_ua
    assert set(progress.lowered_ua) == {0, 2, 3}


@pytest.mark.parametrize(
    ("which", "lowered_ua"),
    [("first", {REFERENCE: 1_545}), ("both", {0: 1_000, REFERENCE: 1_545})],
)
def test_a_reference_that_was_too_strong_ends_it_and_is_not_fired_again(
    tmp_path: Path, which: Answer, lowered_ua: dict[int, int]
) -> None:
    sittings = Sittings(tmp_path, EQUAL)
    with pytest.raises(Refused, match="the reference, electrode 1, is too strong"):
        sittings.sit([*led_up(), "weaker", "too_strong", which], (1, 0))
    assert sittings.kept.lowered_ua == lowered_ua
    assert sittings.kept.found == {}, "its cap of another day holds no more"

    with pytest.raises(Refused, match="the reference, electrode 1, is too strong"):
        sittings.sit(["felt"])
    assert sittings.skin.presented[-2:] == [(REFERENCE, 1_700), (0, 1_100)]


def test_a_reference_that_was_too_strong_on_the_way_up_is_not_gone_up_to_again(
    tmp_path: Path,
) -> None:
    sittings = Sittings(tmp_path, EQUAL)
    for _ in range(2):
        with pytest.raises(Refused, match="the reference, electrode 1, is too strong"):
            sittings.sit(["felt", "too_strong"])
    assert sittings.skin.presented == [(REFERENCE, 1_000), (REFERENCE, 1_100)]


@pytest.mark.parametrize("last", ["stop", "pause"])
def test_until_it_is_said_which_one_it_was_both_are_kept(tmp_path: Path, last: Answer) -> None:
    sittings = Sittings(tmp_path, EQUAL)
    in_file: list[dict[int, int]] = []

    def look(question: Question) -> None:
        if question.ask == "which":
            in_file.append(sittings.kept.lowered_ua)

    sittings.sit([*led_up(), "weaker", "too_strong", last], (0,), look)
    both = {0: 1_000, REFERENCE: 1_545}
    assert in_file == [both]
    assert sittings.kept.lowered_ua == both
    assert sittings.skin.stops == (last == "stop")


@pytest.mark.parametrize("resumes", [False, True])
def test_less_than_its_own_threshold_is_not_presented_and_told(
    tmp_path: Path, resumes: bool
) -> None:
    sittings = Sittings(tmp_path, EQUAL)
    said: list[Answer] = [*led_up(), "too_strong", "second"]
    presented = sittings.sit([*said, "pause"], (0, 2))
    assert [ua for where, ua in presented if where == 0] == [1_000]
    if resumes:
        assert not [ua for where, ua in sittings.sit([*led_up(), "pause"], (0, 2)) if where == 0]
    assert "below its threshold" in sittings.left[0]
    assert 0 in sittings.kept.troubled


@settings(max_examples=60, deadline=None)
@given(
    said=st.lists(
        st.tuples(
            st.sampled_from([*ANSWERS["compare"], "too_strong", "pause"]),
            st.sampled_from([*ANSWERS["which"], "second", "second", "pause", "same"]),
        ),
        max_size=60,
    )
)
def test_of_two_whatever_is_said_nothing_as_strong_as_what_hurt_comes_again(
    said: list[tuple[Answer, Answer]],
) -> None:
    """Ways up to the reference are all felt; `same` to `which` is none of its answers."""
    left, hurt = iter(said), dict[int, int]()

    class Compares:
        def __init__(self, skin: NoisySkin) -> None:
            self._skin, self._which, self.is_over = skin, "both", False

        def answer(self, question: Question, _: Callable[[], None]) -> Answer:
            if question.ask == "strength":
                return "felt"
            if question.ask == "compare":
                one = next(left, None)
                self.is_over = one is None
                answer, self._which = one or ("pause", "both")
                return answer
            which: Answer = self._which  # type: ignore[assignment]
            for electrode, current_ua in self._skin.presented[-2:]:
                other = "second" if electrode == question.reference else "first"
                if which not in (other, "neither"):
                    hurt[electrode] = min(current_ua, hurt.get(electrode, current_ua))
            return which

        def wants_stop(self) -> bool:
            return False

    class Skin(NoisySkin):
        def present(self, electrode: int, current_ua: int) -> Delivered:
            assert current_ua < hurt.get(electrode, 9_999)
            return super().present(electrode, current_ua)

    progress, skin = Progress(conditions=EQUAL), Skin(4, 5)
    compares = Compares(skin)
    while not compares.is_over:
        try:
            Course(progress, skin, compares, lambda: TODAY, baseline=BASELINE).run(EACH)
        except Stopped:
            continue
        except Refused:
            assert REFERENCE in hurt
        break
    for electrode, limits in progress.found.items():
        assert limits.cap_ua < hurt.get(electrode, 9_999)
        assert limits.cap_ua >= 1_000
