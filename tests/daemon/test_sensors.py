"""The rail over I2C: the latest value with its time, or unknown."""

from __future__ import annotations

import pytest

from etd.engine.sensors import STALE_NS, RailSensor
from etd_hal.fake.faults import I2cFailure, RailOff
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
    sent = [one["tx"] for one in made.events("i2c") if one["addr"] == SETPOINT and one["tx"]]
    assert sent == [f"{3_500:04x}"]


def test_a_value_older_than_half_a_second_says_nothing() -> None:
    made = stepped_board("reference-hv507")
    sensor = sensor_of(made)
    read(made, sensor)
    read_ns = made.clock.now_ns()
    assert STALE_NS == 500 * MS
    assert sensor.rail_v(read_ns + 499 * MS) is not None
    assert sensor.rail_v(read_ns + 501 * MS) is None


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
