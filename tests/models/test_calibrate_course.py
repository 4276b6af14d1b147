"""Whole calibrations of a simulated person: what is found, what was presented, how it goes on."""

from __future__ import annotations

import datetime
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd.calibrate.answers import Answer, Question
from etd.calibrate.conditions import Conditions, check_conditions, check_laws, identity
from etd.calibrate.course import Course
from etd.calibrate.person import ResponseModel, SimulatedPerson
from etd.calibrate.progress import Progress, finished, load_progress, save_progress
from etd.calibrate.reach import RISE, Reach
from etd.calibrate.staircase import staircase
from etd.calibrate.stimulator import Delivered, NotDelivered
from etd.calibrate.trial import Stopped, run
from etd.protocol.calibration import Calibration, ElectrodeLimits, Method, check_order
from etd.protocol.errors import FileError, PackageMissing, Refused
from etd.pulse.request import PulseRequest
from etd.stabilize.bursts import Bursts
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.shape import Shape
from etd.stabilize.strength_duration import StrengthDuration
from noisy_skin import NoisySkin, resistance_ohm

BURSTS = Bursts(pulses=6, rate_hz=350.0)
TODAY = datetime.date(2025, 3, 4)
NEXT_DAY = datetime.date(2025, 3, 5)


def conditions(method: Method = "limits", electrodes: int = 64, **changes: Any) -> Conditions:
    made = Conditions(
        participant="P01",
        method=method,
        body_site="fingertip",
        array="grid-8x8",
        electrodes=electrodes,
        polarity="anodic",
        width_us=100,
        rate_hz=60.0,
        returns="all",
        pulses=10,
        cap_ua=4_000,
    )
    return msgspec.structs.replace(made, **changes)


def calibrated(
    skin: NoisySkin,
    method: Method = "limits",
    baseline: Calibration | None = None,
    today: datetime.date = TODAY,
    **changes: Any,
) -> tuple[Progress, Calibration]:
    progress = Progress(conditions=conditions(method, skin.electrodes, **changes))
    person = SimulatedPerson(skin.sense, skin.seed)
    Course(progress, skin, person, lambda: today, baseline=baseline).run(range(skin.electrodes))
    return progress, finished(progress, today, "test")


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("method", ["limits", "staircase"])
def test_64_thresholds_are_found_within_a_tenth_and_nothing_hurts(
    method: Method, seed: int
) -> None:
    skin = NoisySkin(64, seed)
    progress, made = calibrated(skin, method)

    worst = max(
        skin.error(electrode, made.electrode[electrode].threshold_ua) for electrode in range(64)
    )
    print(f"{method}, seed {seed}: {progress.presentations} presentations, worst {worst:.1%}")
    assert worst <= 0.10
    assert skin.most_of_pain() < 1.0
    # A lapse may have called the threshold of one too strong, where pain is near.
    lost = [one for one, limits in enumerate(made.electrode) if not limits.felt]
    assert [skin.pain_ua[one] < 1.5 * skin.threshold_ua[one] for one in lost] in ([], [True])
    check_order(made, "made")


def test_quest_plus_finds_them_too() -> None:
    skin = NoisySkin(8, 14)
    _, made = calibrated(skin, "quest-plus")
    assert (
        max(skin.error(electrode, made.electrode[electrode].threshold_ua) for electrode in range(8))
        <= 0.10
    )
    assert skin.most_of_pain() < 1.0


@pytest.mark.parametrize("of_cap", [0.94, 1.15])
def test_quest_plus_does_not_take_one_miss_at_the_cap_for_the_end_of_feeling(of_cap: float) -> None:
    skin = NoisySkin(6, 26)
    skin.threshold_ua = [of_cap * 4_000.0] * 6
    skin.pain_ua = [99_000.0] * 6
    progress = Progress(conditions=conditions("quest-plus", 6))
    found = Course(
        progress, skin, SimulatedPerson(skin.sense, 5, ResponseModel(lapses=0.0)), lambda: TODAY
    ).run(range(6))
    assert [limits.felt for limits in found.found.values()] == [of_cap < 1.0] * 6


