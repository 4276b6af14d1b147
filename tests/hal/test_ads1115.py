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


def test_a_reading_asks_for_the_conversion_register(rig: BoardRig) -> None:
    ads1115.read_v(bus(rig), ADDRESS)
    assert rig.records()[-1]["tx"] == "00"
    assert len(rig.records()[-1]["rx"]) == 4


@pytest.mark.parametrize(("channel", "volts"), [(1, 0.5), (2, 1.234), (3, 3.0)])
def test_volts_at_an_input_come_back(rig: BoardRig, channel: int, volts: float) -> None:
    rig.fake.world.set_sensor_v(ADDRESS, channel, volts)
    ads1115.start(bus(rig), ADDRESS, channel)
    rig.clock.spend(ads1115.CONVERSION_NS)
    assert ads1115.read_v(bus(rig), ADDRESS) == pytest.approx(volts, abs=4.096 / 32_768)


def test_the_time_of_a_conversion_covers_one_old_and_one_new_period() -> None:
    assert ads1115.CONVERSION_NS >= 2 * 1_000_000_000 / 860 * 1.1


class OneWord:
    """A bus whose only chip answers with the same word."""

    def __init__(self, word: str) -> None:
        self._word = bytes.fromhex(word)

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        return self._word[:read_length]


@pytest.mark.parametrize(
    ("word", "volts"), [("7fff", 4.095875), ("0001", 0.000125), ("ffff", -0.000125)]
)
def test_the_register_is_signed_and_big_endian(word: str, volts: float) -> None:
    assert ads1115.read_v(OneWord(word), ADDRESS) == pytest.approx(volts, abs=1e-9)


def test_a_missing_chip_is_an_error_and_no_voltage(rig: BoardRig) -> None:
    rig.fake.world.put_in(I2cFailure(ADDRESS, "absent"))
    with pytest.raises(BusError) as caught:
        ads1115.read_v(bus(rig), ADDRESS)
    assert caught.value.kind == "absent"
