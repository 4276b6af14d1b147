"""What the samples of a pulse tell of the skin, and when they are not believed."""

from __future__ import annotations

import math
import random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_parts import board_file
from etd.protocol.calibration import ElectrodeLimits, resisted_as_skin
from etd.pulse.measured import MAX_AGE_NS, MAX_SKIN_OHM, MIN_SKIN_OHM
from etd.safety.conductance import BEFORE_END_US, EARLY_US
from etd.sensing.impedance import ImpedanceMap, Samples

LEAK_OHM, COMPLIANCE_V = 66_000.0, 300.0


def pulse(
    skin_ohm: float,
    capacitance_nf: float = 0.3,
    *,
    commanded_ua: int = 2_000,
    width_us: float = 100.0,
    series_ohm: float = 2_000.0,
    noise: float = 1.0,
) -> Samples:
    """By the circuit: the current source with its leak, Rs, and Rp beside Cp."""
    parallel_ohm = skin_ohm - series_ohm
    way_ohm = series_ohm + LEAK_OHM
    tau_us = capacitance_nf * 1e-3 * parallel_ohm * way_ohm / (parallel_ohm + way_ohm)
    end_v = commanded_ua / 1e6 / (1 / skin_ohm + 1 / LEAK_OHM)
    begin_v = commanded_ua / 1e6 / (1 / series_ohm + 1 / LEAK_OHM)

    def node_v(t_us: float) -> float:
        return noise * (end_v - (end_v - begin_v) * math.exp(-t_us / tau_us))

    has_end = width_us >= 33
    return Samples(
        commanded_ua,
        width_us,
        0.0,
        node_v(EARLY_US),
        node_v(width_us - BEFORE_END_US) if has_end else None,
    )


def impedances() -> ImpedanceMap:
    source = board_file().source
    assert (source.leak_ohm, source.compliance_v) == (LEAK_OHM, COMPLIANCE_V)
    return ImpedanceMap(4, source)


@pytest.mark.parametrize("skin_ohm", [10_000, 25_000, 50_000, 100_000])
@pytest.mark.parametrize("width_us", [35.0, 50.0, 200.0])
def test_two_samples_tell_resistance_and_capacitance(skin_ohm: int, width_us: float) -> None:
    found = impedances()
    assert found.update(1, pulse(skin_ohm, width_us=width_us), 0) is None
    assert found.skin_ohm(1, 0) == pytest.approx(skin_ohm, rel=0.03)
    assert found.capacitance_nf(1, 0) == pytest.approx(0.3, rel=0.05)
    assert found.at_ua(1) == 2_000


@pytest.mark.parametrize("series_ohm", [1_000, 3_000])
def test_what_is_assumed_of_the_series_part_costs_little(series_ohm: int) -> None:
    found = impedances()
    found.update(1, pulse(50_000, series_ohm=series_ohm), 0)
    assert found.skin_ohm(1, 0) == pytest.approx(50_000, rel=0.01)
    assert found.capacitance_nf(1, 0) == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("near_ohm", [MIN_SKIN_OHM, MAX_SKIN_OHM])
@given(commanded_ua=st.integers(301, 8_000), apart=st.floats(-2e-3, 2e-3) | st.just(0.0))
def test_what_is_told_of_skin_is_what_a_calibration_may_say(
    near_ohm: float, commanded_ua: int, apart: float
) -> None:
    """Also at the very bounds: `etd calibrate` writes what was told."""
    skin_ohm = near_ohm * (1.0 + apart)
    end_v = commanded_ua / 1e6 / (1 / skin_ohm + 1 / LEAK_OHM)
    found = ImpedanceMap(4, msgspec.structs.replace(board_file().source, compliance_v=600))
    found.update(1, Samples(commanded_ua, 100.0, 0.0, end_v, end_v), 0)
    told_ohm, _ = found.reported_ohm_nf(1, 0)
    limits = ElectrodeLimits(threshold_ua=1, comfortable_ua=1, cap_ua=1, resistance_ohm=told_ohm)
    assert resisted_as_skin(limits)
    assert (told_ohm is None) == (not MIN_SKIN_OHM <= skin_ohm <= MAX_SKIN_OHM) or abs(apart) < 1e-9


def test_a_pulse_without_an_end_sample_goes_by_the_time_constant_of_wider_ones() -> None:
    found = impedances()
    found.update(1, pulse(30_000, 1.0), 0)
    found.update(1, pulse(30_000, 1.0, width_us=25.0), 0)
    assert found.skin_ohm(1, 0) == pytest.approx(30_000, rel=0.05)


