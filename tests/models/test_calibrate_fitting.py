"""A fit from the first state to the last: who gets a k, what is presented, and how it goes on after
an interruption.
"""

from __future__ import annotations

import dataclasses
import random
from pathlib import Path

import msgspec
import pytest

from bench import fit as bench_fit
from etd.calibrate.exponent import NoFit
from etd.calibrate.fitting import (
    STATES,
    Fitting,
    electrodes_to_ask,
    load_fit,
)
from etd.calibrate.person import ResponseModel, SimulatedPerson
from etd.calibrate.progress import save_progress
from etd.calibrate.reach import RISE
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.errors import FileError
from fit_scenes import (
    ADAPTING,
    POOR,
    TODAY,
    N,
    StateSkin,
    ask_all,
    ask_in_this_state,
    baseline,
    begun,
    calibrated,
    found,
)


@pytest.mark.parametrize(("model", "least"), [(ADAPTING, 9), (POOR, 5)], ids=["adapting", "poor"])
def test_who_has_a_k_gets_it_and_hardly_anybody_without(model: ResponseModel, least: int) -> None:
    """Ten with one and twenty without here; `make bench-fit` plays 200 of each."""
    chance = random.Random(3)
    right = 0
    for seed in range(10):
        k = chance.uniform(0.5, 1.1)
        one = found(k, seed, model)
        right += one is not None and one.why_not is None and abs(one.k - k) <= 0.25 * k
    assert right >= least
    without = [found(0.0, seed, model) for seed in range(20)]
    assert sum(one is not None and one.why_not is None for one in without) <= 1


def test_nothing_is_presented_that_was_not_answered_a_step_below() -> None:
    skin = StateSkin(0.8, 1)
    made = calibrated(skin, 1, ADAPTING)
    progress = begun(skin, 1, made)
    fitting = ask_all(skin, progress, 1, made=made)
    assert fitting.fit(TODAY).why_not is None
    most = 0.0
    for electrode in progress.electrodes:
        tolerated_ua = 0
        for shown, current_ua in skin.presented:
            if shown == electrode and current_ua:
                most = max(most, current_ua / tolerated_ua if tolerated_ua else 0.0)
                tolerated_ua = max(tolerated_ua, current_ua)
    assert 1.0 < most <= RISE + 0.01


def test_dry_skin_gets_no_more_than_its_caps_and_damp_skin_up_to_the_limit() -> None:
    """Of a person who does not feel any of it."""
    skin = StateSkin(0.8, 1)
    made, progress = baseline(skin), begun(skin, 1)
    asked = progress.electrodes
    skin.threshold_ua = [9_000.0] * N
    fitting, person = Fitting(progress, made), SimulatedPerson(skin.sense, 1)
    assert fitting.above_caps_ua == dict.fromkeys(asked, 4_000)
    for state in STATES:
        skin.presented.clear()
        ask_in_this_state(fitting, asked, skin, person, made)
        for one in asked:
            is_damp = state.name in ("damp", "pressed")
            most_ua = 4_000 if is_damp else made.electrode[one].cap_ua
            assert max(ua for at, ua in skin.presented if at == one) == most_ua


def test_an_interruption_between_two_states_loses_nothing(tmp_path: Path) -> None:
    skin = StateSkin(0.8, 1)
    progress = begun(skin, 1)
    whole = ask_all(skin, progress, 1, until=2)
    path = tmp_path / "fit.json"
    save_progress(path, progress)
    saved = load_fit(path, begun(skin, 1), ["seed", "electrodes"])
    assert msgspec.to_builtins(saved) == msgspec.to_builtins(progress)
    assert whole.state == STATES[2]
    assert ask_all(skin, saved, 2).state is None
    assert {one.state for one in saved.asked} == set(range(len(STATES)))


def test_a_saved_fit_of_other_conditions_is_refused(tmp_path: Path) -> None:
    skin = StateSkin(0.8, 1)
    progress = begun(skin, 1)
    path = tmp_path / "fit.json"
    save_progress(path, progress)
    other = msgspec.structs.replace(
        progress, conditions=msgspec.structs.replace(progress.conditions, width_us=50)
    )
    with pytest.raises(FileError, match=r"conditions.*--restart"):
        load_fit(path, other, ["electrodes"])
    with pytest.raises(FileError, match="seed"):
        load_fit(path, msgspec.structs.replace(progress, seed=9), ["seed", "electrodes"])
    assert load_fit(path, msgspec.structs.replace(progress, seed=9), ["electrodes"]).seed == 1
    path.write_text("{}")
    with pytest.raises(FileError, match="no saved fit"):
        load_fit(path, progress, ["electrodes"])


