"""Frame after frame: what of a plan is decided once."""

from __future__ import annotations

from typing import Any

import pytest

from engine_parts import calibration, currents, frame, planner
from etd.pulse.request import MaxGain
from plain_records import told


@pytest.mark.parametrize(
    "change",
    [
        {"current_ua": currents(e3=900)},
        {"width_us": 90},
        {"polarity": "cathodic"},
        {"rate_hz": 15.0},
        {"returns": ((0,),) * 16},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_pulse_that_is_as_in_the_frame_before_is_the_same_and_any_other_is_new(
    change: dict[str, Any],
) -> None:
    """So that what depends on it alone is decided once."""
    asked = {"current_ua": currents(e3=800), "width_us": 100, "rate_hz": 20.0}
    plans = planner()
    (first,), (same,) = (plans.plan(frame(**asked)).schedule for _ in range(2))
    assert same is first
    (other,) = plans.plan(frame(**{**asked, **change})).schedule
    (fresh,) = planner().plan(frame(**{**asked, **change})).schedule
    assert told(other) == told(fresh)
    assert told(other) != told(first)


def test_a_level_is_planned_anew_after_a_current_that_is_the_same() -> None:
    """Its stabilizers may request more."""
    plans = planner(calibrated=calibration(), max_gain=MaxGain(2.0, 1.0, 2.0))
    current_ua = plans.plan(frame(level=(0.5,) + (0.0,) * 15)).schedule[0].current_ua
    (named,) = plans.plan(frame(current_ua=currents(e0=current_ua))).schedule
    assert named.bounds.current_ua == current_ua
    (level,) = plans.plan(frame(level=(0.5,) + (0.0,) * 15)).schedule
    assert level.bounds.current_ua == 2 * current_ua
