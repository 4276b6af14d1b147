"""What all electrodes at once have taken of the levels that each had alone, in words."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from calibrate_scenes import ROW
from etd.calibrate.progress import Progress
from etd.cli.whole_taken_down import said_of_whole
from etd.protocol.calibration import ElectrodeLimits

FOUND = ElectrodeLimits(threshold_ua=300, comfortable_ua=1_500, cap_ua=1_800)
AT_THRESHOLD = ElectrodeLimits(threshold_ua=900, comfortable_ua=900, cap_ua=1_800)
#: As a file may have it: felt, and without a level.
WITHOUT_LEVEL = ElectrodeLimits(threshold_ua=0, comfortable_ua=0, cap_ua=500)


def said(before: Mapping[int, ElectrodeLimits], times: float) -> str | None:
    progress = Progress(conditions=ROW, found=dict(before))
    progress.take_down(times)
    return said_of_whole(before, progress)


def test_nothing_is_said_where_nothing_was_taken() -> None:
    assert said({0: FOUND, 1: replace(FOUND, felt=False)}, 1.0) is None


def test_it_says_what_is_left_of_the_level_that_lost_most() -> None:
    told = said({0: FOUND, 1: AT_THRESHOLD, 2: WITHOUT_LEVEL}, 1.25)
    assert told is not None
    assert "their levels and caps are 80% of what each was alone" in told


def test_it_says_of_caps_alone_where_levels_stay_at_their_thresholds() -> None:
    told = said({0: AT_THRESHOLD, 1: AT_THRESHOLD}, 1.25)
    assert told is not None
    assert "their caps are 80%, and their levels stay at the thresholds" in told


def test_it_says_where_no_level_is_left() -> None:
    told = said({0: AT_THRESHOLD}, 4.0)
    assert told is not None
    assert "no level is left" in told
    assert "not felt within its cap" in told
