"""The exponent of a person: who gets one, and who does not."""

from __future__ import annotations

import dataclasses
import datetime
import math
import random
import re
import statistics
from collections.abc import Iterator
from contextlib import closing, contextmanager

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import calibration, config, exponent, open_calibrated
from etd.calibrate.exponent import Asked, NoFit, fitted
from etd.calibrate.fitting import MOST_PAUSE_S
from etd.protocol.exponent import FittedExponent, usable_k
from etd.protocol.link import OpenLease
from etd.protocol.messages import Limits
from etd.stabilize.law_settings import PowerLawSettings
from etd.stabilize.settings import Settings

DAY = datetime.date(2026, 1, 15)
#: The logarithm by which the skin's resistance falls in each state, and its spread over persons:
#: dry, breathed on, after rest, pressed, after rest.
STATES = ((0.0, 0.0), (1.1, 0.35), (0.15, 0.1), (0.8, 0.3), (0.15, 0.1))
BETWEEN_ASKED_S = 40.0
#: The logarithmic errors of a threshold, of a person's criterion in a state, and of a resistance.
NOISE, CRITERION, METER = 0.08, 0.04, 0.03
BOARD, LEAK_OHM = "kajimoto-hv507", 66_000


def asked_of(
    chance: random.Random, k: float, electrodes: int = 6, criterion_sigma: float = CRITERION
) -> list[Asked]:
    """A person with this k whose thresholds rise by up to 60 % while they are asked."""
    adapts, at_s = chance.uniform(0.0, 0.6), 0.0
    own = [(chance.gauss(7.0, 0.3), chance.gauss(10.8, 0.4)) for _ in range(electrodes)]
    found = []
    for state, (fallen, spread) in enumerate(STATES):
        criterion, common = chance.gauss(0.0, criterion_sigma), chance.gauss(fallen, spread)
        for electrode in chance.sample(range(electrodes), electrodes):
            at_s += BETWEEN_ASKED_S
            fall = common + chance.gauss(0.0, 0.15) if state else chance.gauss(0.0, 0.08)
            drift = math.log1p(adapts * -math.expm1(-at_s / 600.0))
            threshold, resistance = own[electrode]
            error = criterion + chance.gauss(0.0, NOISE)
            found.append(
                Asked(
                    electrode,
                    state,
                    at_s,
                    math.exp(threshold + k * fall + drift + error),
                    math.exp(resistance - fall + chance.gauss(0.0, METER)),
                )
            )
    return found


@contextmanager
def fitted_site() -> Iterator[EngineRig]:
    """An engine whose body site has `power_law`."""
    loaded = config(electrodes=8)
    law = Settings(order=("power_law",), power_law=PowerLawSettings())
    site = msgspec.structs.replace(loaded.body_site, stabilize=law)
    with closing(engine_rig.make(loaded=dataclasses.replace(loaded, body_site=site))) as rig:
        yield rig


def fit(asked: list[Asked]) -> FittedExponent:
    return fitted(asked, DAY, BOARD, LEAK_OHM)


def found_k(asked: list[Asked]) -> float | None:
    try:
        found = fit(asked)
    except NoFit:
        return None
    return found.k if found.why_not is None else None


def test_of_200_persons_without_a_k_at_most_ten_get_one() -> None:
    chance = random.Random(7)
    found = [found_k(asked_of(chance, 0.0)) for _ in range(200)]
    assert sum(k is not None for k in found) <= 10


def behind_the_leak(asked: list[Asked]) -> list[Asked]:
    """As commanded, where the thresholds were currents through the skin."""
    return [
        msgspec.structs.replace(
            one, threshold_ua=one.threshold_ua * (1.0 + one.resistance_ohm / LEAK_OHM)
        )
        for one in asked
    ]


def test_what_the_leak_takes_is_no_k_of_a_person() -> None:
    """A threshold that does not depend on the skin: as commanded it rises with the resistance."""
    chance, known = random.Random(13), 0
    for _ in range(200):
        try:
            found = fit(behind_the_leak(asked_of(chance, 0.0, criterion_sigma=0.02)))
        except NoFit:
            continue
        assert found.why_not is not None
        known += "feels more where it resists more" in found.why_not
    assert known > 100, "k is below zero, and known well"