@pytest.mark.parametrize(("misses", "felt"), [(1, True), (40, False)])
def test_a_staircase_takes_no_single_miss_at_the_cap_for_the_end_of_feeling(
    misses: int, felt: bool
) -> None:
    """At the cap it is felt on the way up, then missed so many times, then felt again."""
    places = iter(range(100))

    def present(current_ua: int) -> Answer:
        is_missed = current_ua < 4_000 or 1 <= next(places) <= misses
        return "not_felt" if is_missed else "felt"

    found = run(staircase(3_800), Reach(4_000, 3_800), present)
    assert found.is_felt is felt


def test_caps_were_all_presented_and_levels_are_comfortable() -> None:
    skin = NoisySkin(16, 15)
    _, made = calibrated(skin)
    for electrode, limits in enumerate(made.electrode):
        presented = {ua for where, ua in skin.presented if where == electrode}
        assert limits.cap_ua in presented
        assert limits.cap_ua >= max(presented) / 1.11, "only what was too strong lies above"
        assert limits.resistance_ohm == resistance_ohm(limits.comfortable_ua)


def test_without_questplus_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "questplus", None)
    with pytest.raises(PackageMissing, match=r"python\S* -m pip install 'etd\[quest-plus\]'$"):
        calibrated(NoisySkin(2, 1), "quest-plus")


def test_an_electrode_that_is_not_felt_up_to_the_cap_is_a_bound_and_no_threshold() -> None:
    skin = NoisySkin(3, 16)
    skin.threshold_ua[1] = 50_000.0
    skin.pain_ua[1] = 99_000.0
    progress = Progress(conditions=conditions("limits", 3))
    calm = SimulatedPerson(skin.sense, 1, ResponseModel(lapses=0.0))
    found = Course(progress, skin, calm, lambda: TODAY).run(range(3)).found
    assert [limits.felt for limits in found.values()] == [True, False, True]
    assert found[1].threshold_ua == found[1].cap_ua == 4_000
    assert max(ua for where, ua in skin.presented if where == 1) == 4_000


@pytest.mark.parametrize("median_ua", [1_100.0, 300.0])
def test_each_electrode_begins_below_the_least_threshold_and_rises_by_tenths(
    median_ua: float,
) -> None:
    skin = NoisySkin(8, 17, median_ua=median_ua)
    progress, _ = calibrated(skin)
    for electrode in range(8):
        presented = [ua for where, ua in skin.presented if where == electrode]
        earlier = [progress.found[other].threshold_ua for other in range(electrode)]
        assert presented[0] <= min(earlier, default=400) / 2
        most = presented[0]
        for current_ua in presented[1:]:
            assert current_ua <= most * RISE + 1
            most = max(most, current_ua)


def test_an_earlier_calibration_makes_it_shorter() -> None:
    first, made = calibrated(NoisySkin(16, 18))
    again, _ = calibrated(NoisySkin(16, 18), baseline=made)
    assert again.presentations < 0.85 * first.presentations


def test_equal_strength_is_found_by_comparing_with_a_reference() -> None:
    skin = NoisySkin(16, 19)
    skin.pain_ua = [4.0 * value for value in skin.threshold_ua]
    _, made = calibrated(skin)
    before = len(skin.presented)
    _, equal = calibrated(skin, "equalize", made, NEXT_DAY, reference=5)

    strong = [
        limits.comfortable_ua / skin.threshold_ua[where]
        for where, limits in enumerate(equal.electrode)
    ]
    reached = [
        where
        for where, limits in enumerate(equal.electrode)
        if limits.comfortable_ua < limits.cap_ua
    ]
    assert len(reached) >= 12
    assert max(abs(strong[electrode] / strong[5] - 1.0) for electrode in reached) <= 0.10
    for where, current_ua in skin.presented[before:]:
        assert current_ua <= made.electrode[where].cap_ua
    assert equal.electrode[5].comfortable_ua == made.electrode[5].comfortable_ua


