"""A calibration in words: what `etd calibration show` and the end of a calibration say of it."""

from __future__ import annotations

import datetime

import pytest
from msgspec.structs import replace

from engine_parts import calibration
from engine_scenes import exponent
from etd.cli.calibration_shown import conditions_in_words, table_of
from etd.cli.doubts import doubts_of
from etd.protocol.adaptation import MeasuredAdaptation

MADE = calibration(3)
FITTED = exponent(0.8)


TODAY = datetime.date(2026, 1, 15)


def said(**conditions: object) -> str:
    line, *_ = conditions_in_words(conditions, MADE.date, TODAY)
    return line


def test_a_figure_has_its_unit() -> None:
    assert said(rate_hz=60.0).endswith(" 60 Hz")
    assert said(width_us=100).endswith(" 100 us")
    assert said(largest_cap_ua=900).endswith(" 900 uA")
    assert said(skin_celsius=31.5).endswith(" 31.5 C")
    assert "12% of the silent trials" in said(false_alarm_rate=0.12)
    assert said(seed=None).endswith(" not given")


def test_a_drift_is_said_in_percent_and_of_what() -> None:
    assert "the first electrode's threshold had risen by 42%" in said(drift=0.42)
    assert "fallen by 8%" in said(drift=-0.08)
    least = said(drift=0.0, is_drift_least=True)
    assert "risen by at least 0% (it was not felt up to its cap)" in least


def test_what_use_did_is_said_with_what_follows_of_it() -> None:
    found = MeasuredAdaptation(answers=20, weaker=16, stronger=1, use_s=600.0, date=TODAY)
    line = said(adaptation=found)
    assert "in the second half of 600 s of use, 16 of 20 answers were weaker, 1 stronger" in line
    assert "2026-01-15: the person's word may raise levels, by at most 5 % a minute" in line
    assert "raises nothing: below 60% weaker" in said(adaptation=replace(found, weaker=11))
    later = replace(found, date=datetime.date(2099, 1, 1))
    doubted = said(adaptation=later)
    assert "may raise levels" in doubted, "by the engine, which knows no date"
    assert "in doubt: it is of 2099-01-01, and today is" in doubted
    assert "MeasuredAdaptation" not in line


def test_an_exponent_is_said_with_its_interval_and_whether_it_may_be_used() -> None:
    line = said(exponent=FITTED)
    assert "k = 0.80 (0.64 to 0.96); it explains 80% of all that thresholds of 4 elec" in line
    assert "did in 4 states, and 90% of what a line over time leaves of it; the skin's" in line
    assert "changed 3.0-fold; 2025-01-15: may be used with kajimoto-hv507" in line
    before = said(exponent=replace(FITTED, explained_of_all=None))
    assert "explains 90% of what a line over time leaves of what thresholds" in before
    assert "not for this person" in before
    assert "12% of the silent trials were felt" in said(
        exponent=replace(FITTED, catch_trials=40, false_alarm_rate=0.12)
    )
    doubted = said(exponent=replace(FITTED, date=datetime.date(2099, 1, 1)))
    assert "may be used with kajimoto-hv507" in doubted
    assert "in doubt: k = 0.80 is of 2099-01-01, and today is 2026-01-15" in doubted
    refused = said(exponent=replace(FITTED, low=-0.1))
    assert "not for this person: k = 0.80" in refused
    assert "has zero in it" in refused
    assert "FittedExponent" not in line + refused


def test_what_it_feels_like_and_where_stands_beside_its_electrode() -> None:
    felt = replace(MADE.electrode[1], quality="prickling", place="around")
    unfelt = replace(MADE.electrode[2], felt=False)
    rows = table_of(replace(MADE, electrode=(MADE.electrode[0], felt, unfelt)))
    assert rows[1].endswith("ohm") or rows[1].endswith("not known")
    assert rows[2].endswith("  prickling  around the electrode")
    assert rows[3].endswith("  not felt")


@pytest.mark.parametrize(("drift", "is_said"), [(0.42, True), (-0.3, True), (0.2, False)])
def test_a_large_drift_is_repeated_in_the_end(drift: float, is_said: bool) -> None:
    found = doubts_of(replace(MADE, drift=drift))
    assert bool(found) == is_said
    assert all("when it was last asked again, more than 20%" in each for each in found)


@pytest.mark.parametrize("drift", [0.1, 0.0])
def test_a_drift_of_at_least_so_much_is_said_so_however_little_that_is(drift: float) -> None:
    (found,) = doubts_of(replace(MADE, drift=drift, is_drift_least=True))
    assert f"risen by at least {drift:.0%} (it was not felt up to its cap)" in found
    assert "more than" not in found
    assert "let P01 rest" in found


@pytest.mark.parametrize(("rate", "is_said"), [(0.125, True), (0.1, False), (None, False)])
def test_who_feels_silence_while_k_is_measured_is_told_of(rate: float, is_said: bool) -> None:
    fitted = replace(FITTED, catch_trials=40, false_alarm_rate=rate)
    found = doubts_of(replace(MADE, exponent=fitted))
    assert bool(found) == is_said
    assert all("felt 12% of 40 silent trials, more than 10%, while k was" in one for one in found)


def test_a_calibration_of_a_day_to_come_is_in_doubt() -> None:
    assert doubts_of(MADE, MADE.date) == []
    (found,) = doubts_of(MADE, MADE.date - datetime.timedelta(days=1))
    assert f"it is of {MADE.date}" in found
    assert "one of the two is wrong" in found


def test_nothing_is_doubted_without_a_reason() -> None:
    assert doubts_of(MADE) == []


def test_who_is_not_felt_within_its_cap_is_named_with_both_currents() -> None:
    below = replace(MADE.electrode[2], felt=False, felt_from_ua=9_000)
    made = replace(MADE, electrode=(*MADE.electrode[:2], below), false_alarm_rate=None)
    (found,) = doubts_of(made)
    assert f"electrode 2 (felt from 9000 uA on, its cap is {below.cap_ua} uA)" in found
    assert table_of(made)[3].endswith("not felt within its cap, felt from 9000 uA on")
