"""When a rail was cut, reckoned from how it falls."""

from __future__ import annotations

from collections.abc import Callable
from math import exp

import pytest

from board_rig import changed
from etd.selftest.fall import Reading, reckon_cut
from etd.selftest.report import unproved_of
from stepped_board import shipped_board

CUT_MS = 43.0
FROM_V = 300.0
#: Until a tenth is left.
FALL_MS = 3_500.0


def read(volts_after: Callable[[float], float], every_ms: float) -> list[Reading]:
    """As long as it falls; the first reading is before the cut."""
    count = int((CUT_MS + FALL_MS) / every_ms)
    times_ms = [number * every_ms for number in range(count)]
    return [(ms, volts_after(ms - CUT_MS) if ms > CUT_MS else FROM_V) for ms in times_ms]


def by_a_bleeder(tau_ms: float) -> Callable[[float], float]:
    return lambda ms: FROM_V * exp(-ms / tau_ms)


def steadily(ms: float) -> float:
    return max(0.0, FROM_V * (1 - 0.9 * ms / FALL_MS))


@pytest.mark.parametrize("tau_ms", [30.0, 100.0, 875.0, 1_500.0])
@pytest.mark.parametrize("every_ms", [1.0, 3.0, 13.0])
def test_the_cut_of_a_store_with_a_bleeder_is_found(tau_ms: float, every_ms: float) -> None:
    cut_ms = reckon_cut(read(by_a_bleeder(tau_ms), every_ms), FROM_V)
    assert cut_ms is not None
    is_reckoned = tau_ms * 0.085 > 3 * every_ms
    assert cut_ms == pytest.approx(CUT_MS, abs=0.01 if is_reckoned else 2 * every_ms)


@pytest.mark.parametrize("every_ms", [1.0, 3.0, 13.0])
def test_that_of_a_steady_fall_is_late_by_no_more_than_is_stated(every_ms: float) -> None:
    cut_ms = reckon_cut(read(steadily, every_ms), FROM_V)
    assert cut_ms is not None
    assert 0 < cut_ms - CUT_MS < 0.002 * FALL_MS


@pytest.mark.parametrize("noise_v", [-0.3, 0.3])
def test_noise_of_a_thousandth_moves_it_by_about_a_ms(noise_v: float) -> None:
    readings = read(by_a_bleeder(875.0), 3.0)
    noisy = [(ms, volts + noise_v * (-1) ** number) for number, (ms, volts) in enumerate(readings)]
    assert reckon_cut(noisy, FROM_V) == pytest.approx(CUT_MS, abs=1.5)
    assert reckon_cut(noisy, FROM_V + noise_v) == pytest.approx(CUT_MS, abs=2.5)


def test_a_rail_that_stays_was_not_cut() -> None:
    assert reckon_cut([(ms, FROM_V) for ms in range(100)], FROM_V) is None
    assert reckon_cut([], FROM_V) is None


def test_a_fall_that_is_over_at_once_is_cut_when_it_is_seen() -> None:
    assert reckon_cut([(1.0, FROM_V), (4.0, 0.0), (7.0, 0.0)], FROM_V) == 4.0


def test_who_cannot_see_how_soon_a_stop_cuts_says_so() -> None:
    watched = shipped_board("reference-hv507")
    assert not any("the delay from a stop" in text for text in unproved_of(watched))
    relays = shipped_board("feetthrough-relay")
    assert not any("the delay from a stop" in text for text in unproved_of(relays))
    with_a_stop = changed(relays, "guards", emergency_stop=17)
    assert any("the delay from a stop" in text for text in unproved_of(with_a_stop))
