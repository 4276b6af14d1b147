"""What the node may read with nothing connected, for every board, gain and noise."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from etd.files.resources import names
from etd_hal.boardfile import Source
from etd_hal.source_rules import SourceRules
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
