"""The rail's ADC on the wire: registers and bits of the datasheet."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from board_rig import BoardRig
from etd_hal.chips import ads1115
from etd_hal.errors import BusError
from etd_hal.fake.faults import I2cFailure
from etd_hal.ports import I2c

ADDRESS = 0x48


@pytest.fixture
def rig(boards: Callable[..., BoardRig]) -> BoardRig:
    return boards("reference-hv507", begun=False)


def bus(rig: BoardRig) -> I2c:
    assert rig.stepped.backend.i2c is not None
    return rig.stepped.backend.i2c


@pytest.mark.parametrize(
    ("channel", "config"), [(0, "01c3e3"), (1, "01d3e3"), (2, "01e3e3"), (3, "01f3e3")]
)
def test_a_start_is_one_single_ended_shot_at_the_highest_rate(
    rig: BoardRig, channel: int, config: str
) -> None:
    ads1115.start(bus(rig), ADDRESS, channel)
    sent = rig.records()[-1]
    assert (sent["bus"], sent["addr"], sent["tx"], sent["rx"]) == ("i2c", ADDRESS, config, "")


def test_a_reading_asks_whose_result_it_is_and_then_for_it(rig: BoardRig) -> None:
    ads1115.start(bus(rig), ADDRESS, 2)
    rig.clock.spend(ads1115.CONVERSION_NS)
    ads1115.read_v(bus(rig), ADDRESS, 2)
    config, result = rig.records()[-2:]
    assert (config["tx"], config["rx"]) == ("01", "e3e3")
    assert (result["tx"], len(result["rx"])) == ("00", 4)


@pytest.mark.parametrize(("channel", "volts"), [(1, 0.5), (2, 1.234), (3, 3.0)])
def test_volts_at_an_input_come_back(rig: BoardRig, channel: int, volts: float) -> None:
    rig.fake.world.set_sensor_v(ADDRESS, channel, volts)
    read = ads1115.convert_v(bus(rig), ADDRESS, channel, rig.clock.spend)
    assert read == pytest.approx(volts, abs=4.096 / 32_768)


def test_a_conversion_under_way_has_no_result_and_the_old_one_is_not_taken(rig: BoardRig) -> None:
    rig.fake.world.set_sensor_v(ADDRESS, 1, 0.5)
    ads1115.convert_v(bus(rig), ADDRESS, 1, rig.clock.spend)
    rig.fake.world.set_sensor_v(ADDRESS, 1, 2.0)
    ads1115.start(bus(rig), ADDRESS, 1)
    assert ads1115.read_v(bus(rig), ADDRESS, 1) is None
    assert rig.records()[-1]["tx"] == "01", "the register with the old result is left alone"
    rig.clock.spend(ads1115.CONVERSION_NS)
    assert ads1115.read_v(bus(rig), ADDRESS, 1) == pytest.approx(2.0, abs=0.001)


def test_what_another_user_of_the_chip_converts_is_an_error_and_no_voltage(rig: BoardRig) -> None:
    ads1115.start(bus(rig), ADDRESS, 1)
    ads1115.start(bus(rig), ADDRESS, 2)
    rig.clock.spend(ads1115.CONVERSION_NS)
    with pytest.raises(BusError, match="not of channel 1: somebody else uses this chip") as caught:
        ads1115.read_v(bus(rig), ADDRESS, 1)
    assert caught.value.kind == "io"


def test_a_chip_as_it_is_after_power_up_has_converted_nothing(rig: BoardRig) -> None:
    with pytest.raises(BusError, match="0x8583"):
        ads1115.read_v(bus(rig), ADDRESS, 0)


def test_the_time_of_a_conversion_covers_one_old_and_one_new_period() -> None:
    assert ads1115.CONVERSION_NS >= 2 * 1_000_000_000 / 860 * 1.1


class OneWord:
    """A bus whose only chip has converted channel 0, always to the same word."""

    def __init__(self, word: str, config: str = "c3e3") -> None:
        self._word = bytes.fromhex(word)
        self._config = bytes.fromhex(config)

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        return self._word[:read_length] if write == b"\x00" else self._config


@pytest.mark.parametrize(
    ("word", "volts"), [("7fff", 4.095875), ("0001", 0.000125), ("ffff", -0.000125)]
)
def test_the_register_is_signed_and_big_endian(word: str, volts: float) -> None:
    assert ads1115.read_v(OneWord(word), ADDRESS, 0) == pytest.approx(volts, abs=1e-9)


def test_a_conversion_that_does_not_end_is_given_up() -> None:
    waited_ns: list[int] = []
    with pytest.raises(BusError, match="does not end") as caught:
        ads1115.convert_v(OneWord("7fff", config="43e3"), ADDRESS, 0, waited_ns.append)
    assert caught.value.kind == "timeout"
    assert waited_ns == [ads1115.CONVERSION_NS] * 5


def test_a_missing_chip_is_an_error_and_no_voltage(rig: BoardRig) -> None:
    rig.fake.world.put_in(I2cFailure(ADDRESS, "absent"))
    with pytest.raises(BusError) as caught:
        ads1115.read_v(bus(rig), ADDRESS, 0)
    assert caught.value.kind == "absent"
