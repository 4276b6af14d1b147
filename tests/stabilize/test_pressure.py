"""Pressing harder gives more: slowly up, at once down, nothing without contact."""

from __future__ import annotations

import pytest

from etd.pulse.request import PulseRequest
from etd.stabilize.law_settings import PressureSettings
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.pressure import Pressure
from plain_records import changed

MS = 1_000_000
FRAME = PulseRequest(2_000, 100)
FREE = ElectrodeEstimate(3, state="closed", pressure_kpa=0.0)


def pressed_for(
    law: Pressure, kpa: float | None, begin_ms: int, end_ms: int, **more: int
) -> PulseRequest:
    asked = FRAME
    for now_ms in range(begin_ms, end_ms, 20):
        seen = changed(FREE, pressure_kpa=kpa, now_ns=now_ms * MS, **more)
        asked = law.adapt(FRAME, seen)
    return asked


@pytest.mark.parametrize(
    ("kpa", "current_ua"), [(9.9, 0), (10.0, 0), (55.0, 1_000), (150.0, 2_000)]
)
def test_from_no_contact_to_all_that_is_wanted(kpa: float, current_ua: int) -> None:
    assert pressed_for(Pressure(PressureSettings()), kpa, 0, 2_000) == PulseRequest(current_ua, 100)


def test_with_a_calibration_it_begins_at_the_threshold() -> None:
    asked = pressed_for(Pressure(PressureSettings()), 55.0, 0, 2_000, threshold_ua=1_000)
    assert asked.current_ua == 1_500


def test_a_rise_takes_time_and_a_fall_takes_none() -> None:
    law = Pressure(PressureSettings(rise_per_s=2.0))
    assert pressed_for(law, 100.0, 0, 20).current_ua == 0
    assert pressed_for(law, 100.0, 20, 260).current_ua == pytest.approx(960, abs=1)
    assert pressed_for(law, 100.0, 260, 2_000).current_ua == 2_000
    assert pressed_for(law, 19.0, 2_000, 2_020).current_ua == 200
    assert pressed_for(law, 5.0, 2_020, 2_040).current_ua == 0


def test_a_dead_sensor_gives_the_frames_own_pulse_but_no_step_up() -> None:
    law = Pressure(PressureSettings(rise_per_s=2.0))
    pressed_for(law, 19.0, 0, 1_000)
    assert pressed_for(law, None, 1_000, 1_020).current_ua <= 200 + 80
    assert pressed_for(law, None, 1_020, 3_000) == FRAME
