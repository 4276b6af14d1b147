"""The shipped applications' own arithmetic: steps of a pattern, the picture, the demo's bar.

Owns: what they compute; what they do with a daemon is tested in tests/system.
"""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.apps.demo_pattern import SWEEP_S, SweepingBar
from etd.apps.picture import Picture
from etd.client.steps import Currents, PlayOptions, steps_of
from etd.files.array import load_array
from etd.files.calibration import load_calibration
from etd.files.pattern import Pattern, PatternFrame
from etd.files.resources import find
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity

Rates = st.none() | st.floats(0.1, 200)
Levels = st.lists(st.floats(0, 1), min_size=8, max_size=8).map(tuple)


def frame(
    level: tuple[float, ...],
    off_ms: int = 0,
    rate_hz: float | None = None,
    polarity: Polarity | None = None,
) -> PatternFrame:
    return PatternFrame(
        duration_ms=100, off_ms=off_ms, level=level, rate_hz=rate_hz, polarity=polarity
    )


def pattern(*frames: PatternFrame) -> Pattern:
    return Pattern(electrodes=8, frames=frames)


@pytest.fixture
def calibration() -> Calibration:
    return load_calibration(find("calibrations", "fake-fingertip-pad-8"))


ONE = (1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
CURRENTS = Currents(1000, 100, 60.0)


def test_currents_are_fractions_of_the_one_that_is_given() -> None:
    (step,) = steps_of(pattern(frame(ONE)), PlayOptions(currents=CURRENTS), 8, (), print)
    assert step.numbers == (1000, 500, 0, 0, 0, 0, 0, 0)
    assert step.largest_ua == 1000
    assert (step.options["width_us"], step.options["rate_hz"]) == (100, 60.0)
    assert "polarity" not in step.options


@given(Levels, Rates, st.none() | st.floats(1, 200), st.integers(1, 10_000))
def test_no_current_and_no_rate_is_above_what_the_caller_allows(
    level: tuple[float, ...], rate_hz: float | None, most_hz: float | None, current_ua: int
) -> None:
    play_options = PlayOptions(currents=Currents(current_ua, 100, 60.0), max_rate_hz=most_hz)
    told: list[str] = []
    (step,) = steps_of(pattern(frame(level, rate_hz=rate_hz)), play_options, 8, (), told.append)
    assert max(step.numbers) <= current_ua
    assert step.largest_ua == max(step.numbers)
    asked_hz = rate_hz or 60.0
    played_hz = step.options["rate_hz"]
    assert played_hz == (asked_hz if most_hz is None else min(asked_hz, most_hz))
    if rate_hz is not None and played_hz != rate_hz:
        assert len(told) == 1


def test_silence_after_a_frame_is_a_step_of_its_own(calibration: Calibration) -> None:
    steps = steps_of(
        pattern(frame(ONE, off_ms=40), frame(ONE)), PlayOptions(), 8, (calibration,), print
    )
    assert [step.duration_ms for step in steps] == [100, 40, 100]
    assert [step.options["tag"] for step in steps] == [0, 0, 1]
    assert [step.ends_frame for step in steps] == [False, True, True]
    assert set(steps[1].numbers) == {0}
    assert steps[1].largest_ua == 0


def test_levels_are_scaled_and_leave_the_conditions_to_the_calibration(
    calibration: Calibration,
) -> None:
    told: list[str] = []
    wanted = pattern(frame(ONE, rate_hz=75.0, polarity="anodic"))
    (step,) = steps_of(wanted, PlayOptions(level=0.5), 8, (calibration,), told.append)
    assert step.numbers[:2] == (0.5, 0.25)
    assert not {"rate_hz", "polarity", "width_us"} & set(step.options)
    assert "75 Hz" in told[0]
    limits = calibration.electrode[0]
    assert limits.threshold_ua < step.largest_ua < limits.comfortable_ua


@pytest.mark.parametrize(
    ("file_hz", "most_hz", "played_hz"),
    [(20.0, None, 20.0), (None, 30.0, 30.0), (75.0, 30.0, 30.0), (20.0, 30.0, 20.0)],
)
def test_levels_are_played_at_a_rate_below_the_calibrations_and_that_is_told(
    calibration: Calibration, file_hz: float | None, most_hz: float | None, played_hz: float
) -> None:
    told: list[str] = []
    wanted, play_options = pattern(frame(ONE, rate_hz=file_hz)), PlayOptions(max_rate_hz=most_hz)
    (step,) = steps_of(wanted, play_options, 8, (calibration,), told.append)
    assert step.options["rate_hz"] == played_hz
    assert f"at {played_hz:g} Hz, below the calibration's 60 Hz" in told[-1]
    assert ("75 Hz" in told[0]) == (file_hz == 75.0)


def test_a_rate_that_is_the_calibrations_is_nothing_to_tell(calibration: Calibration) -> None:
    told: list[str] = []
    steps_of(pattern(frame(ONE, rate_hz=60.0)), PlayOptions(), 8, (calibration,), told.append)
    assert told == []


@pytest.mark.parametrize(
    ("play_options", "polarity", "sentence"),
    [
        (PlayOptions(), "cathodic", "--current-ua"),
        (PlayOptions(polarity="biphasic"), "anodic", "biphasic"),
    ],
)
def test_levels_under_other_conditions_are_refused(
    calibration: Calibration, play_options: PlayOptions, polarity: Polarity, sentence: str
) -> None:
    with pytest.raises(Refused, match=sentence):
        steps_of(pattern(frame(ONE, polarity=polarity)), play_options, 8, (calibration,), print)


def test_a_pattern_for_another_array_is_refused(calibration: Calibration) -> None:
    with pytest.raises(Refused, match="8 electrodes, this array has 64"):
        steps_of(pattern(frame(ONE)), PlayOptions(), 64, (calibration,), print)


def test_a_calibration_with_another_gamma_gives_other_currents(calibration: Calibration) -> None:
    steep = msgspec.structs.replace(calibration, gamma=2.0)
    play_options = PlayOptions(level=0.25)
    largest = [
        steps_of(pattern(frame(ONE)), play_options, 8, (made,), print)[0].largest_ua
        for made in (calibration, steep)
    ]
    assert largest[0] < largest[1]


# --- picture -----------------------------------------------------------------------------------


def test_a_square_grid_is_drawn_square_with_the_fingertip_above() -> None:
    picture = Picture((0.0, 2.0, 0.0, 2.0), (0.0, 0.0, 2.0, 2.0))
    assert picture.rows(["a", "b", "c", "d"]) == ["c d", "a b"]


def test_a_hexagon_keeps_its_half_steps() -> None:
    picture = Picture((1.0, 3.0, 0.0, 2.0, 4.0, 1.0, 3.0), (1.7, 1.7, 0.0, 0.0, 0.0, -1.7, -1.7))
    assert picture.rows(list("abcdefg")) == [" a b", "c d e", " f g"]


@pytest.mark.parametrize("name", ["grid-8x8", "hexagon-61", "grid-5x12", "grid-16x16", "pad-8"])
def test_every_shipped_array_has_a_cell_for_each_electrode(name: str) -> None:
    array = load_array(find("arrays", name))
    cells = Picture(array.x_mm, array.y_mm).cells()
    assert len(set(cells)) == array.count
    assert max(row for row, _ in cells) < 20
    assert max(column for _, column in cells) < 40


# --- the demo's bar ----------------------------------------------------------------------------


@given(st.floats(0, 1e6))
def test_the_bar_is_always_a_frame_of_levels(t_s: float) -> None:
    array = load_array(find("arrays", "hexagon-61"))
    levels = SweepingBar(array.x_mm, array.y_mm).levels(t_s)
    assert len(levels) == 61
    assert all(0.0 <= level <= 1.0 for level in levels)


def test_the_bar_moves_across_the_array_and_turns() -> None:
    array = load_array(find("arrays", "grid-8x8"))
    bar = SweepingBar(array.x_mm, array.y_mm)

    def center_x(t_s: float) -> float:
        levels = bar.levels(t_s)
        return sum(level * x for level, x in zip(levels, array.x_mm, strict=True)) / math.fsum(
            levels
        )

    early, late = center_x(0.35 * SWEEP_S), center_x(0.65 * SWEEP_S)
    assert early < late
    assert bar.levels(0.5 * SWEEP_S) != bar.levels(1.5 * SWEEP_S)
