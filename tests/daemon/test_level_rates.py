"""Levels are fired no faster than they were calibrated, whatever frames ask for them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_rig import EngineRig, make
from engine_scenes import calibration, config, open_calibrated, opened_to, phases

MakeRig = Callable[..., EngineRig]
N = 8
MADE_HZ = 20.0
PERIOD_NS = 1e9 / MADE_HZ
PROBE_UA = 400
#: A scan is on time by so much.
ON_TIME_NS = 2_500_000
LEVEL: dict[str, Any] = {"level": (1.0,) + (0.0,) * (N - 1)}


@pytest.fixture
def rig(make_rig: MakeRig) -> EngineRig:
    return ready(make_rig(loaded=config(electrodes=N)))


def ready(rig: EngineRig) -> EngineRig:
    """With levels that were accepted at 20 Hz."""
    made = calibration(rig, (2_000,) * N, rate_hz=MADE_HZ)
    answer = open_calibrated(rig, made)
    assert answer.error is None, answer.reason
    rig.arm()
    opened_to(rig, 2_000)
    rig.run_ms(100)
    return rig


def fired_ns(rig: EngineRig, since_ns: int, electrode: int = 0) -> list[int]:
    """Its pulses, without probes of contact."""
    found = [each for each in phases(rig, since_ns) if each.electrode == electrode]
    return [each.from_ns for each in found if each.current_ua > PROBE_UA]


@pytest.mark.parametrize(
    ("frames", "every_ms"),
    [
        ([{**LEVEL, "pulses": 1}], 9),
        ([{**LEVEL, "ttl_ms": 4}], 9),
        ([{**LEVEL, "ttl_ms": 200}, {"level": (0.0,) * N, "ttl_ms": 200}], 5),
        ([{**LEVEL, "pulses": 1}, {"current_ua": (0, 300) + (0,) * 6, "rate_hz": 100.0}], 7),
        ([{"current_ua": (900,) + (0,) * 7, "pulses": 1}, {**LEVEL, "pulses": 1}], 30),
    ],
    ids=["pulses", "ttl", "silence in between", "another's currents", "its own currents"],
)
def test_frames_that_come_one_after_another_fire_them_no_faster(
    rig: EngineRig, frames: list[dict[str, Any]], every_ms: int
) -> None:
    since_ns = rig.clock.now_ns()
    by_level: list[int] = []
    for number in range(60):
        frame = frames[number % len(frames)]
        before_ns = rig.clock.now_ns()
        rig.show(**frame)
        rig.run_ms(every_ms)
        if "level" in frame:
            by_level += fired_ns(rig, before_ns)
    assert by_level
    every = fired_ns(rig, since_ns)
    for last, after in pairwise(every):
        if after in by_level:
            assert after - last >= PERIOD_NS - ON_TIME_NS


def test_another_electrode_need_not_wait(rig: EngineRig) -> None:
    """Nor one whose current is named."""
    rig.show(**LEVEL, pulses=1)
    rig.run_ms(8)
    since_ns = rig.clock.now_ns()
    rig.show(level=(0.0, 1.0) + (0.0,) * 6, pulses=1)
    rig.run_ms(8)
    assert len(fired_ns(rig, since_ns, 1)) == 1
    rig.show(current_ua=(500,) + (0,) * 7, pulses=1)
    rig.run_ms(8)
    assert len(fired_ns(rig, since_ns, 0)) == 1


def test_a_frame_that_waits_longer_than_it_may_is_told(rig: EngineRig) -> None:
    rig.show(**LEVEL, pulses=1)
    rig.run_ms(8)
    since_ns = rig.clock.now_ns()
    rig.show(**LEVEL, pulses=1, ttl_ms=10)
    rig.run_ms(60)
    assert fired_ns(rig, since_ns) == []
    refused = [report.refused for report in rig.reports if report.refused is not None]
    assert [one.error for one in refused] == ["expired"]


@settings(max_examples=25)
@given(
    steps=st.lists(
        st.tuples(
            st.sampled_from([0, 1]),
            st.sampled_from([None, 1, 2]),
            st.sampled_from([5, 30, 200]),
            st.sampled_from([None, 5.0, 20.0]),
            st.integers(1, 60),
        ),
        min_size=2,
        max_size=25,
    )
)
def test_no_sequence_of_frames_fires_them_faster(
    steps: list[tuple[int, int | None, int, float | None, int]],
) -> None:
    rig = ready(make(loaded=config(electrodes=N)))
    since_ns = rig.clock.now_ns()
    for electrode, pulses, ttl_ms, rate_hz, pause_ms in steps:
        level = tuple(float(at == electrode) for at in range(N))
        rig.show(level=level, pulses=pulses, ttl_ms=ttl_ms, rate_hz=rate_hz)
        rig.run_ms(pause_ms)
    for electrode in (0, 1):
        every = fired_ns(rig, since_ns, electrode)
        for count in (1, 3):
            # Single pulses may come a little early, and no more of them than of one.
            for first, last in zip(every, every[count:], strict=False):
                assert last - first >= count * PERIOD_NS - ON_TIME_NS
    rig.close()
