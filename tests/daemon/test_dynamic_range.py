"""Narrow pulses, prepulses and bursts as rules: what they ask for, before any limit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_parts import board_file
from etd.pulse.request import SHORTEST_US, PulseRequest
from etd.stabilize.bursts import Bursts, groups
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings, check_settings, pipeline
from etd.stabilize.strength_duration import StrengthDuration, strength
from etd_hal.errors import FileError

KNOWN = ElectrodeEstimate(3)
NARROW = StrengthDuration(width_us=50, tau_us=151.0)

requests = st.builds(PulseRequest, st.integers(0, 10_000), st.integers(SHORTEST_US, 200))


# --- narrow ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("width_us", "rheobases"), [(20, 8.06), (30, 5.55), (50, 3.55), (100, 2.06), (200, 1.36)]
)
def test_the_current_at_threshold_follows_the_curve(width_us: int, rheobases: float) -> None:
    assert strength(width_us, 151.0) == pytest.approx(rheobases, abs=0.005)


def test_the_energy_is_least_at_1_4_times_the_rheobase() -> None:
    widths_us = [step / 10 for step in range(500, 4_000)]
    best_us = min(widths_us, key=lambda value: strength(value, 151.0) ** 2 * value)
    assert strength(best_us, 151.0) == pytest.approx(1.4, abs=0.005)
    assert best_us == pytest.approx(1.256 * 151.0, abs=0.5)


def test_a_wide_pulse_becomes_a_narrow_and_stronger_one() -> None:
    assert NARROW.adapt(PulseRequest(1_000, 200), KNOWN) == PulseRequest(2_604, 50)


def test_a_narrow_one_stays_as_it_is() -> None:
    assert NARROW.adapt(PulseRequest(1_000, 50), KNOWN) == PulseRequest(1_000, 50)
    assert NARROW.adapt(PulseRequest(1_000, 20), KNOWN) == PulseRequest(1_000, 20)


@given(requests, st.integers(SHORTEST_US, 200), st.floats(50.0, 2_000.0))
def test_a_narrow_pulse_never_has_more_charge_or_width(
    pulse_request: PulseRequest, width_us: int, tau_us: float
) -> None:
    asked = StrengthDuration(width_us=width_us, tau_us=tau_us).adapt(pulse_request, KNOWN)
    assert asked.width_us <= pulse_request.width_us
    assert asked.current_ua * asked.width_us <= pulse_request.current_ua * pulse_request.width_us
    assert asked.is_possible


# --- prepulse -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("below_db", "ua"), [(2.0, 794), (4.0, 630), (6.0, 501), (8.0, 398), (10.0, 316)]
)
def test_a_prepulse_is_so_many_decibels_below_its_pulse(below_db: float, ua: int) -> None:
    asked = Prepulse(below_db=below_db, width_us=60).adapt(PulseRequest(1_000, 100), KNOWN)
    assert asked == PulseRequest(1_000, 100, ua, 60)


@given(requests, st.floats(2.0, 10.0))
def test_a_prepulse_is_weaker_than_its_pulse_and_leaves_it_as_it_is(
    pulse_request: PulseRequest, below_db: float
) -> None:
    asked = Prepulse(below_db=below_db, width_us=40).adapt(pulse_request, KNOWN)
    assert (asked.current_ua, asked.width_us) == (pulse_request.current_ua, pulse_request.width_us)
    assert asked.prepulse_ua <= math.ceil(0.8 * pulse_request.current_ua)
    assert asked.is_possible


@pytest.mark.parametrize(
    "pulse_request",
    [PulseRequest(500, 100, 501, 40), PulseRequest(500, 100, -1, 40), PulseRequest(5, 50, 1, -1)],
)
def test_a_prepulse_that_is_none_is_no_possible_wish(pulse_request: PulseRequest) -> None:
    assert not pulse_request.is_possible


# --- bursts ---------------------------------------------------------------------------------------


def slots_of_250_us(group: Sequence[int]) -> float:
    return 250.0 * len(group)


def test_as_many_electrodes_share_a_burst_as_fit_into_its_interval() -> None:
    found = groups(range(64), Bursts(pulses=6, rate_hz=350.0).interval_us, slots_of_250_us)
    assert found is not None
    assert [len(entry) for entry in found] == [11, 11, 11, 11, 10, 10]
    assert found[0] == tuple(range(0, 64, 6))


@given(st.integers(1, 256), st.floats(250.0, 100_000.0))
def test_everybody_is_in_one_group_and_each_round_fits(count: int, interval_us: float) -> None:
    found = groups(range(count), interval_us, slots_of_250_us)
    assert found is not None
    assert sorted(electrode for group in found for electrode in group) == list(range(count))
    assert all(slots_of_250_us(entry) <= interval_us for entry in found)


def test_where_not_even_one_fits_there_is_no_burst() -> None:
    assert groups(range(4), 249.0, slots_of_250_us) is None


# --- settings -------------------------------------------------------------------------------------


def test_the_pipeline_has_the_order_of_the_file() -> None:
    prepulse = Prepulse(below_db=6.0, width_us=40)
    settings = Settings(
        order=("strength_duration", "prepulse"), strength_duration=NARROW, prepulse=prepulse
    )
    check_settings(settings, "site.toml")
    assert pipeline(settings, board_file().source) == (NARROW, prepulse)
    assert pipeline(Settings(), board_file().source) == ()


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (Settings(strength_duration=NARROW), "stabilize.strength_duration"),
        (Settings(order=("prepulse",)), "stabilize.prepulse"),
        (
            Settings(order=("strength_duration", "strength_duration"), strength_duration=NARROW),
            "stabilize.order",
        ),
        (
            Settings(
                order=("prepulse", "strength_duration"),
                strength_duration=NARROW,
                prepulse=Prepulse(below_db=6.0, width_us=40),
            ),
            "stabilize.order",
        ),
    ],
)
def test_a_table_that_says_two_things_is_refused(settings: Settings, key: str) -> None:
    with pytest.raises(FileError) as caught:
        check_settings(settings, "site.toml")
    assert caught.value.key == key