@pytest.mark.parametrize("k", [0.0, 0.7])
def test_an_electrode_without_a_threshold_in_one_state_is_counted_in_the_others(k: float) -> None:
    """Half of them need more than the limit where the skin is dampest: the interval is as true."""
    chance, held = random.Random(14), 0
    fits = 0
    for _ in range(500):
        asked = [
            one
            for one in asked_of(chance, k, criterion_sigma=0.1)
            if one.state != 1 or one.electrode % 2
        ]
        try:
            found = fit(asked)
        except NoFit:
            continue
        assert found.electrodes == tuple(range(6))
        fits, held = fits + 1, held + (found.low <= k <= found.high)
    assert fits > 300
    assert held >= 0.85 * fits


@pytest.mark.parametrize("criterion_sigma", [0.05, 0.1, 0.2])
def test_a_criterion_that_moves_between_states_is_no_k(criterion_sigma: float) -> None:
    """One in twenty at most, of 1000: six electrodes asked by one criterion are one finding."""
    chance = random.Random(9)
    persons = [asked_of(chance, 0.0, 6, criterion_sigma) for _ in range(1_000)]
    assert sum(found_k(asked) is not None for asked in persons) <= 50


@pytest.mark.parametrize("criterion_sigma", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("k", [0.0, 0.7])
def test_the_interval_has_the_true_k_in_it_nine_times_of_ten(
    k: float, criterion_sigma: float
) -> None:
    """Whatever the criterion does; here nothing else moves."""
    chance, held = random.Random(10), 0
    for _ in range(1_000):
        asked = []
        for state, ohm in enumerate((46e3, 20e3, 44e3, 21e3, 46e3)):
            criterion = chance.gauss(0.0, criterion_sigma)
            for electrode in range(6):
                now_ohm = ohm * math.exp(chance.gauss(0.0, 0.1))
                error = criterion + chance.gauss(0.0, 0.05)
                now_ua = 800.0 * math.pow(now_ohm / 46e3, -k) * math.exp(error)
                at_s = 400.0 * state + BETWEEN_ASKED_S * electrode
                asked.append(Asked(electrode, state, at_s, now_ua, now_ohm))
        found = fit(asked)
        held += found.low <= k <= found.high
    # Of a thousand draws of 90 %, fewer than 874 come once in 300 times.
    assert held >= 874


def test_a_finding_of_any_kind_is_one_that_a_file_can_hold_or_none() -> None:
    """Thresholds from end to end of the range, by no rule."""
    chance, wide = random.Random(11), 0
    for _ in range(200):
        asked = [
            Asked(
                electrode,
                state,
                400.0 * state + BETWEEN_ASKED_S * electrode,
                math.exp(chance.uniform(math.log(20), math.log(8_000))),
                ohm * math.exp(chance.gauss(0.0, 0.2)),
            )
            for state, ohm in enumerate((60e3, 25e3, 55e3, 22e3, 60e3))
            for electrode in range(6)
        ]
        try:
            found = fit(asked)
        except NoFit:
            continue
        wide += found.high - found.low > 5.0
        assert msgspec.convert(msgspec.to_builtins(found), FittedExponent) == found
    assert wide > 0


def test_states_in_which_all_electrodes_together_stayed_alike_say_nothing() -> None:
    """Half of them damp where the others are dry: no state differs from another."""
    asked = [
        Asked(
            electrode,
            state,
            400.0 * state,
            1_000.0,
            80e3 if (state + electrode) % 2 else 20e3,
        )
        for state in range(4)
        for electrode in range(4)
    ]
    with pytest.raises(NoFit, match="nothing is known of k"):
        fit(asked)


def test_of_200_persons_with_a_k_180_get_theirs_within_a_quarter() -> None:
    chance = random.Random(8)
    right = 0
    for _ in range(200):
        k = chance.uniform(0.5, 1.3)
        found = found_k(asked_of(chance, k))
        right += found is not None and abs(found - k) <= 0.25 * k
    assert right >= 180


def asked_with_pause(chance: random.Random, pause_s: float, before: int) -> list[Asked]:
    """A person without a k whose thresholds rise by 60 % in use, and come down in a pause."""
    asked, now_s, adapted = [], 0.0, 0.0
    for state, fall in enumerate((1.0, 3.0, 1.15, 2.3, 1.1)):
        rest_s = pause_s if state == before else 120.0
        now_s += rest_s
        adapted *= math.exp(-rest_s / 900.0)
        criterion = chance.gauss(0.0, 0.03)
        for electrode in range(6):
            now_s += 90.0
            adapted += (0.6 - adapted) * -math.expm1(-90.0 / 700.0)
            threshold_ua = 600.0 * (1.0 + adapted) * math.exp(criterion + chance.gauss(0.0, 0.05))
            now_ohm = 46e3 / fall * math.exp(chance.gauss(0.0, 0.03))
            asked.append(Asked(electrode, state, now_s, threshold_ua, now_ohm))
    return asked


@pytest.mark.parametrize("pause_s", [1_200.0, MOST_PAUSE_S])
@pytest.mark.parametrize("before", [1, 2, 3, 4])
def test_a_pause_that_is_let_through_makes_no_k(pause_s: float, before: int) -> None:
    chance = random.Random(12)
    persons = [asked_with_pause(chance, pause_s, before) for _ in range(200)]
    assert sum(found_k(asked) is not None for asked in persons) <= 10


exact = st.floats(-1.5, 1.5), st.floats(-0.001, 0.001), st.integers(0, 10**6)


@given(*exact)
def test_what_has_no_error_is_found_whatever_the_drift(k: float, drift: float, seed: int) -> None:
    chance = random.Random(seed)
    falls = [0.0, 1.2, 0.1, 0.9]
    asked = [
        Asked(
            electrode,
            state,
            at_s,
            math.exp(7.0 + 0.1 * electrode + k * fall + drift * at_s),
            math.exp(10.0 - 0.2 * electrode - fall),
        )
        for state, fall in enumerate(falls)
        for electrode, at_s in enumerate(state * 200.0 + 40.0 * place for place in range(4))
    ]
    chance.shuffle(asked)
    found = fit(asked)
    assert found.k == pytest.approx(k, abs=1e-3)
    assert found.low <= found.k <= found.high
    assert (found.electrodes, found.states) == ((0, 1, 2, 3), 4)
    assert found.fold == pytest.approx(math.exp(1.2), abs=1e-3)


def test_states_that_are_too_alike_are_refused_with_what_to_do() -> None:
    asked = [
        msgspec.structs.replace(one, resistance_ohm=50_000.0 * (1.9 if one.state % 2 else 1.0))
        for one in asked_of(random.Random(1), 1.0)
    ]
    with pytest.raises(NoFit, match=r"only 1.9 times .* 2 times are needed: breathe"):
        fit(asked)


def test_a_resistance_that_only_falls_cannot_be_told_from_adaptation() -> None:
    asked = [
        msgspec.structs.replace(one, resistance_ohm=200_000.0 * math.exp(-one.at_s / 600.0))
        for one in asked_of(random.Random(1), 1.0)
    ]
    with pytest.raises(NoFit, match="become dry again"):
        fit(asked)


def test_too_few_states_or_electrodes_and_gaps_are_refused() -> None:
    asked = asked_of(random.Random(1), 1.0)
    with pytest.raises(NoFit, match=r"6 electrodes in 3 states .* 4 in 4 are needed"):
        fit([one for one in asked if one.state < 3])
    with pytest.raises(NoFit, match="3 electrodes in 5 states"):
        fit([one for one in asked if one.electrode < 3])
    first = asked[0].electrode
    fit([one for one in asked if (one.electrode, one.state) != (first, 1)])
    with pytest.raises(NoFit, match=rf"electrode {first} has a threshold in 3 states, and 4 are"):
        fit([one for one in asked if one.electrode != first or one.state not in (1, 3)])
    with pytest.raises(NoFit, match="0 electrodes"):
        fit([])


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"low": -0.1}, "has zero in it"),
        ({"explained": 0.49}, "explains 49% of what time leaves .* less than 50%"),
        ({"explained_of_all": 0.49}, "explains 49% of all that thresholds did, less than 50%"),
        ({"explained_of_all": None}, "before it was kept how much .* of all .* measure it again"),
        ({"low": 0.6, "high": 50.0}, r"0\.60 to 50\.00, ends further from k than zero"),
        ({"low": 0.01, "high": 1.9}, "ends further from k than zero"),
        ({"k": -0.7, "low": -1.5, "high": -0.1}, "thresholds rise with the resistance"),
        ({"k": -0.2, "low": -0.3, "high": -0.1}, "a board's leak does that by itself"),
        ({"k": -0.5, "low": -0.55, "high": -0.44}, "more than a board's leak makes them"),
        ({"k": 0.0, "low": 0.0, "high": 0.0}, "or do not follow it"),
        ({"k": 0.29, "low": 0.2, "high": 0.4}, r"is less than 0\.3: a board's leak"),
        ({"k": 2.1, "high": 2.5}, "is not believed"),
        ({"low": 0.8}, "lies outside of its interval"),
        ({"fold": 1.9}, "changed 1.9-fold, and 2-fold is needed"),
        ({"electrodes": (0, 1, 2)}, "of 3 electrodes, and at least 4"),
        ({"board": None}, "before its board was kept with it"),
        ({"leak_ohm": None}, "measure it again"),
    ],
)
def test_an_exponent_that_is_not_known_well_is_not_for_this_person(
    changes: dict[str, object], why: str
) -> None:
    fields = {name: getattr(exponent(0.7), name) for name in FittedExponent.__struct_fields__}
    poor = FittedExponent(**{**fields, **changes})
    assert poor.why_not is not None
    assert re.search(why, poor.why_not)
    with fitted_site() as rig:
        made = calibration(rig, (3_000,) * 8, exponent=poor)
        assert usable_k(poor, BOARD, LEAK_OHM, DAY) is None
        answer = open_calibrated(rig, made)
        assert answer.error == "bad_calibration"
        assert "power_law is not for this person: k = " in answer.reason
        assert poor.why_not in answer.reason


