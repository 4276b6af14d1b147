"""A gain of the ADC that is wrong all the time, on fingers that move: what a law makes of it.

The law alone, by what the busiest modelled fingers resist for two minutes when they have sweated.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from bench.steady_laws import LAWS, K
from bench.steady_skin import body_of, calibrated, seen_ohm
from etd.files.configuration import fake_config
from etd.pulse.measured import BEND_UA
from etd.stabilize.pipeline import ignore_rejection
from etd.stabilize.plausibility import Plausibility
from etd_body.living import LivingBody
from etd_body.tissue import Floats

FITTED = LAWS["power_law"].power_law
assert FITTED is not None
MOST, NEAR = FITTED.max_widening, FITTED.max_widening**0.8
ELECTRODES, FROM_S, TO_S, STEP_S = range(0, 64, 8), 240.0, 360.0, 0.5
AT_UA = 2_000
SEEDS = (1, 2)


@cache
def resisted(seed: int) -> tuple[Floats, Floats]:
    """In ohm: [time, electrode], NaN while open; and [electrode] when it was calibrated."""
    loaded = fake_config(electrodes=64)
    then = calibrated(seed, loaded.board, loaded.array).electrode
    reference_ohm = [
        (then[electrode].resistance_ohm or 0)
        * (then[electrode].comfortable_ua + BEND_UA)
        / (AT_UA + BEND_UA)
        for electrode in ELECTRODES
    ]
    body = body_of(seed, loaded.board, loaded.array)
    body.look_at(0)
    now_ohm = []
    for at_s in np.arange(FROM_S, TO_S, STEP_S):
        body.look_at(round(at_s * 1e9))
        now_ohm.append([ohm_of(body, electrode) for electrode in ELECTRODES])
    return np.array(now_ohm), np.array(reference_ohm)


def ohm_of(body: LivingBody, electrode: int) -> float:
    try:
        return seen_ohm(body, electrode, AT_UA)
    except ZeroDivisionError:
        return math.nan


def wants(seed: int, gain: float) -> Floats:
    """[time, electrode]: what `fitted` wants by such an ADC, as a factor; NaN while open."""
    leak_ohm = fake_config(electrodes=64).board.source.leak_ohm
    now_ohm, reference_ohm = resisted(seed)
    read_part = gain / (1.0 + leak_ohm / now_ohm)
    read_ohm = leak_ohm * read_part / (1.0 - read_part)
    return np.asarray((read_ohm / reference_ohm) ** -K)


def believed(wanted: Floats) -> Floats:
    """[pulse]: what is left of it, within the law's own bound."""
    trust = Plausibility(MOST, ignore_rejection)
    left = [
        min(MOST, trust.plausible(electrode, float(entry), round(number * STEP_S * 1e9)))
        for number, scan in enumerate(wanted)
        for electrode, entry in enumerate(scan)
        if math.isfinite(entry)
    ]
    return np.array(left)


def near_its_widest(wanted: Floats) -> float:
    """For what part of the time, of what is believed."""
    return float((believed(wanted) >= NEAR).mean())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("gain", [0.85, 0.7, 0.5])
def test_a_wrong_gain_holds_a_law_near_its_widest_no_more_than_the_right_one_may(
    seed: int, gain: float
) -> None:
    assert near_its_widest(wants(seed, gain)) < near_its_widest(wants(seed, 1.0)) + 0.05
    assert believed(wants(seed, gain)).mean() < believed(wants(seed, 1.0)).mean() + 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_without_that_a_gain_of_seven_tenths_would_for_most_of_the_time(seed: int) -> None:
    """What the test above is about."""
    assert float((wants(seed, 0.7) >= NEAR).mean()) > 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_the_right_gain_loses_little_by_it(seed: int) -> None:
    trust, wanted = Plausibility(MOST, ignore_rejection), wants(seed, 1.0)
    lost = [
        1.0 - trust.plausible(electrode, float(entry), round(number * STEP_S * 1e9)) / float(entry)
        for number, scan in enumerate(wanted)
        for electrode, entry in enumerate(scan)
        if math.isfinite(entry) and entry < MOST
    ]
    assert float(np.mean(lost)) < 0.08
