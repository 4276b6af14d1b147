"""What was too strong in a fit bounds the calibration that the fit is added to."""

from __future__ import annotations

import datetime

import pytest
from msgspec.structs import replace

from calibrate_scenes import ROW
from etd.calibrate.fitting import FitProgress, Fitting
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.calibration import Calibration, ElectrodeLimits

TODAY = datetime.date(2026, 1, 15)
FOUND = ElectrodeLimits(threshold_ua=300, comfortable_ua=1_500, cap_ua=1_800)
FELT_LESS = MeasuredAdaptation(answers=20, weaker=18, stronger=0, use_s=600.0, date=TODAY)


@pytest.fixture
def fitting() -> Fitting:
    progress = FitProgress(
        conditions=ROW, electrodes=(0, 1, 2, 3), seed=1, board="kajimoto-hv507", leak_ohm=66_000
    )
    return Fitting(progress, made())


def made() -> Calibration:
    return Calibration(
        participant="P01", body_site="fingertip", array="row", polarity="anodic", width_us=100,
        rate_hz=60.0, returns="all", date=TODAY, program="test", electrode=(FOUND,) * 4,
        is_whole_accepted=True, adaptation=FELT_LESS,
    )  # fmt: skip


def test_caps_are_what_was_left_and_levels_with_them(fitting: Fitting) -> None:
    """Of the standing state and of those before; what is above the cap is no news."""
    of_state = fitting.progress_of_state()
    of_state.lower(1, 1_600)
    of_state.lower(2, 700)
    of_state.lower(3, 2_500)
    fitting.lower(of_state)
    fitting.progress_of_state()
    now = fitting.progress_of_state()
    now.lower(0, 250)
    fitting.lower(now)
    lowered = fitting.lowered()
    assert lowered.electrode == (
        replace(
            FOUND, threshold_ua=250, comfortable_ua=250, cap_ua=250, felt=False, felt_from_ua=300
        ),
        replace(FOUND, cap_ua=1_600),
        replace(FOUND, comfortable_ua=700, cap_ua=700),
        FOUND,
    )
    assert lowered.is_whole_accepted is None
    assert lowered.adaptation is None


def test_a_key_that_slipped_takes_nothing(fitting: Fitting) -> None:
    of_state = fitting.progress_of_state()
    of_state.lower(1, 700)
    fitting.lower(of_state)
    assert fitting.lowered() != made()
    of_state.lowered_ua.clear()
    fitting.lower(of_state)
    assert fitting.lowered() == made()