def test_equal_strength_says_which_figures_are_of_the_day_before() -> None:
    """The reference's are taken over; the others' thresholds and caps are, and were not asked."""
    skin = NoisySkin(3, 19)
    _, made = calibrated(skin)
    _, equal = calibrated(skin, "equalize", made, NEXT_DAY, reference=1)
    days = [(limits.date, limits.threshold_date) for limits in equal.electrode]
    assert equal.date == NEXT_DAY
    assert days == [(None, TODAY), (TODAY, None), (None, TODAY)]

    _, third = calibrated(skin, "equalize", equal, datetime.date(2025, 3, 6), reference=0)
    assert third.electrode[0].date == NEXT_DAY, "the reference is as it was matched then"
    assert [limits.threshold_date for limits in third.electrode] == [TODAY, TODAY, TODAY]


def test_what_was_not_felt_is_no_reference() -> None:
    skin = NoisySkin(3, 16)
    _, made = calibrated(skin)
    numb = msgspec.structs.replace(made.electrode[1], felt=False)
    made = msgspec.structs.replace(made, electrode=(made.electrode[0], numb, made.electrode[2]))
    before = len(skin.presented)
    for reference in (1, 3):
        with pytest.raises(Refused, match=f"electrode {reference} was not felt in the baseline"):
            calibrated(skin, "equalize", made, reference=reference)
    assert len(skin.presented) == before


def test_what_goes_on_on_another_day_says_so() -> None:
    skin = NoisySkin(3, 20)
    progress = Progress(conditions=conditions("limits", 3))
    person = SimulatedPerson(skin.sense, 1)
    Course(progress, skin, person, lambda: TODAY).run((0, 2))
    Course(progress, skin, person, lambda: NEXT_DAY).run(range(3))
    made = finished(progress, NEXT_DAY, "test")
    assert [limits.date for limits in made.electrode] == [TODAY, None, TODAY]


def test_the_reference_is_gone_up_to_and_refused_where_it_is_too_strong_today() -> None:
    skin = NoisySkin(4, 24)
    _, made = calibrated(skin)
    before = len(skin.presented)
    skin.pain_ua[1] = 1.05 * made.electrode[1].threshold_ua

    with pytest.raises(Refused, match="is too strong"):
        calibrated(skin, "equalize", made, reference=1)
    assert skin.presented[before:] == [(1, made.electrode[1].threshold_ua)]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"participant": "P02"}, "participant P02, this calibration P01"),
        ({"width_us": 50}, "width_us 50, this calibration 100"),
        ({"polarity": "cathodic"}, "polarity cathodic"),
        ({"shape": Shape(bursts=BURSTS)}, "shape bursts of 6 at 350 Hz"),
        ({"electrode": ()}, "0 electrodes, this array has 2"),
    ],
)
def test_a_baseline_of_somebody_else_or_of_other_pulses_is_refused(
    changes: dict[str, Any], said: str
) -> None:
    skin = NoisySkin(2, 23)
    _, made = calibrated(skin)
    before = len(skin.presented)
    with pytest.raises(Refused, match=said):
        calibrated(skin, baseline=msgspec.structs.replace(made, **changes))
    assert len(skin.presented) == before


def test_equal_strength_without_a_baseline_is_refused() -> None:
    with pytest.raises(Refused, match="--baseline"):
        calibrated(NoisySkin(2, 1), "equalize")


class Scripted:
    """Answers as another, until it says something else."""

    def __init__(self, other: SimulatedPerson, after: int, last: Answer) -> None:
        self._other = other
        self._left = after
        self._last: Answer = last

    def answer(self, question: Question, keep: Callable[[], None]) -> Answer:
        self._left -= 1
        return self._other.answer(question, keep) if self._left >= 0 else self._last

    def wants_stop(self) -> bool:
        return False


