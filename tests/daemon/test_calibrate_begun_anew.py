"""What was too strong outlives a calibration that is begun anew, and a lower limit."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from calibrate_scenes import FOUND, ROW
from etd.calibrate.begun_anew import kept_anew
from etd.calibrate.conditions import Conditions
from etd.calibrate.fitting import Fitting, load_fit
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.progress import Progress, load_progress, save_progress
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.errors import FileError
from fit_scenes import StateSkin, baseline, begun

DOUBT = InDoubt(electrode=1, left_ua={1: 900})
LOWER = replace(ROW, cap_ua=1_500)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "P01.json"


def test_what_was_too_strong_and_what_it_was_stopped_at_are_kept(path: Path) -> None:
    saved = Progress(conditions=ROW, found={0: FOUND}, lowered_ua={2: 700}, in_doubt=DOUBT)
    saved.take_down(1.1)
    save_progress(path, saved)
    anew = replace(LOWER, rate_hz=100.0, method="staircase", pulses=5)
    kept = kept_anew(path, anew)
    assert (kept.lowered_ua, kept.in_doubt) == ({2: 700}, DOUBT)
    assert kept.together_ua == {0: (2_019, 2_120)}
    assert kept.said.startswith("kept of the saved progress: what was too strong on electrodes 2,")
    assert "--forget-too-strong" in kept.said


def test_of_a_fit_too_in_the_state_under_way_as_well(path: Path) -> None:
    progress = begun(StateSkin(0.8, 1), 1)
    progress.lowered_ua, progress.lowering_ua = {0: 700, 1: 800}, {1: 600, 2: 500}
    progress.in_doubt = DOUBT
    save_progress(path, progress)
    kept = kept_anew(path, progress.conditions)
    assert kept.lowered_ua == {0: 700, 1: 600, 2: 500}
    assert kept.in_doubt == DOUBT


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (replace(ROW, participant="P02"), "its participant is P01, not P02"),
        (replace(ROW, width_us=50), "its width_us is 100, not 50"),
        (replace(ROW, polarity="cathodic"), "its polarity is anodic, not cathodic"),
    ],
)
def test_for_others_it_is_not_and_that_is_said(path: Path, other: Conditions, why: str) -> None:
    save_progress(path, Progress(conditions=ROW, lowered_ua={2: 700}, in_doubt=DOUBT))
    kept = kept_anew(path, other)
    assert (kept.lowered_ua, kept.together_ua, kept.in_doubt) == ({}, {}, None)
    assert kept.said.startswith("not kept of the saved progress: what was too strong on electrodes")
    assert why in kept.said


def test_where_there_was_nothing_nothing_is_said(path: Path) -> None:
    assert kept_anew(path, ROW).said == ""
    save_progress(path, Progress(conditions=ROW, found={0: FOUND}))
    assert kept_anew(path, ROW) == ({}, {}, None, "")


def test_of_a_file_that_cannot_be_read_it_is_said_that_nothing_is_known(path: Path) -> None:
    path.write_text("{")
    assert "what was too strong before is not known" in kept_anew(path, ROW).said


def test_a_lower_limit_goes_on_and_holds_for_what_was_found(path: Path) -> None:
    """Where it is below the threshold, nothing is felt up to it."""
    low = ElectrodeLimits(threshold_ua=500, comfortable_ua=900, cap_ua=1_000)
    unfelt = ElectrodeLimits(threshold_ua=3_000, comfortable_ua=3_000, cap_ua=3_000, felt=False)
    near = ElectrodeLimits(threshold_ua=1_600, comfortable_ua=1_700, cap_ua=1_800)
    found = {0: low, 1: replace(low, cap_ua=2_000), 2: unfelt, 3: near}
    saved = Progress(
        conditions=ROW, found=found, lowered_ua={3: 1_900}, in_doubt=DOUBT, is_whole_accepted=True
    )
    save_progress(path, saved)
    now = load_progress(path, LOWER)
    assert now.conditions == LOWER
    assert (now.lowered_ua, now.in_doubt) == ({3: 1_900}, DOUBT)
    assert not now.is_whole_accepted
    assert (now.found[0], now.found[1]) == (low, replace(low, cap_ua=1_500))
    for electrode, felt_from_ua in ((2, None), (3, 1_600)):
        limits = now.found[electrode]
        assert (limits.felt, limits.cap_ua, limits.felt_from_ua) == (False, 1_500, felt_from_ua)
    save_progress(path, now)
    assert load_progress(path, LOWER) == now
    with pytest.raises(FileError, match=r"has 1500, this calibration 3000.*a lower limit"):
        load_progress(path, ROW)


def test_a_fit_goes_on_with_a_lower_limit_and_not_with_a_higher_one(path: Path) -> None:
    progress = begun(StateSkin(0.8, 1), 1)
    lower = begun(StateSkin(0.8, 1), 1)
    lower.conditions = replace(lower.conditions, cap_ua=1_500)
    save_progress(path, progress)
    now = load_fit(path, lower, ["seed", "electrodes"])
    assert now.conditions == lower.conditions
    now.states = 1
    assert set(Fitting(now, baseline(StateSkin(0.8, 1))).caps_ua.values()) == {1_500}
    save_progress(path, now)
    with pytest.raises(FileError, match="conditions: it was begun with others"):
        load_fit(path, begun(StateSkin(0.8, 1), 1), ["seed", "electrodes"])


def test_a_doubt_of_an_electrode_that_a_fit_begun_anew_does_not_ask_is_kept(path: Path) -> None:
    progress = begun(StateSkin(0.8, 1), 1)
    left_out = next(one for one in range(8) if one not in progress.electrodes)
    progress.in_doubt = InDoubt(electrode=left_out, left_ua={left_out: 900})
    save_progress(path, progress)
    assert load_fit(path, progress).in_doubt == progress.in_doubt