def test_where_a_site_has_power_law_nobody_without_a_k_gets_a_lease() -> None:
    with fitted_site() as rig:
        for by in (
            {"calibrations": rig.wanted(calibration(rig, (3_000,) * 8))},
            {"limits": Limits(max_current_ua=3_000, width_us=100)},
        ):
            answer = rig.ask(OpenLease, lease=LEASE, client="test", **by)
            assert answer.error == "bad_calibration"
            assert "etd calibrate CODE --fit" in answer.reason
        answer = open_calibrated(rig, calibration(rig, (3_000,) * 8, exponent=exponent(0.7)))
        assert answer.error is None


@pytest.mark.parametrize("other", [{"board": "reference-hv507"}, {"leak_ohm": 33_000}])
def test_a_k_that_was_measured_with_another_board_is_not_for_this_one(
    other: dict[str, object],
) -> None:
    elsewhere = msgspec.structs.replace(exponent(0.7), **other)
    assert elsewhere.why_not is None
    with fitted_site() as rig:
        answer = open_calibrated(rig, calibration(rig, (3_000,) * 8, exponent=elsewhere))
        assert answer.error == "bad_calibration"
        assert "this is kajimoto-hv507 with 66000 ohm, and a board's leak" in answer.reason
        assert "etd calibrate CODE --fit" in answer.reason
    assert usable_k(elsewhere, BOARD, LEAK_OHM, elsewhere.date) is None
    # Nor does another law go by it.
    for each, k in ((elsewhere, None), (exponent(0.7), 0.7)):
        with closing(engine_rig.make(electrodes=8)) as rig:
            assert open_calibrated(rig, calibration(rig, (3_000,) * 8, exponent=each)).error is None
            assert rig.engine.components.adapter.estimate(0, rig.clock.now_ns()).exponent == k
    assert usable_k(exponent(0.7), BOARD, LEAK_OHM, exponent(0.7).date) == 0.7