def test_without_a_wider_pulse_it_is_an_estimate_with_an_assumed_time_constant() -> None:
    found = impedances()
    found.update(1, pulse(50_000, width_us=25.0), 0)
    assert found.skin_ohm(1, 0) == pytest.approx(50_000, rel=0.1)
    assert found.capacitance_nf(1, 0) is None


def test_a_node_that_is_not_at_rest_before_the_pulse_is_not_believed() -> None:
    found = impedances()
    found.update(1, pulse(50_000), 0)
    stuck = Samples(2_000, 100.0, 57.0, 57.0, 57.0)
    assert found.update(1, stuck, 0) == "adc"
    assert found.skin_ohm(1, 0) is None
    assert found.update(1, stuck, 0) is None, "it is told once"
    found.update(1, pulse(50_000), 0)
    assert found.skin_ohm(1, 0) == pytest.approx(50_000, rel=0.03)


@given(
    volts=st.floats(0.1, 60.0), commanded_ua=st.integers(301, 8_000), width_us=st.integers(20, 200)
)
def test_a_value_that_stands_still_is_never_believed_whatever_it_is(
    volts: float, commanded_ua: int, width_us: int
) -> None:
    found = impedances()
    found.update(1, pulse(50_000), 0)
    end_v = volts if width_us >= 33 else None
    assert found.update(1, Samples(commanded_ua, width_us, volts, volts, end_v), 0) == "adc"
    assert (found.skin_ohm(1, 0), found.last_ohm(1)) == (None, None)


@pytest.mark.parametrize(("resting_v", "is_believed"), [(0.27, True), (0.36, False)])
def test_a_weak_pulse_may_have_an_offset_before_it_and_no_more(
    resting_v: float, is_believed: bool
) -> None:
    found = impedances()
    quality = found.update(1, Samples(350, 100.0, resting_v, 0.8, 0.9), 0)
    assert quality == (None if is_believed else "adc")


def test_what_charge_is_left_in_the_skin_is_no_doubt_and_what_no_skin_keeps_is() -> None:
    found = impedances()
    assert found.update(1, Samples(500, 100.0, 2.6, 9.0, 10.5), 0) is None
    assert found.update(1, Samples(500, 100.0, 3.6, 9.0, 10.5), 0) == "adc"
    assert found.update(2, Samples(2_000, 100.0, 5.1, 50.0, 60.0), 0) == "adc"


def test_what_a_probe_left_in_the_skin_is_no_doubt_and_more_than_it_made_is() -> None:
    found = impedances()
    assert found.update(1, Samples(400, 100.0, 5.4, 9.0, 13.0, probed_v=11.0), 0) is None
    assert found.update(1, Samples(400, 100.0, 11.2, 12.0, 13.0, probed_v=11.0), 0) == "adc"
    assert found.update(2, Samples(400, 100.0, 9.0, 9.0, 9.0, probed_v=11.0), 0) == "adc"


@pytest.mark.parametrize(
    ("end_v", "quality"), [(0.0, "implausible"), (1.0, "implausible"), (131.9, "implausible")]
)
def test_a_resistance_that_no_skin_has_is_not_believed(end_v: float, quality: str) -> None:
    found = impedances()
    assert found.update(1, Samples(2_000, 100.0, 0.0, end_v, end_v), 0) == quality
    assert found.skin_ohm(1, 0) is None


def test_a_source_at_its_end_tells_nothing() -> None:
    found = impedances()
    assert found.update(1, Samples(8_000, 100.0, 0.0, 280.0, 290.0), 0) == "compliance"
    assert found.skin_ohm(1, 0) is None


def test_readings_that_flicker_are_noise_and_those_that_drift_or_step_are_not() -> None:
    flickering, drifting, stepping = impedances(), impedances(), impedances()
    doubts = [
        flickering.update(1, pulse(50_000, noise=1.0 if step % 2 else 0.75), 0)
        for step in range(20)
    ]
    assert doubts.count("flicker") == 1
    assert doubts.index("flicker") <= 4
    assert flickering.skin_ohm(1, 0) is None
    for step in range(20):
        assert drifting.update(1, pulse(50_000 * 0.97**step), 0) is None
        assert stepping.update(1, pulse(50_000 if step < 10 else 25_000), 0) is None
    assert stepping.skin_ohm(1, 0) == pytest.approx(25_000, rel=0.03)


@pytest.mark.parametrize("period_ms", [16, 100])
def test_an_edge_that_comes_off_once_and_lies_down_again_is_believed_all_the_while(
    period_ms: int,
) -> None:
    found, now_ns = impedances(), 0
    for kohm in (*(37,) * 10, 120, 50, 48, 45, 43, 42, 41, 40, *(37,) * 10, 100, 90, 36, 37):
        now_ns += period_ms * 1_000_000
        assert found.update(1, pulse(kohm * 1_000), now_ns) is None
        assert found.skin_ohm(1, now_ns) == pytest.approx(kohm * 1_000, rel=0.25)