@pytest.mark.parametrize(("last", "stops"), [("stop", 1), ("pause", 0)])
def test_stopped_in_the_middle_it_goes_on_with_what_is_missing(
    tmp_path: Path, last: Answer, stops: int
) -> None:
    path, skin = tmp_path / "deep" / "P01.json", NoisySkin(4, 20)
    person = SimulatedPerson(skin.sense, 1)
    with pytest.raises(Stopped):
        Course(
            Progress(conditions=conditions("limits", 4)),
            skin,
            Scripted(person, 120, last),
            lambda: TODAY,
            on_progress=lambda progress: save_progress(path, progress),
        ).run(range(4))
    assert skin.stops == stops

    kept = load_progress(path, conditions("limits", 4))
    assert 0 < len(kept.found) < 4
    done, before = dict(kept.found), len(skin.presented)
    Course(kept, skin, person, lambda: TODAY).run(range(4))
    assert not {where for where, _ in skin.presented[before:]} & set(done)
    assert {electrode: kept.found[electrode] for electrode in done} == done
    assert kept.missing == ()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"width_us": 50}, "conditions.width_us"),
        ({"cap_ua": 5_000}, "conditions.cap_ua"),
        ({"participant": "P02"}, "conditions.participant"),
        ({"shape": Shape(bursts=BURSTS)}, "conditions.shape"),
        ({"reference": 7}, "conditions.reference"),
        ({"baseline": "P01 of 2025-03-04 (0123abcd)"}, "conditions.baseline"),
    ],
)
def test_other_conditions_do_not_go_on_with_it(
    tmp_path: Path, changes: dict[str, Any], key: str
) -> None:
    path = tmp_path / "P01.json"
    save_progress(path, Progress(conditions=conditions()))
    with pytest.raises(FileError) as refused:
        load_progress(path, conditions(**changes))
    assert refused.value.key == key


def test_baselines_of_one_name_and_day_are_told_apart() -> None:
    _, made = calibrated(NoisySkin(2, 20))
    other = msgspec.structs.replace(made, electrode=made.electrode[::-1])
    assert identity("P01", made) == identity("P01", msgspec.structs.replace(made))
    assert identity("P01", made).startswith("P01 of 2025-03-04 (")
    assert len({identity("P01", made), identity("P02", made), identity("P01", other)}) == 3


@pytest.mark.parametrize(
    ("electrode", "figures", "said"),
    [
        (63, (1_000, 2_000, 4_001, 50_000), "its cap of 4001 uA is above 4000 uA"),
        (64, (1_000, 2_000, 3_000, 50_000), "no such electrode: the array has 0 to 63"),
        (-1, (1_000, 2_000, 3_000, 50_000), "no such electrode"),
        (5, (2_001, 2_000, 3_000, 50_000), "do not rise"),
        (5, (1_000, 3_001, 3_000, 50_000), "do not rise"),
        (5, (1_000, 2_000, 3_000, 1), "1 ohm is out of the range of skin"),
    ],
)
def test_what_cannot_have_been_found_is_not_gone_on_with(
    tmp_path: Path, electrode: int, figures: tuple[int, int, int, int], said: str
) -> None:
    keys = ("threshold_ua", "comfortable_ua", "cap_ua", "resistance_ohm")
    found = msgspec.convert(dict(zip(keys, figures, strict=True)), ElectrodeLimits)
    save_progress(
        tmp_path / "P01.json", Progress(conditions=conditions(), found={electrode: found})
    )
    with pytest.raises(FileError, match=said) as refused:
        load_progress(tmp_path / "P01.json", conditions())
    assert refused.value.key == f"found.{electrode}"


def test_a_progress_file_that_is_none_is_told(tmp_path: Path) -> None:
    path = tmp_path / "P01.json"
    path.write_text("{")
    with pytest.raises(FileError, match="--restart"):
        load_progress(path, conditions())
    save_progress(path, Progress(conditions=conditions(), presentations=-1))
    with pytest.raises(FileError, match="--restart"):
        load_progress(path, conditions())
    with pytest.raises(FileError, match="cannot be read"):
        load_progress(tmp_path / "none", conditions())