def test_a_k_of_before_its_calibration_is_not_for_this_person() -> None:
    """It was measured with another one, or its date is wrong."""
    made_on = datetime.date(2025, 1, 15)
    early = msgspec.structs.replace(exponent(0.7), date=datetime.date(2025, 1, 14))
    assert early.why_not is None
    assert usable_k(early, BOARD, LEAK_OHM, made_on) is None
    with fitted_site() as rig:
        made = calibration(rig, (3_000,) * 8, exponent=early)
        assert made.date == made_on
        answer = open_calibrated(rig, made)
        assert answer.error == "bad_calibration"
        assert "is of 2025-01-14, before the calibration" in answer.reason
        assert "etd calibrate CODE --fit" in answer.reason
    with closing(engine_rig.make(electrodes=8)) as rig:
        made = calibration(rig, (3_000,) * 8, exponent=early)
        assert open_calibrated(rig, made).error is None
        assert rig.engine.components.adapter.estimate(0, rig.clock.now_ns()).exponent is None


@pytest.mark.parametrize(("ahead", "is_usable"), [(0, True), (1, True), (2, False)])
def test_a_k_of_a_later_day_than_today_is_not_for_this_person(ahead: int, is_usable: bool) -> None:
    """But of a day ahead: midnight comes earlier in the east."""
    found = exponent(0.7)
    today = found.date - datetime.timedelta(days=ahead)
    why = found.why_not_in(datetime.date(2020, 1, 1), today)
    assert (why is None) == is_usable
    assert why is None or f"is of 2025-01-15, and today is {today}" in why
    assert found.why_not_in(datetime.date(2020, 1, 1)) is None


