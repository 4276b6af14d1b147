"""A fit that is continued: how long it may have lain, with which board, and when it is lost."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from etd.calibrate.exponent import Asked, NoFit
from etd.calibrate.fitting import (
    MOST_PAUSE_S,
    STATES,
    FitProgress,
    Fitting,
    check_pause,
    load_fit,
)
from etd.calibrate.progress import save_progress
from etd.protocol.errors import FileError
from fit_scenes import FALLS, TODAY, StateSkin, baseline, begun

#: Of a wall clock.
THEN_S = 1_790_000_000.0


def asked_in(states: int) -> FitProgress:
    """A fit that is over so far, its thresholds half a minute apart."""
    progress = begun(StateSkin(0.8, 1), 1)
    progress.states = states
    for state in range(states):
        for place, electrode in enumerate(progress.electrodes):
            at_s = THEN_S + 400.0 * state + 30.0 * place
            progress.asked.append(Asked(electrode, state, at_s, 800.0, 50e3 / FALLS[state]))
    return progress


def fitting_of(progress: FitProgress) -> Fitting:
    return Fitting(progress, baseline(StateSkin(0.8, 1)))


def test_a_pause_is_waited_out_and_the_next_day_is_another_skin() -> None:
    progress = asked_in(2)
    last_s = max(one.at_s for one in progress.asked)
    for pause_s in (0.0, 60.0, MOST_PAUSE_S):
        check_pause(progress, last_s + pause_s, "P01-fit.json")
    with pytest.raises(FileError, match=r"asked: the last state was over 61 minutes ago.*restart"):
        check_pause(progress, last_s + MOST_PAUSE_S + 60.0, "P01-fit.json")
    with pytest.raises(FileError, match="over 16 hours ago"):
        check_pause(progress, last_s + 16 * 3_600.0, "P01-fit.json")
    with pytest.raises(FileError, match="set back since"):
        check_pause(progress, last_s - 1.0, "P01-fit.json")


def test_times_of_before_the_computer_was_started_are_refused() -> None:
    """They were of a clock that began at its start."""
    progress = asked_in(2)
    progress.asked = [
        msgspec.structs.replace(one, at_s=one.at_s - THEN_S) for one in progress.asked
    ]
    with pytest.raises(FileError, match="--restart"):
        check_pause(progress, THEN_S, "P01-fit.json")


def test_before_the_first_state_and_after_the_last_time_does_not_matter() -> None:
    check_pause(asked_in(0), THEN_S + 1e6, "P01-fit.json")
    check_pause(asked_in(len(STATES)), THEN_S + 1e6, "P01-fit.json")


def test_a_fit_is_continued_with_the_board_that_it_was_begun_with(tmp_path: Path) -> None:
    path, progress = tmp_path / "fit.json", asked_in(2)
    save_progress(path, progress)
    for other in ({"board": "reference-hv507"}, {"leak_ohm": 33_000}):
        now = msgspec.structs.replace(asked_in(0), **other)
        with pytest.raises(FileError, match=rf"{next(iter(other))}: it was begun with others"):
            load_fit(path, now, ["electrodes"])
    assert load_fit(path, asked_in(0), ["electrodes"]) == progress


def test_the_board_goes_into_the_exponent() -> None:
    progress, chance = asked_in(len(STATES)), random.Random(1)
    progress.asked = [
        msgspec.structs.replace(
            one, threshold_ua=8e5 * math.exp(chance.gauss(0, 0.05)) / one.resistance_ohm
        )
        for one in progress.asked
    ]
    found = fitting_of(progress).fit(TODAY)
    assert (found.board, found.leak_ohm) == ("kajimoto-hv507", 66_000)
    assert found.why_not is None
    assert found.k == pytest.approx(1.0, abs=0.1)


def test_where_too_few_electrodes_are_left_nobody_is_asked_in_vain() -> None:
    progress = asked_in(3)
    assert not fitting_of(progress).is_lost
    few = progress.electrodes[:3]
    whole = progress.asked
    # Of five states four are enough: damp skin can need more than the limit.
    progress.asked = [one for one in whole if one.state != 1 or one.electrode in few]
    assert not fitting_of(progress).is_lost
    progress.asked = [one for one in whole if one.state == 0 or one.electrode in few]
    assert fitting_of(progress).is_lost
    with pytest.raises(NoFit, match=r"3 of 6 electrodes .* all but 1, and 4 are needed: damp skin"):
        fitting_of(progress).fit(TODAY)
    assert not fitting_of(asked_in(0)).is_lost
    progress.asked = [one for one in whole if one.state == 1 or one.electrode in few]
    with pytest.raises(NoFit, match=r"needed: on dry skin .* above the calibration's caps: rest"):
        fitting_of(progress).fit(TODAY)


@pytest.mark.parametrize(
    ("electrodes", "why"),
    [
        ((0, 1, 2, 999), "there is no such electrode: the array has 0 to 7"),
        ((0, 1, 1, 1), "1 is there 3 times"),
        ((0, 1, 2), "3 electrodes, and 4 are needed"),
    ],
)
def test_a_saved_fit_of_electrodes_that_cannot_be_is_refused(
    tmp_path: Path, electrodes: tuple[int, ...], why: str
) -> None:
    path, progress = tmp_path / "fit.json", asked_in(0)
    progress.electrodes = electrodes
    save_progress(path, progress)
    with pytest.raises(FileError, match=rf"fit\.json: electrodes.*: {why}.*--restart"):
        load_fit(path, asked_in(0))


def at_once(_: Asked) -> float:
    return THEN_S


def backwards(one: Asked) -> float:
    return THEN_S - 400.0 * one.state


@pytest.mark.parametrize("at_s", [at_once, backwards])
def test_a_saved_fit_whose_states_do_not_follow_one_another_is_refused(
    tmp_path: Path, at_s: Callable[[Asked], float]
) -> None:
    """Time would be taken for what it is not: a usable k came of five states at once."""
    path, progress = tmp_path / "fit.json", asked_in(len(STATES))
    progress.asked = [msgspec.structs.replace(one, at_s=at_s(one)) for one in progress.asked]
    save_progress(path, progress)
    with pytest.raises(FileError, match=r"asked: state 2 was not asked in after state 1"):
        load_fit(path, asked_in(0))
    # In whichever order they are written.
    progress = asked_in(len(STATES))
    progress.asked.reverse()
    save_progress(path, progress)
    assert load_fit(path, asked_in(0)) == progress


@pytest.mark.parametrize("key", ["lowered_ua", "lowering_ua"])
def test_a_saved_fit_that_lowers_what_the_array_has_not_is_refused(
    tmp_path: Path, key: str
) -> None:
    path, progress = tmp_path / "fit.json", asked_in(2)
    setattr(progress, key, {-1: 700})
    save_progress(path, progress)
    with pytest.raises(FileError, match=rf"{key}\.-1: there is no such electrode"):
        load_fit(path, asked_in(0))
