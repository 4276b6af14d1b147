"""The rail over I2C: the latest value with its time, or unknown."""

from __future__ import annotations

import pytest

from etd.files.array import Array, Electrode, PressureSensor
from etd.sensing.sensors import STALE_NS, TOLD_NS, PressureSensors, RailSensor, SensorCycle
from etd_hal.chips import ads1115
from etd_hal.fake.faults import I2cFailure, RailOff
from etd_hal.ports import I2c
from stepped_board import SteppedBoard, stepped_board

MONITOR, SETPOINT = 0x48, 0x60
MS = 1_000_000


def sensor_of(made: SteppedBoard) -> RailSensor:
    return RailSensor(made.board, made.backend.i2c, made.clock)


def read(made: SteppedBoard, sensor: RailSensor) -> float | None:
    sensor.begin()
    made.clock.spend(3 * MS)
    sensor.end()
    return sensor.rail_v(made.clock.now_ns())


def switch_on(made: SteppedBoard) -> None:
    enable = made.board.guards.hv_enable
    assert enable != "absent"
    made.backend.gpio.set(((enable.line, enable.on),))


def feed_for(made: SteppedBoard, duration_ms: int) -> None:
    """The heartbeat's edges, so that the supply stays on."""
    heartbeat = made.board.guards.heartbeat
    assert heartbeat != "absent"
    for step in range(duration_ms // 10):
        made.backend.gpio.set(((heartbeat.line, step % 2),))
        made.clock.spend(10 * MS)


def test_before_the_first_reading_the_rail_is_unknown() -> None:
    made = stepped_board("reference-hv507")
    assert sensor_of(made).rail_v(made.clock.now_ns()) is None


def test_it_reads_the_rail_in_volts() -> None:
    made = stepped_board("reference-hv507")
    sensor = sensor_of(made)
    assert read(made, sensor) == pytest.approx(0.0, abs=0.1)
    switch_on(made)
    feed_for(made, 600)
    assert read(made, sensor) == pytest.approx(300.0, rel=0.01)
    assert read(made, sensor) == pytest.approx(made.fake.world.rail_v(), rel=0.01)


def test_the_rail_is_set_once_before_it_is_read() -> None:
    made = stepped_board("reference-hv507")
    sensor = sensor_of(made)
    for _ in range(3):
        read(made, sensor)
    sent = [
        entry["tx"] for entry in made.events("i2c") if entry["addr"] == SETPOINT and entry["tx"]
    ]
    assert sent == [f"{3_500:04x}"]


def test_a_value_older_than_half_a_second_says_nothing() -> None:
    made = stepped_board("reference-hv507")
    sensor = sensor_of(made)
    read(made, sensor)
    read_ns = made.clock.now_ns()
    assert STALE_NS == 500 * MS
    assert sensor.rail_v(read_ns + 499 * MS) is not None
    assert sensor.rail_v(read_ns + 501 * MS) is None


def test_a_conversion_that_could_not_be_begun_leaves_the_rail_unknown() -> None:
    made = stepped_board("reference-hv507")
    sensor, sensors = sensor_of(made), pressure_of(made)
    made.fake.world.set_sensor_v(MONITOR, NEAR, 1.5)
    made.fake.world.set_sensor_v(MONITOR, FAR, 1.0)
    read(made, sensor)
    read_all(made, sensors)
    made.fake.world.put_in(I2cFailure(MONITOR, "io", times=1))
    assert read(made, sensor) is None, "what the chip holds is a pressure"
    assert "io" in sensor.problem
    assert read(made, sensor) == pytest.approx(0.0, abs=0.1)
    assert sensor.problem == ""


@pytest.mark.parametrize("kind", ["absent", "io", "timeout"])
def test_an_i2c_error_makes_the_rail_unknown_and_is_told(kind: str) -> None:
    made = stepped_board("reference-hv507")
    sensor = sensor_of(made)
    read(made, sensor)
    fault = I2cFailure(MONITOR, kind)  # type: ignore[arg-type]
    made.fake.world.put_in(fault)
    assert read(made, sensor) is None
    assert kind in sensor.problem
    made.fake.world.take_out(fault)
    assert read(made, sensor) is not None
    assert sensor.problem == ""


def test_a_set_point_that_does_not_answer_is_tried_again_and_told_meanwhile() -> None:
    made = stepped_board("reference-hv507")
    sensor = sensor_of(made)
    fault = I2cFailure(SETPOINT, "absent")
    made.fake.world.put_in(fault)
    read(made, sensor)
    assert "0x60" in sensor.problem
    made.fake.world.take_out(fault)
    read(made, sensor)
    assert sensor.problem == ""


def test_a_rail_that_is_off_reads_so() -> None:
    made = stepped_board("reference-hv507", faults=[RailOff(0.5)])
    sensor = sensor_of(made)
    read(made, sensor)
    switch_on(made)
    feed_for(made, 600)
    assert read(made, sensor) == pytest.approx(150.0, rel=0.02)


def test_a_board_without_a_monitor_asks_nothing_and_knows_nothing() -> None:
    made = stepped_board("kajimoto-hv507")
    sensor = sensor_of(made)
    assert not sensor.is_there
    assert read(made, sensor) is None
    assert sensor.problem == ""


# --- pressure ------------------------------------------------------------------------------------

NEAR, FAR = 1, 2
NEAR_NAME, FAR_NAME = "pressure[0] (0x48, channel 1)", "pressure[1] (0x48, channel 2)"


def pressed_array() -> Array:
    """Two electrodes, each over a sensor: 0.5 V is none, 100 kPa a volt, up to 2.5 V."""

    def sensor(channel: int, x_mm: float) -> PressureSensor:
        return PressureSensor(
            address=MONITOR,
            channel=channel,
            x_mm=x_mm,
            y_mm=0.0,
            zero_v=0.5,
            kpa_per_v=100.0,
            low_v=0.3,
            high_v=2.5,
        )

    return Array(
        name="pressed",
        title="for tests",
        view="through-finger",
        mark="left",
        diameter_mm=1.0,
        electrode=(Electrode(x_mm=0.0, y_mm=0.0), Electrode(x_mm=10.0, y_mm=0.0)),
        pressure=(sensor(NEAR, 1.0), sensor(FAR, 9.0)),
    )


def pressure_of(made: SteppedBoard) -> PressureSensors:
    return PressureSensors(pressed_array(), made.backend.i2c, made.clock)


def read_all(made: SteppedBoard, sensors: PressureSensors) -> list[float | None]:
    for sensor in range(sensors.count):
        sensors.begin(sensor)
        made.clock.spend(3 * MS)
        sensors.end(sensor)
    return [sensors.kpa(electrode, made.clock.now_ns()) for electrode in range(2)]


def test_each_electrode_goes_by_the_sensor_nearest_to_it() -> None:
    made = stepped_board("reference-hv507")
    sensors = pressure_of(made)
    assert [sensors.kpa(electrode, made.clock.now_ns()) for electrode in range(2)] == [None, None]
    made.fake.world.set_sensor_v(MONITOR, NEAR, 1.5)
    made.fake.world.set_sensor_v(MONITOR, FAR, 0.4)
    assert read_all(made, sensors) == [pytest.approx(100.0, rel=0.01), 0.0]
    assert sensors.problems(made.clock.now_ns()) == {}


@pytest.mark.parametrize("volts", [0.0, 2.9])
def test_a_voltage_that_no_sensor_makes_is_a_dead_one(volts: float) -> None:
    made = stepped_board("reference-hv507")
    sensors = pressure_of(made)
    made.fake.world.set_sensor_v(MONITOR, NEAR, volts)
    made.fake.world.set_sensor_v(MONITOR, FAR, 1.0)
    near_kpa, far_kpa = read_all(made, sensors)
    assert near_kpa is None
    assert far_kpa == pytest.approx(50.0, rel=0.01)
    assert sensors.is_dead(0, made.clock.now_ns())
    assert not sensors.is_dead(1, made.clock.now_ns())
    why = f"it reads {volts:.2f} V, not 0.3 to 2.5 V"
    assert sensors.problems(made.clock.now_ns()) == {"pressure[0] (0x48, channel 1)": why}


def test_a_pressure_that_is_stale_or_cannot_be_read_is_unknown() -> None:
    made = stepped_board("reference-hv507")
    sensors = pressure_of(made)
    made.fake.world.set_sensor_v(MONITOR, NEAR, 1.5)
    read_all(made, sensors)
    made.clock.spend(STALE_NS + 10 * MS)
    assert sensors.kpa(0, made.clock.now_ns()) is None
    assert "is the I2C bus stuck?" in sensors.problems(made.clock.now_ns())[NEAR_NAME]
    made.fake.world.put_in(I2cFailure(MONITOR, "io"))
    assert read_all(made, sensors) == [None, None]
    problems = sensors.problems(made.clock.now_ns())
    assert list(problems) == [NEAR_NAME, FAR_NAME]
    assert all("failed (io)" in why for why in problems.values())


def test_a_conversion_that_could_not_be_begun_is_not_taken_from_another_channel() -> None:
    made = stepped_board("reference-hv507")
    sensors = pressure_of(made)
    made.fake.world.set_sensor_v(MONITOR, NEAR, 0.6)
    made.fake.world.set_sensor_v(MONITOR, FAR, 2.0)
    assert read_all(made, sensors) == [pytest.approx(10.0, rel=0.01), pytest.approx(150.0)]
    made.fake.world.put_in(I2cFailure(MONITOR, "io", times=1))
    sensors.begin(0)
    made.clock.spend(3 * MS)
    sensors.end(0)
    now_ns = made.clock.now_ns()
    assert sensors.kpa(0, now_ns) is None, "the chip still holds the 150 kPa of the other one"
    assert sensors.is_dead(0, now_ns)
    assert list(sensors.problems(now_ns)) == [NEAR_NAME]
    assert read_all(made, sensors)[0] == pytest.approx(10.0, rel=0.01)
    now_ns = made.clock.now_ns()
    assert list(sensors.problems(now_ns)) == [NEAR_NAME], "a report each second must not miss it"
    made.clock.spend(TOLD_NS)
    read_all(made, sensors)
    assert sensors.problems(made.clock.now_ns()) == {}


def test_what_another_sensor_began_is_not_read_as_this_ones() -> None:
    made = stepped_board("reference-hv507")
    sensors = pressure_of(made)
    made.fake.world.set_sensor_v(MONITOR, FAR, 2.0)
    sensors.begin(1)
    made.clock.spend(3 * MS)
    sensors.end(0)
    assert sensors.kpa(0, made.clock.now_ns()) is None


def test_a_conversion_that_lasts_is_asked_for_again_and_none_is_taken_meanwhile() -> None:
    made = stepped_board("reference-hv507")
    sensors = pressure_of(made)
    made.fake.world.set_sensor_v(MONITOR, NEAR, 1.5)
    sensors.begin(0)
    assert not sensors.end(0)
    assert sensors.kpa(0, made.clock.now_ns()) is None
    made.clock.spend(3 * MS)
    assert sensors.end(0)
    assert sensors.kpa(0, made.clock.now_ns()) == pytest.approx(100.0, rel=0.01)


class Busy:
    """An I2C bus whose chip never says that it is done."""

    def __init__(self, inner: I2c) -> None:
        self._inner = inner

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        said = self._inner.transfer(address, write, read_length)
        return bytes((said[0] & 0x7F, said[1])) if write == b"\x01" else said


def test_a_conversion_that_never_ends_leaves_the_sensor_unknown() -> None:
    made = stepped_board("reference-hv507")
    assert made.backend.i2c is not None
    sensors = PressureSensors(pressed_array(), Busy(made.backend.i2c), made.clock)
    made.fake.world.set_sensor_v(MONITOR, NEAR, 1.5)
    sensors.begin(0)
    for _ in range(3):
        made.clock.spend(ads1115.CONVERSION_NS)
        assert not sensors.end(0)
    made.clock.spend(ads1115.GIVE_UP_NS)
    assert sensors.end(0)
    assert "does not end" in sensors.problems(made.clock.now_ns())[NEAR_NAME]


@pytest.mark.parametrize("lag_ms", [0.05, 0.4, 1.1, 3.0, 40.0])
def test_rail_and_sensors_on_one_chip_never_take_each_others_result(lag_ms: float) -> None:
    """However seldom or often somebody looks after them."""
    made = stepped_board("reference-hv507")
    rail, sensors = sensor_of(made), pressure_of(made)
    cycle = SensorCycle(rail, sensors)
    made.fake.world.set_sensor_v(MONITOR, NEAR, 1.5)
    made.fake.world.set_sensor_v(MONITOR, FAR, 1.0)
    read: set[tuple[float | None, ...]] = set()
    for _ in range(200):
        made.clock.spend(int(lag_ms * MS))
        cycle.step()
        now_ns = made.clock.now_ns()
        told = (rail.rail_v(now_ns), *(sensors.kpa(electrode, now_ns) for electrode in range(2)))
        read.add(tuple(None if value is None else round(value) for value in told))
    assert (0, 100, 50) in read
    for other, right in enumerate((0, 100, 50)):
        assert {told[other] for told in read} <= {right, None}


def test_an_array_without_sensors_has_none_to_die() -> None:
    made = stepped_board("kajimoto-hv507")
    plain = Array(
        **{
            name: getattr(pressed_array(), name)
            for name in ("name", "title", "view", "mark", "diameter_mm", "electrode")
        }
    )
    sensors = PressureSensors(plain, made.backend.i2c, made.clock)
    assert sensors.count == 0
    assert not sensors.is_dead(0, 0)
