"""What the node may read with nothing connected, for every board, gain and noise."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from etd.files.resources import names
from etd_hal.boardfile import Source
from etd_hal.source_rules import IDLE_MOST_V, RESTED_V, TOLERANCE, SourceRules
from stepped_board import shipped_board

SOURCES = [shipped_board(name).source for name in names("boards")]
#: Of one reading that is off by chance.
NOISE_CODES = 6


def step_v(source: Source) -> float:
    return source.node_uv_per_code / 1e6


@given(
    source=st.sampled_from(SOURCES),
    leak_ohm=st.integers(1_000, 1_000_000),
    current_ua=st.integers(1, 1_000),
    gain=st.floats(0.0, 4.0),
    noise=st.floats(-NOISE_CODES, NOISE_CODES),
)
@example(source=SOURCES[0], leak_ohm=2_680, current_ua=1_000, gain=0.5, noise=4.0)
def test_a_gain_within_a_tenth_is_let_pass_and_one_off_by_four_tenths_or_more_is_not(
    source: Source, leak_ohm: int, current_ua: int, gain: float, noise: float
) -> None:
    source = msgspec.structs.replace(source, leak_ohm=leak_ohm)
    rules = SourceRules.of(source)
    if rules.why_untold(current_ua) is not None:
        return
    volts = max(0.0, gain * current_ua * leak_ohm / 1e6 + noise * step_v(source))
    read_v = min(volts, rules.reach_v)
    fault = rules.unloaded_fault(current_ua, 0.0, read_v, read_v)
    if 0.9 <= gain <= 1.1:
        assert fault is None
    if gain < 0.6 - 1e-9 or gain > 1.4 + 1e-9:
        assert fault is not None


@pytest.mark.parametrize("source", SOURCES)
def test_a_third_of_a_probe_tells_a_gain_on_every_shipped_board(source: Source) -> None:
    assert SourceRules.of(source).why_untold(90) is None


def test_what_cannot_be_told_is_said_with_its_figures() -> None:
    source = SOURCES[0]
    rules = SourceRules.of(source)
    assert "0.7 V" in str(rules.why_untold(10))
    assert "can be read" in str(rules.why_untold(5_000))
    assert SourceRules.of(msgspec.structs.replace(source, leak_ohm=10_000)).why_untold(90)


@pytest.mark.parametrize("source", SOURCES)
def test_a_node_above_zero_before_the_pulse_and_a_source_that_begins_too_strong_are_faults(
    source: Source,
) -> None:
    rules = SourceRules.of(source)
    node_v = 90 * rules.leak_ohm / 1e6
    assert rules.unloaded_fault(90, 0.0, node_v, node_v) is None
    assert rules.unloaded_fault(90, 0.0, 2 * node_v, node_v) is not None
    standing = rules.unloaded_fault(90, rules.idle_v + 0.1, node_v, node_v)
    assert "at most" in str(standing)
    assert rules.unselected_fault(90, 0.0, node_v, node_v) is None
    stands = rules.unselected_fault(90, rules.idle_v + 0.1, node_v, node_v)
    assert "with no output selected" in str(stands)
    selected = rules.unselected_fault(90, rules.idle_v + 0.1, node_v / 2, node_v / 2)
    assert "is still on the source" in str(selected)


# --- figures by hand -----------------------------------------------------------------------------

#: 0.125 V a code, so 0.75 V of noise in one reading; 0.1 V for each uA into the leak.
PLAIN = msgspec.structs.replace(
    SOURCES[0], node_uv_per_code=125_000, compliance_v=300, leak_ohm=100_000
)
RULES = SourceRules.of(PLAIN)
LITTLE_V = 0.001


def rules(**changed: int) -> SourceRules:
    return SourceRules.of(msgspec.structs.replace(PLAIN, **changed))


@pytest.mark.parametrize(
    ("leak_ohm", "idle_v"),
    [(10_000, 1.75), (40_000, 2.0), (100_000, 5.0), (200_000, 5.0)],
    ids=["offset and noise", "50 uA", "just 5 V", "5 V whatever the leak"],
)
def test_what_an_idle_node_may_read_is_by_the_leak_between_two_bounds(
    leak_ohm: int, idle_v: float
) -> None:
    found = rules(leak_ohm=leak_ohm)
    assert found == SourceRules(leak_ohm=leak_ohm, reach_v=300.0, idle_v=idle_v, noise_v=1.5)
    assert found.idle_fault(idle_v, "with nothing connected") is None
    fault = found.idle_fault(idle_v + LITTLE_V, "with nothing connected")
    assert f"at most {idle_v:.1f} V" in str(fault)


def test_the_bounds_that_no_board_file_has() -> None:
    assert (RESTED_V, IDLE_MOST_V, TOLERANCE) == (5.0, 5.0, 0.2)


def test_a_node_comes_no_higher_than_what_the_adc_can_read() -> None:
    assert rules(node_uv_per_code=31_250).reach_v == 4_095 * 0.03125 == 127.96875


def test_a_pulse_may_lift_the_node_by_a_fifth_more_than_the_leak_says_and_by_what_stood_there() -> (
    None
):
    assert RULES.most_v(1_000, 0.0) == 121.5
    assert RULES.most_v(1_000, 3.0) == 124.5


@pytest.mark.parametrize(("current_ua", "is_told"), [(74, False), (75, True)])
def test_noise_hides_a_gain_above_a_tenth_of_what_the_node_comes_to(
    current_ua: int, *, is_told: bool
) -> None:
    assert (RULES.why_untold(current_ua) is None) is is_told


@pytest.mark.parametrize(("current_ua", "is_told"), [(1_995, True), (1_996, False)])
def test_a_gain_that_is_a_fifth_too_much_must_be_within_reach(
    current_ua: int, *, is_told: bool
) -> None:
    """249.375 V, a fifth more, and the noise are just 300 V."""
    why = rules(leak_ohm=125_000).why_untold(current_ua)
    assert (why is None) is is_told
    assert is_told or "no more than 300.0 V can be read" in str(why)


Judge = Callable[[SourceRules, int, float, float, float], object]


@pytest.mark.parametrize("judge", [SourceRules.unloaded_fault, SourceRules.unselected_fault])
def test_an_unloaded_node_is_a_fifth_and_its_noise_about_what_the_leak_says(judge: Judge) -> None:
    least_v, most_v = 79.25, 120.75
    for early_v, voltage_v in ((0.0, least_v), (most_v, most_v), (most_v, 100.0)):
        assert judge(RULES, 1_000, 0.0, early_v, voltage_v) is None
    for early_v, voltage_v in (
        (0.0, least_v - LITTLE_V),
        (0.0, most_v + LITTLE_V),
        (most_v + LITTLE_V, 100.0),
    ):
        fault = judge(RULES, 1_000, 0.0, early_v, voltage_v)
        assert "79.2 to 120.8 V, current x leak" in str(fault)
    assert "with the DAC at zero" in str(judge(RULES, 1_000, 5.0 + LITTLE_V, 0.0, 100.0))
