"""What the samples of one pulse tell of its path, to the ohm."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import pytest

from etd.safety.conductance import PathMeter, PathSamples, Reading
from path_readings import METER, SOURCE

STEP_V = 0.0893
#: 0.95 of 300 V.
NEAR_V = 285.0
BELOW_V = math.nextafter(NEAR_V, 0.0)
#: The codes of 100 uA (nearly), 2 mA, 4 mA and all.
WEAK, MIDDLE, STRONG, FULL = 41, 819, 1_638, 4_095
#: An ADC whose steps are nothing.
FINE = PathMeter(msgspec.structs.replace(SOURCE, node_uv_per_code=0))


def current_a(code: int) -> float:
    return code * 10e-3 / 4_095


def path_ohm(code: int, node_v: float) -> float:
    """Beside the leak of 66 k."""
    return 1.0 / (current_a(code) / node_v - 1.0 / 66e3)


def wide(
    code: int, early_v: float, last_v: float, width_us: float = 100.0, resting_v: float = 0.0
) -> PathSamples:
    return PathSamples(code, width_us, True, False, resting_v, early_v, last_v)


def short(code: int, node_v: float, resting_v: float = 0.0) -> PathSamples:
    return PathSamples(code, 20.0, False, False, resting_v, node_v, node_v)


def behind_a_step(code: int, last_v: float, resting_v: float = 0.0) -> PathSamples:
    return PathSamples(code, 100.0, True, True, resting_v, 1.0, last_v)


def read(samples: PathSamples, before: Reading | None = None, by: PathMeter = METER) -> Reading:
    reading = by.read(samples, before)
    assert reading is not None
    return reading


# --- whole pulses --------------------------------------------------------------------------------


@pytest.mark.parametrize(("resting_v", "left_v"), [(1.5, 1.5), (0.0, 0.0), (-1.5, 0.0)])
def test_the_least_is_by_a_step_less_and_less_by_what_the_node_had_before(
    resting_v: float, left_v: float
) -> None:
    reading = read(wide(MIDDLE, 40.0, 50.0, resting_v=resting_v))
    assert reading.current_ua == pytest.approx(2_000.0, rel=1e-9)
    assert reading.least_ohm == pytest.approx(path_ohm(MIDDLE, 50.0 - STEP_V - left_v), rel=1e-9)
    assert reading.whole.least_ohm == reading.least_ohm


def test_of_both_samples_a_step_is_taken_so_that_the_rise_is_the_largest() -> None:
    whole = read(wide(MIDDLE, 2 * STEP_V, 50.0)).whole
    assert whole.early_v == pytest.approx(STEP_V, rel=1e-9)
    assert whole.last_v == pytest.approx(50.0 + STEP_V, rel=1e-9)
    assert whole.spans == pytest.approx(8.4)


def test_two_steps_at_the_end_tell_of_one() -> None:
    assert read(wide(WEAK, STEP_V, 2 * STEP_V)).least_ohm == pytest.approx(
        path_ohm(WEAK, STEP_V), rel=1e-9
    )


def test_from_a_twentieth_below_its_end_on_the_source_tells_the_least_alone() -> None:
    at_end = read(wide(FULL, 250.0, NEAR_V))
    assert at_end.most_ohm == METER.most_ohm(at_end, 1e3) == math.inf
    assert read(wide(FULL, 250.0, BELOW_V)).most_ohm < math.inf
    assert read(short(FULL, NEAR_V)).most_ohm == math.inf


def test_a_leak_that_takes_the_whole_current_leaves_a_path_that_may_resist_anything() -> None:
    """1 uA, beside 1 M."""
    source = msgspec.structs.replace(
        SOURCE, full_scale_ua=4_095, leak_ohm=1_000_000, node_uv_per_code=0
    )
    meter = PathMeter(source)
    assert read(wide(1, 1.0, 1.0), by=meter).most_ohm == math.inf
    assert read(wide(1, 0.5, 0.5), by=meter).most_ohm == pytest.approx(1e6)


def risen_v(
    code: int, ohm: float, tau_us: float, after_us: float, series_ohm: float, resting_v: float
) -> float:
    """Of skin and its way back, of which `series_ohm` has no capacitance beside it; on top of what
    a probe has left.
    """
    at_once_v, end_v = (
        current_a(code) / (1.0 / one + 1.0 / 66e3) if one else 0.0 for one in (series_ohm, ohm)
    )
    return end_v - (end_v - at_once_v - resting_v) * math.exp(-after_us / tau_us)


def rising(
    code: int,
    ohm: float,
    tau_us: float,
    *,
    width_us: float = 100.0,
    series_ohm: float = 0.0,
    resting_v: float = 0.0,
) -> PathSamples:
    early_v, last_v = (
        risen_v(code, ohm, tau_us, after_us, series_ohm, resting_v)
        for after_us in (10.0, width_us - 6.0)
    )
    return wide(code, early_v, last_v, width_us, resting_v)


def test_a_rise_of_34_us_is_what_is_allowed_for_and_longer_by_what_the_way_back_resists() -> None:
    at_once = read(rising(MIDDLE, 30e3, 34.0), by=FINE)
    assert at_once.most_ohm == pytest.approx(30e3, rel=1e-9)
    # 33 k, beside the leak of 66 k: half as long again.
    behind = read(rising(MIDDLE, 30e3, 51.0), by=FINE)
    assert behind.most_ohm < 30e3
    assert FINE.most_ohm(behind, 33e3) == pytest.approx(30e3, rel=1e-9)
    assert FINE.most_ohm(behind, math.inf) == math.inf


def test_a_step_of_5_k_in_series_is_what_is_allowed_for() -> None:
    """Then the end of the rise is known: two samples and the step are all of its figures."""
    reading = read(rising(WEAK, 5_602.0, 4.0, width_us=34.0, series_ohm=5e3), by=FINE)
    assert FINE.most_ohm(reading, 0.0) == pytest.approx(5_602.0, rel=1e-7)
    assert reading.most_ohm > 5_670.0
    less = read(rising(WEAK, 5_602.0, 4.0, width_us=34.0, series_ohm=4.9e3), by=FINE)
    assert FINE.most_ohm(less, 0.0) > 5_602.1


def test_what_a_probe_has_left_is_part_of_the_step() -> None:
    after = rising(WEAK, 5_602.0, 4.0, width_us=34.0, series_ohm=5e3, resting_v=0.02)
    assert FINE.most_ohm(read(after, by=FINE), 0.0) == pytest.approx(5_602.0, rel=1e-7)


# --- changes -------------------------------------------------------------------------------------

#: 40.0 V early, 50.0 V late.
BEFORE = read(wide(MIDDLE, 40.0, 50.0))


@pytest.mark.parametrize("resting_v", [1.5, 0.0, -1.5])
@pytest.mark.parametrize(
    ("samples_of", "then_v", "now_v"), [(short, 40.0, 85.0), (behind_a_step, 50.0, 105.0)]
)
def test_a_change_is_that_of_like_samples_with_a_step_and_a_fifth_of_itself_as_doubt(
    samples_of: Callable[[int, float, float], PathSamples],
    then_v: float,
    now_v: float,
    resting_v: float,
) -> None:
    reading = read(samples_of(STRONG, now_v, resting_v), BEFORE)
    now_least_v = now_v - STEP_V - max(resting_v, 0.0)
    least = path_ohm(STRONG, now_least_v) / path_ohm(MIDDLE, then_v + STEP_V)
    most = path_ohm(STRONG, now_v + STEP_V) / path_ohm(MIDDLE, then_v - STEP_V)
    doubt = 1.0 + 0.2 * (most - 1.0)
    assert reading.whole is BEFORE.whole
    assert reading.current_ua == pytest.approx(4_000.0, rel=1e-9)
    assert reading.scale == pytest.approx(most * doubt, rel=1e-9)
    assert reading.least_ohm == pytest.approx(BEFORE.least_ohm * least / doubt, rel=1e-9)
    assert reading.most_ohm == pytest.approx(BEFORE.most_ohm * most * doubt, rel=1e-9)


def test_a_change_is_one_of_the_path_with_its_way_back() -> None:
    before = read(rising(MIDDLE, 30e3, 51.0), by=FINE)
    then_v = before.whole.early_v
    changed = read(short(MIDDLE, then_v * 1.1), before, FINE)
    assert changed.scale > 1.1
    assert FINE.most_ohm(changed, 33e3) == pytest.approx(30e3 * changed.scale, rel=1e-9)


def test_a_source_near_its_end_tells_no_change() -> None:
    before = read(wide(FULL, BELOW_V - 1.0, BELOW_V - 1.0))
    for samples_of in (short, behind_a_step):
        assert METER.read(samples_of(FULL, NEAR_V), before) is None
        assert METER.read(samples_of(FULL, BELOW_V), before) is not None


@pytest.mark.parametrize(
    "then_v",
    [
        # Within a step of nothing, and of what makes the leak take all of 2 mA.
        STEP_V / 2,
        132.0 - STEP_V / 2,
    ],
)
def test_a_pulse_whose_samples_bound_nothing_is_none_that_a_change_is_told_by(
    then_v: float,
) -> None:
    before = read(wide(MIDDLE, then_v, then_v))
    for samples_of in (short, behind_a_step):
        assert METER.read(samples_of(MIDDLE, 40.0), before) is None
