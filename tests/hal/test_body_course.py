"""The script of time: the same whenever it is asked, and with the events that it promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_body.course import BUSY, STILL, Course, Script

pytestmark = pytest.mark.slow

PLACES = [(2.5 * (i % 4), 2.5 * (i // 4)) for i in range(16)]


@settings(max_examples=25)
@given(st.lists(st.floats(0.0, 700.0), min_size=2, max_size=6), st.integers(0, 5))
def test_the_course_depends_on_seed_and_time_alone(times_s: list[float], seed: int) -> None:
    course, other = (Course(BUSY, PLACES, seed=seed) for _ in range(2))
    forwards = [course.at(t_s) for t_s in times_s]
    backwards = [other.at(t_s) for t_s in reversed(times_s)][::-1]
    for first, second in zip(forwards, backwards, strict=True):
        assert (first.area == second.area).all()
        assert (first.sweat_gain == second.sweat_gain).all()


def test_nothing_happens_to_a_still_skin() -> None:
    course = Course(STILL, PLACES, seed=3)
    for t_s in (0.0, 1.0, 500.0):
        assert (course.at(t_s).area == 1.0).all()
        assert (course.at(t_s).sweat_gain == 1.0).all()


def test_sweat_takes_20_to_40_percent_of_the_resistance_in_minutes() -> None:
    course = Course(Script(sweat=0.35), PLACES, seed=3)
    middling = [float(np.median(1.0 / course.at(t_s).sweat_gain)) for t_s in (0.0, 60.0, 180.0)]
    assert middling[0] == 1.0
    assert 0.70 < middling[1] < 0.88
    assert 0.60 < middling[2] < 0.75


def test_peeling_takes_an_edge_off_and_lays_it_on_again_with_a_small_contact() -> None:
    course = Course(Script(peels_per_min=6.0), PLACES, seed=1)
    times_s = np.arange(0.0, 60.0, 0.01)
    areas = np.array([course.at(float(t_s)).area for t_s in times_s])
    is_off = areas == 0.0
    assert 0.005 < is_off.mean() < 0.3
    assert not is_off.all(axis=1).any()
    back = is_off[:-1] & ~is_off[1:]
    assert back.any()
    assert (areas[1:][back] < 0.4).all()
    assert (areas[1:][back] > 0.2).all()


def test_pressing_moves_area_and_pressure_together() -> None:
    course = Course(Script(pressing=0.5), PLACES, seed=2)
    times_s = np.linspace(0.0, 300.0, 600)
    pressure = np.array([course.pressure_kpa(float(time_s)) for time_s in times_s])
    area = np.array([course.at(float(time_s)).area.mean() for time_s in times_s])
    assert pressure.max() > 2.0 * pressure.min()
    assert np.corrcoef(np.log(pressure), np.log(area))[0, 1] > 0.9