def test_what_was_too_strong_stays_below_in_later_states_unless_it_is_taken_back() -> None:
    progress = begun(StateSkin(0.8, 1), 1)
    fitting = Fitting(progress, baseline(StateSkin(0.8, 1)))
    of_state = fitting.progress_of_state()
    electrode = progress.electrodes[0]
    cap_ua = fitting.caps_ua[electrode]
    assert cap_ua > 700
    of_state.lower(electrode, 700)
    fitting.lower(of_state)
    of_state.lowered_ua.clear()
    fitting.lower(of_state)
    fitting.progress_of_state()
    assert fitting.caps_ua[electrode] == cap_ua
    of_state.lower(electrode, 700)
    fitting.lower(of_state)
    fitting.progress_of_state()
    assert fitting.caps_ua[electrode] == 700


def test_electrodes_without_room_or_feeling_are_not_asked() -> None:
    made = baseline(StateSkin(0.8, 1))
    assert electrodes_to_ask(made) == (0, 1, 3, 4, 6, 7)
    flat = ElectrodeLimits(threshold_ua=900, comfortable_ua=900, cap_ua=900)
    few = msgspec.structs.replace(made, electrode=(*made.electrode[:3], *[flat] * (N - 3)))
    with pytest.raises(FileError, match="3 electrodes could be asked"):
        electrodes_to_ask(few)
    with pytest.raises(FileError, match=r"electrode 5 was not .*choose of 0, 1"):
        electrodes_to_ask(few, (5,))


def test_a_limit_below_the_thresholds_of_the_baseline_is_refused_at_once() -> None:
    """Two states would be answered before it is known that too few have a threshold."""
    made = baseline(StateSkin(0.8, 1))
    low = sorted(one.threshold_ua for one in made.electrode)
    said = f"--max-current-ua: 3 electrodes have a threshold below {low[3]} uA .* above {low[3]} uA"
    with pytest.raises(FileError, match=said):
        electrodes_to_ask(made, most_ua=low[3])
    asked = electrodes_to_ask(made, most_ua=low[3] + 1)
    assert sorted(made.electrode[one].threshold_ua for one in asked) == low[:4]
    above = next(at for at, one in enumerate(made.electrode) if one.threshold_ua == low[-1])
    with pytest.raises(FileError, match=f"electrode {above} was not felt, or has no room"):
        electrodes_to_ask(made, (*asked, above), low[-1])


def test_a_person_whose_electrodes_need_more_than_the_limit_is_told_so() -> None:
    skin = StateSkin(1.9, 1)
    skin.threshold_ua = [1_500.0] * N
    with pytest.raises(NoFit, match=r"of 6 electrodes have a threshold .* raise --max-current-ua"):
        ask_all(skin, begun(skin, 1), 1).fit(TODAY)


def test_the_bench_says_no_where_too_few_get_theirs_or_too_many_get_what_they_have_not() -> None:
    true_k = [0.8] * 20
    none_got: list[float | None] = [None] * 20
    got: list[float | None] = [*[0.8 * 1.2] * 18, 0.8 * 1.3, None]
    said, is_held = bench_fit.judged("adapting", true_k, got, [0.3, *none_got[1:]])
    assert is_held
    assert "18 get theirs within 25% (19 get one" in said
    assert "of 20 without, 1 get one: holds" in said
    assert not bench_fit.judged("adapting", true_k, [None, *got[1:]], none_got)[1]
    assert not bench_fit.judged("adapting", true_k, got, [0.3, 0.3, *none_got[2:]])[1]
    verdict, is_held = bench_fit.judged("poor", true_k, none_got, none_got)
    assert is_held
    assert verdict.endswith("that they get theirs is told and not asked for")
    assert not bench_fit.judged("poor", true_k, got, [0.3, 0.3, *none_got[2:]])[1]
    assert not bench_fit.judged("area", true_k, none_got, [])[1]
    assert bench_fit.judged("sweat", [], [], none_got) == (
        "sweat: of 20 without, 0 get one: holds",
        True,
    )
    assert not bench_fit.judged("sweat", [], [], [0.3, 0.3, *none_got[2:]])[1]


@pytest.mark.parametrize("false_alarms", [0.0, 0.3])
def test_who_feels_silence_in_a_fit_is_known_afterwards(false_alarms: float) -> None:
    """In every state there are silent trials, and the file has what was said of them."""
    model = dataclasses.replace(ADAPTING, false_alarms=false_alarms)
    fitted = found(0.8, 5, model)
    assert fitted is not None
    assert fitted.catch_trials is not None
    assert fitted.catch_trials > 5 * 6
    assert fitted.false_alarm_rate is not None
    assert (fitted.false_alarm_rate > 0.1) == (false_alarms > 0.1)


def test_saved_false_alarms_that_cannot_be_are_refused(tmp_path: Path) -> None:
    progress = begun(StateSkin(0.8, 1), 1)
    path = tmp_path / "fit.json"
    progress.catch_trials, progress.false_alarms = 3, 2
    save_progress(path, progress)
    assert load_fit(path, progress, ["seed", "electrodes"]).false_alarms == 2
    progress.false_alarms = 4
    save_progress(path, progress)
    with pytest.raises(FileError, match="4 of 3 silent trials cannot be"):
        load_fit(path, progress, ["seed", "electrodes"])