def drifting(k: float, drift: float, seed: int) -> list[Asked]:
    """A person whose thresholds rise all the time, by a factor of e to the `drift` in all."""
    chance, asked = random.Random(seed), []
    for state, fall in enumerate((1.0, 3.0, 1.15, 2.4, 1.1)):
        for electrode in range(6):
            at_s = state * 400.0 + electrode * 40.0
            ohm = 50e3 / fall * math.exp(chance.gauss(0.0, 0.05))
            error = drift * at_s / 2_000.0 + chance.gauss(0.0, 0.02)
            now_ua = 1_000.0 * math.pow(ohm / 50e3, -k) * math.exp(error)
            asked.append(Asked(electrode, state, at_s, now_ua, ohm))
    return asked


@pytest.mark.parametrize(("k", "drift"), [(0.35, 1.5), (0.4, 1.5), (0.5, 2.0)])
def test_what_thresholds_did_with_time_is_not_explained_by_the_resistance(
    k: float, drift: float
) -> None:
    found = fit(drifting(k, drift, 1))
    assert found.explained > 0.8, "of what time leaves it explains nearly all"
    assert found.explained_of_all is not None
    assert found.explained_of_all < 0.25
    assert found.why_not is not None
    assert "of all that thresholds did, less than 50%" in found.why_not


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.integers(0, 10**6))
def test_what_is_explained_of_all_is_what_a_law_by_k_would_take(
    k: float, drift: float, seed: int
) -> None:
    """By another way: the variance that is left within electrodes where k is corrected for."""
    asked = drifting(k, drift, seed)
    try:
        found = fit(asked)
    except NoFit:
        return
    before = after = 0.0
    for electrode in range(6):
        own = [one for one in asked if one.electrode == electrode]
        logs = [math.log(one.threshold_ua) for one in own]
        left = [math.log(one.threshold_ua * one.resistance_ohm**found.k) for one in own]
        before += statistics.pvariance(logs)
        after += statistics.pvariance(left)
    expected = max(0.0, 1.0 - after / before)
    assert found.explained_of_all == pytest.approx(expected, abs=2e-3)
