"""Sensors under the array of a fake board: as many chips as they are on, and what presses there."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from etd_body.course import BUSY, LYING, Course
from etd_hal.backend import Backend
from etd_hal.chips import ads1115
from etd_hal.compose import codec_of, open_fake
from etd_hal.errors import BusError
from etd_hal.fake import process
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.fingertip import fingertip_body
from etd_hal.fake.pressure_sensors import LYING_KPA, FakePressureSensors
from etd_hal.linesetup import line_setup, spi_setup
from stepped_board import shipped_board

pytestmark = pytest.mark.slow

BOARD = shipped_board("reference-hv507")
PLACES = [(0.0, 0.0), (2.5, 0.0), (0.0, 2.5), (2.5, 2.5)]


@dataclass(frozen=True)
class Sensor:
    address: int
    channel: int
    x_mm: float = 0.0
    y_mm: float = 0.0
    zero_v: float = 0.5
    kpa_per_v: float = 100.0


SENSORS = (Sensor(0x48, 1), Sensor(0x49, 2, 2.5, 0.0), Sensor(0x4B, 0, 0.0, 2.5))


def read_kpa(backend: Backend, sensor: Sensor) -> float:
    assert backend.i2c is not None
    clock = backend.clock
    assert isinstance(clock, SteppedClock)
    volts = ads1115.convert_v(backend.i2c, sensor.address, sensor.channel, clock.spend)
    return (volts - sensor.zero_v) * sensor.kpa_per_v


def opened(positions_mm: list[tuple[float, float]] | None) -> Backend:
    return open_fake(
        BOARD, electrodes=range(4), positions_mm=positions_mm, stepped=True, sensors=SENSORS
    )


def test_every_sensor_of_an_array_is_pressed_by_a_finger_that_only_lies_there() -> None:
    backend = opened(None)
    assert [read_kpa(backend, sensor) for sensor in SENSORS] == [
        pytest.approx(LYING_KPA, abs=0.1)
    ] * 3
    backend.close()


def test_a_finger_that_lives_presses_each_as_it_lies_on_it() -> None:
    backend = opened(PLACES)
    found = [read_kpa(backend, sensor) for sensor in SENSORS]
    assert all(0.5 * LYING_KPA < kpa < 2.0 * LYING_KPA for kpa in found)
    assert len({round(kpa, 1) for kpa in found}) == 3
    backend.close()


def test_where_no_sensor_is_no_chip_answers() -> None:
    backend = opened(None)
    with pytest.raises(BusError, match="absent"):
        read_kpa(backend, Sensor(0x4A, 0))
    backend.close()


def test_a_test_presses_and_puts_volts_and_takes_its_hand_away() -> None:
    clock = SteppedClock()
    body = fingertip_body(BOARD, 4)
    fake = FakeBoard(BOARD, clock, body, electrodes=range(4), sensors=SENSORS)
    ports = fake.request(line_setup(BOARD), spi_setup(BOARD))
    backend = Backend(
        "fake",
        *(ports.spi, ports.gpio, ports.i2c, clock, ports.marker, ports.close),
        host_clock=clock,
        codec=codec_of(BOARD.source),
    )
    fake.world.press_array(150.0)
    fake.world.set_sensor_v(0x49, 2, 3.0)
    assert read_kpa(backend, SENSORS[0]) == pytest.approx(150.0, abs=0.1)
    assert read_kpa(backend, SENSORS[1]) == pytest.approx(250.0, abs=0.1)
    fake.world.set_sensor_v(0x49, 2, None)
    assert read_kpa(backend, SENSORS[1]) == pytest.approx(150.0, abs=0.1)
    backend.close()


def test_an_input_that_nothing_is_on_is_on_ground() -> None:
    assert FakePressureSensors(SENSORS, lambda _t_ns, _position_mm: 40.0).volts(0, 0x48, 3) == 0.0


def test_what_lies_there_presses_as_much_as_the_one_that_lives() -> None:
    assert LYING.mean_pressure_kpa == LYING_KPA


def test_a_sensor_feels_the_middle_as_the_course_has_it_and_nothing_under_skin_that_is_off() -> (
    None
):
    course = Course(BUSY, PLACES, seed=1)
    middle = (1.25, 1.25)
    seen: set[bool] = set()
    for t_ms in range(0, 60_000, 20):
        t_s = t_ms * 1e-3
        is_off = course.at(t_s).area[3] == 0.0
        seen.add(bool(is_off))
        assert (course.pressure_at_kpa(t_s, (2.6, 2.6)) == 0.0) == is_off
        kpa = course.pressure_at_kpa(t_s, middle)
        assert kpa in (0.0, pytest.approx(course.pressure_kpa(t_s)))
    assert seen == {True, False}


@pytest.mark.parametrize("text", ["0x49:2", "0x49:two:0.5:100", ""])
def test_a_board_process_says_how_a_sensor_is_written(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        process.main(["--board", "b", "--socket", "s", "--sensor", text])
    assert ended.value.code == 2
    assert f"--sensor: {text!r} is not as 0x49:2:0.5:100 is" in capsys.readouterr().err
