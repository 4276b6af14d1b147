"""Pressure, from the chips on the fake's wire to the pulses, the reports and the log."""

from __future__ import annotations

import dataclasses
import io
from itertools import pairwise

import msgspec
import pytest

import engine_rig
from engine_rig import EngineRig
from engine_scenes import fully_open, only, phases, scans, states
from etd.files.array import PressureSensor
from etd.files.configuration import LoadedConfig, fake_config
from etd.gateway.journal import Journal
from etd.protocol.link import MeasureContact
from etd.stabilize.law_settings import PressureSettings
from etd.stabilize.settings import Settings
from etd_hal.fake.faults import I2cFailure

pytestmark = pytest.mark.slow

COUNT, WANTED_UA = 16, 1_000
LEFT, RIGHT = 0, 3
#: One on the chip that watches the rail, one on a chip of its own.
LEFT_AT, RIGHT_AT = (0x48, 1), (0x49, 2)
LEFT_NAME, RIGHT_NAME = "pressure[0] (0x48, channel 1)", "pressure[1] (0x49, channel 2)"
FIRM_KPA, NO_KPA = 150.0, 2.0


def sensor(at: tuple[int, int], x_mm: float) -> PressureSensor:
    return PressureSensor(
        address=at[0],
        channel=at[1],
        x_mm=x_mm,
        y_mm=0.0,
        zero_v=0.5,
        kpa_per_v=100.0,
        low_v=0.3,
        high_v=2.9,
    )


def pressed_config() -> LoadedConfig:
    loaded = fake_config(board="reference-hv507", electrodes=COUNT)
    x_mm = loaded.array.x_mm
    sensors = (sensor(LEFT_AT, min(x_mm)), sensor(RIGHT_AT, max(x_mm)))
    table = Settings(order=("pressure",), pressure=PressureSettings())
    return dataclasses.replace(
        loaded,
        array=msgspec.structs.replace(loaded.array, pressure=sensors),
        body_site=msgspec.structs.replace(loaded.body_site, stabilize=table),
    )


@pytest.fixture
def rig() -> EngineRig:
    made = engine_rig.make(loaded=pressed_config())
    nearest = made.engine.components.loaded.array.nearest_pressure
    assert (nearest(LEFT), nearest(RIGHT)) == (0, 1)
    made.fake.world.press_array(FIRM_KPA)
    fully_open(made, 1_500)
    hold(made, 1_000)
    return made


def hold(rig: EngineRig, duration_ms: float) -> None:
    wanted = only(COUNT, e0=WANTED_UA, e3=WANTED_UA)
    rig.hold(duration_ms, current_ua=wanted, width_us=60, rate_hz=20.0, ttl_ms=300)


def fired_ua(rig: EngineRig, electrode: int, duration_ms: float) -> list[int]:
    since_ns = rig.clock.now_ns()
    hold(rig, duration_ms)
    found = [phase for phase in phases(rig, since_ns) if phase.electrode == electrode]
    return [round(phase.current_ua) for phase in found]


def ended(rig: EngineRig) -> None:
    assert rig.close() == ()


def test_rail_and_sensors_on_one_chip_leave_the_board_armed_and_pressed_as_it_is(
    rig: EngineRig,
) -> None:
    assert rig.state == "ARMED"
    assert fired_ua(rig, LEFT, 500)[-1] == pytest.approx(WANTED_UA, abs=3)
    assert scans(rig)[-1].pressure_kpa == (pytest.approx(FIRM_KPA, abs=0.1),) * COUNT
    rail_v = states(rig)[-1].rail_v
    assert rail_v == pytest.approx(rig.fake.world.rail_v(), abs=0.5)
    ended(rig)