@pytest.mark.parametrize("law", ["pressure", "energy", "power_law", "linear_law"])
def test_a_law_that_answers_the_skin_is_not_there_while_the_person_answers(law: str) -> None:
    check_laws(conditions(), ("contact", "prepulse"))
    with pytest.raises(FileError, match="contact would change"):
        check_laws(conditions(), ("contact", "prepulse"), has_baseline=True)
    with pytest.raises(FileError, match=f"{law} would change"):
        check_laws(conditions(), ("contact", law))


def test_pulses_that_would_be_made_narrower_are_asked_about_as_narrow_ones() -> None:
    narrow = Shape(strength_duration=StrengthDuration(width_us=50, tau_us=151.0))
    with pytest.raises(FileError, match=r"100 us to 50 us.*--width-us 50"):
        check_laws(conditions(shape=narrow.at(100)), ("strength_duration",))
    check_laws(conditions(width_us=50, shape=narrow.at(50)), ("strength_duration",))


def test_a_calibration_says_what_its_pulses_were(tmp_path: Path) -> None:
    skin = NoisySkin(2, 25)
    progress = Progress(conditions=conditions("limits", 2, shape=Shape(bursts=BURSTS)))
    Course(progress, skin, SimulatedPerson(skin.sense, 1), lambda: TODAY).run(range(2))
    save_progress(tmp_path / "P01.json", progress)
    again = load_progress(tmp_path / "P01.json", progress.conditions)
    assert finished(again, TODAY, "test").shape == Shape(bursts=BURSTS)


def test_presentations_that_outlast_a_frame_are_refused() -> None:
    with pytest.raises(FileError, match=r"100 pulses at 60 Hz last 1\.67 s"):
        check_conditions(conditions(pulses=100))


def test_an_electrode_that_cannot_be_presented_is_left_with_the_reason() -> None:
    class Loose(NoisySkin):
        def present(self, electrode: int, current_ua: int) -> Delivered:
            if electrode == 1:
                raise NotDelivered(electrode, "contact_open: 97 of 400 uA", 97)
            return super().present(electrode, current_ua)

    skin = Loose(3, 21)
    progress = Progress(conditions=conditions("limits", 3))
    course = Course(progress, skin, SimulatedPerson(skin.sense, 1), lambda: TODAY)
    course.run(range(3))
    assert progress.missing == (1,)
    assert "contact_open" in course.left[1]

    made = finished(progress, TODAY, "test")
    least_ua = min(progress.found[0].threshold_ua, progress.found[2].threshold_ua)
    assert not made.electrode[1].felt
    assert made.electrode[1].cap_ua == least_ua


def test_nothing_felt_anywhere_is_no_calibration() -> None:
    with pytest.raises(FileError, match="nothing was felt anywhere"):
        finished(Progress(conditions=conditions()), TODAY, "test")


def test_the_same_seed_answers_the_same() -> None:
    progress, other = (calibrated(NoisySkin(4, 22))[0] for _ in range(2))
    assert progress == other


def test_what_is_presented_with_a_prepulse_has_the_charge_of_the_limit_and_no_more() -> None:
    prepulse = Prepulse(below_db=6.0, width_us=60)
    led = conditions(shape=Shape(prepulse=prepulse))
    assert conditions().presented_ua == 4_000
    assert led.presented_ua == 3_075
    assert prepulse.of(PulseRequest(led.presented_ua, 100)).charge_pc <= 4_000 * 100
    skin = NoisySkin(2, seed=3, median_ua=5_000.0, sigma=0.0)
    begun = Progress(conditions=conditions(electrodes=2, shape=led.shape))
    Course(begun, skin, SimulatedPerson(skin.sense, skin.seed), lambda: TODAY).run((0,))
    assert max(current_ua for _, current_ua in skin.presented) == 3_075
