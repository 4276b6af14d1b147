"""The benchmark of steadiness on one piece of a finger's time: what it claims of body and runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.steady import bounds
from bench.steady_figures import MOST_STEP, SteadyFigures, figures
from bench.steady_laws import AHEAD, CALIBRATED, CONTACT, CONTACT_AHEAD, LAWS, NONE
from bench.steady_run import ELECTRODES, run
from bench.steady_skin import CALIBRATED_S, MOST_UA, WIDTH_US, body_of, calibrated
from etd.files.configuration import fake_config
from etd.safety.soft_start import SoftStart

SEED, LEVEL, MINUTES, PIECES = 5, 0.6, 2.0, 1


def found_with(name: str) -> SteadyFigures:
    return figures(name, [run(SEED, LAWS[name], LEVEL, MINUTES, PIECES)])


def test_the_finger_has_sweated_when_it_is_calibrated() -> None:
    loaded = fake_config(electrodes=ELECTRODES)
    found = calibrated(SEED, loaded.board, loaded.array).electrode
    body = body_of(SEED, loaded.board, loaded.array)
    body.look_at(0)
    dry_ua = [
        body.commanded_threshold_ua(electrode, WIDTH_US) for electrode in range(0, ELECTRODES, 7)
    ]
    body.look_at(int((CALIBRATED_S + 1_000.0) * 1e9))
    wet_ua = [
        body.commanded_threshold_ua(electrode, WIDTH_US) for electrode in range(0, ELECTRODES, 7)
    ]
    asked_ua = [found[electrode].threshold_ua for electrode in range(0, ELECTRODES, 7)]
    assert np.median(asked_ua) > 1.3 * np.median(dry_ua)
    assert np.median(asked_ua) == pytest.approx(np.median(wet_ua), rel=0.25)
    assert max(limits.comfortable_ua for limits in found) <= MOST_UA


def test_a_return_is_a_step_where_neither_the_engine_nor_a_law_softens_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(SoftStart, "touched_again", lambda self, electrode: None)
    plain, soft = found_with(NONE).recontact_step, found_with(CONTACT).recontact_step
    assert plain is not None
    assert plain > MOST_STEP
    assert soft is not None
    assert soft <= MOST_STEP


def test_pressing_less_than_the_sensor_is_set_to_is_felt_as_less() -> None:
    pressed, plain = found_with("pressure"), found_with(NONE)
    assert pressed.scans == plain.scans
    assert pressed.mean_felt < plain.mean_felt - 0.1


GOOD = SteadyFigures(NONE, 2.0, 0.4, 0.1, 0.0, 0.01, 10, 10, 1.5, 1.3, 0.5, 2, 9, 20, 4, 1_000)
HELD = {
    name: replace(GOOD, name=name, over_time=0.2, scans_above_pain=0, recontact_step=1.1)
    for name in (CONTACT, CALIBRATED, CONTACT_AHEAD, AHEAD)
}


@pytest.mark.parametrize(
    "worse",
    [
        replace(HELD[AHEAD], over_time=0.21),
        replace(HELD[AHEAD], scans_above_pain=1),
        replace(GOOD, scans_above_pain=0),
        *(replace(steady_figures, recontact_step=1.21) for steady_figures in HELD.values()),
        *(replace(steady_figures, recontact_step=None) for steady_figures in HELD.values()),
    ],
)
def test_each_bound_can_fail(worse: SteadyFigures) -> None:
    found = {NONE: GOOD, **HELD}
    assert all(bound.is_met for bound in bounds(found))
    failed = [bound for bound in bounds(found | {worse.name: worse}) if not bound.is_met]
    assert len(failed) == 1
    assert worse.name in failed[0].what


@pytest.mark.parametrize("left_out", [NONE, *HELD])
def test_what_was_not_run_is_not_judged_and_not_met(left_out: str) -> None:
    found = {
        name: steady_figures
        for name, steady_figures in {NONE: GOOD, **HELD}.items()
        if name != left_out
    }
    failed = [bound.what for bound in bounds(found) if not bound.is_met]
    assert failed
    assert all("not judged" in text for text in failed)