def test_below_no_contact_nothing_is_fired_and_what_was_wanted_is_told(rig: EngineRig) -> None:
    rig.fake.world.press_array(NO_KPA)
    hold(rig, 200)
    assert fired_ua(rig, LEFT, 300) == []
    told = scans(rig)[-1].fired
    assert (told.wanted_ua[LEFT], told.current_ua[LEFT]) == (WANTED_UA, 0)
    assert (told.delivered_ua[LEFT], told.width_us[LEFT]) == (0, 0.0)
    assert (told.contact[LEFT], told.resistance_ohm[LEFT]) == (None, None)
    ended(rig)


DEAD = I2cFailure(RIGHT_AT[0], "absent")


@pytest.mark.parametrize("lies_v", [None, 0.0, 3.2], ids=["dies", "reads 0 V", "reads too much"])
def test_a_sensor_that_dies_or_lies_gives_the_frames_own_pulse_and_is_named_until_it_is_back(
    rig: EngineRig, lies_v: float | None
) -> None:
    world = rig.fake.world
    world.press_array(NO_KPA)
    hold(rig, 300)
    if lies_v is None:
        world.put_in(DEAD)
    else:
        world.set_sensor_v(*RIGHT_AT, lies_v)
    risen = fired_ua(rig, RIGHT, 2_500)
    assert all(after - before <= WANTED_UA // 8 for before, after in pairwise(risen))
    assert risen[-1] == pytest.approx(WANTED_UA, abs=3)
    assert max(risen) <= WANTED_UA
    assert fired_ua(rig, LEFT, 300) == [], "the other sensor still says that nobody presses"
    assert list(states(rig)[-1].sensor_problems) == [RIGHT_NAME]
    assert scans(rig)[-1].pressure_kpa[RIGHT] is None
    assert scans(rig)[-1].pressure_kpa[LEFT] == pytest.approx(NO_KPA, abs=0.1)

    if lies_v is None:
        world.take_out(DEAD)
    else:
        world.set_sensor_v(*RIGHT_AT, None)
    hold(rig, 100)
    assert fired_ua(rig, RIGHT, 300) == []
    hold(rig, 4_000)
    assert states(rig)[-1].sensor_problems == {}
    assert rig.engine.components.reporter.counters["rejected_pressure"] == 1
    ended(rig)


def test_the_log_names_the_sensor_and_why_once_an_episode(rig: EngineRig) -> None:
    rig.fake.world.set_sensor_v(*LEFT_AT, 3.1)
    rig.reports.clear()
    hold(rig, 2_500)
    rig.fake.world.set_sensor_v(*LEFT_AT, None)
    hold(rig, 13_500)
    rig.fake.world.set_sensor_v(*LEFT_AT, 0.0)
    hold(rig, 2_500)
    stream = io.StringIO()
    journal = Journal("main", stream)
    for report in states(rig):
        journal.state(report)
    journal.close()
    told = [line for line in stream.getvalue().splitlines() if "pressure[" in line]
    assert told == [
        f"etd main: {LEFT_NAME} of the array gives no readings: it reads 3.10 V, not 0.3 to 2.9 V",
        f"etd main: {LEFT_NAME} of the array has worked again for 10 s",
        f"etd main: {LEFT_NAME} of the array gives no readings: it reads 0.00 V, not 0.3 to 2.9 V",
    ]
    ended(rig)


def test_a_measurement_tells_the_pressure_too() -> None:
    rig = engine_rig.make(loaded=pressed_config())
    rig.fake.world.set_sensor_v(*RIGHT_AT, 0.0)
    rig.open()
    rig.try_wearer_stop()
    contact = rig.ask(MeasureContact, lease=engine_rig.LEASE).contact
    assert contact is not None
    assert contact.pressure_kpa[LEFT] == pytest.approx(40.0, abs=0.1)
    assert contact.pressure_kpa[RIGHT] is None
    ended(rig)


def test_an_array_without_sensors_tells_no_pressure() -> None:
    rig = engine_rig.make(board="reference-hv507", electrodes=COUNT)
    fully_open(rig, 100)
    assert scans(rig)[-1].pressure_kpa == ()
    assert states(rig)[-1].sensor_problems == {}
    ended(rig)