@pytest.mark.parametrize("period_ms", [16, 100])
def test_noise_is_told_once_however_it_comes_and_goes_and_again_after_a_calm(
    period_ms: int,
) -> None:
    """Random, so that some pulses look well; and some of them no skin could have."""
    found, chance, now_ns = impedances(), random.Random(7), 0
    told: list[str | None] = []
    for is_noisy in (True,) * 60 + (False,) * 200 + (True,) * 60:
        now_ns += period_ms * 1_000_000
        noise = chance.choice([0.3, 0.7, 1.0, 1.0, 1.3, 2.4]) if is_noisy else 1.0
        told.append(found.update(1, pulse(50_000, noise=noise), now_ns))
        if len(told) == 255:
            assert found.skin_ohm(1, now_ns) is not None
    for half in (told[:260], told[260:]):
        assert half.count("flicker") == 1
        assert half.count("implausible") <= 2, "a second may lie between two of them"


def test_small_noise_is_averaged_and_a_step_is_taken_at_once() -> None:
    found = impedances()
    for step in range(20):
        found.update(1, pulse(50_000, noise=1.01 if step % 2 else 0.99), 0)
    assert found.skin_ohm(1, 0) == pytest.approx(50_000, rel=0.015)
    found.update(1, pulse(80_000), 0)
    assert found.skin_ohm(1, 0) == pytest.approx(80_000, rel=0.03)


def test_forgetting_leaves_everything_unknown() -> None:
    found = impedances()
    found.update(1, pulse(50_000), 0)
    found.reset()
    assert found.skin_ohm(1, 0) is None


# --- how long it is known -----------------------------------------------------------------------


def test_what_no_pulse_has_told_for_a_second_is_not_known() -> None:
    found = impedances()
    found.update(1, pulse(50_000), 0)
    assert found.skin_ohm(1, MAX_AGE_NS - 1) is not None
    assert not found.is_expired(1, MAX_AGE_NS - 1)
    assert found.skin_ohm(1, MAX_AGE_NS) is None
    assert found.capacitance_nf(1, MAX_AGE_NS) is None
    assert found.is_expired(1, MAX_AGE_NS)
    assert found.last_ohm(1) == pytest.approx(50_000, rel=0.03), "for a probe to compare with"
    assert not found.is_expired(2, MAX_AGE_NS), "nobody ever knew anything of it"


def test_after_a_pause_the_next_pulse_counts_alone() -> None:
    found = impedances()
    for step in range(20):
        found.update(1, pulse(50_000), step)
    found.update(1, pulse(45_000), MAX_AGE_NS + 20)
    assert found.skin_ohm(1, MAX_AGE_NS + 20) == pytest.approx(45_000, rel=0.01)


def test_after_a_pause_a_time_constant_of_another_contact_is_not_used() -> None:
    found = impedances()
    found.update(1, pulse(30_000, 1.0), 0)
    found.update(1, pulse(50_000, width_us=25.0), MAX_AGE_NS)
    assert found.skin_ohm(1, MAX_AGE_NS) == pytest.approx(50_000, rel=0.1)


def test_what_flickers_is_no_more_believed_after_a_pause_than_before() -> None:
    found = impedances()
    for step in range(20):
        found.update(1, pulse(50_000, noise=1.0 if step % 2 else 0.75), step)
    found.update(1, pulse(50_000), MAX_AGE_NS + 20)
    assert found.skin_ohm(1, MAX_AGE_NS + 20) is None
    for step in range(20):
        found.update(1, pulse(50_000), MAX_AGE_NS + 21 + step)
    assert found.skin_ohm(1, MAX_AGE_NS + 41) is not None


def test_noise_that_lasts_longer_than_what_is_believed_ends_with_the_noise() -> None:
    found, now_ns = impedances(), 0
    for step in range(60):
        now_ns = step * 100_000_000
        is_noisy = step < 40
        found.update(1, pulse(50_000, noise=0.75 if is_noisy and step % 2 else 1.0), now_ns)
    assert found.skin_ohm(1, now_ns) is not None


@pytest.mark.parametrize(("period_ms", "pulses"), [(100, 2), (16, 12)])
def test_the_mean_follows_the_skin_as_fast_where_pulses_are_rare(
    period_ms: int, pulses: int
) -> None:
    found = impedances()
    found.update(1, pulse(50_000), 0)
    for number in range(1, pulses + 1):
        found.update(1, pulse(60_000), number * period_ms * 1_000_000)
    at_ns = pulses * period_ms * 1_000_000
    assert found.skin_ohm(1, at_ns) == pytest.approx(60_000, rel=0.01)
