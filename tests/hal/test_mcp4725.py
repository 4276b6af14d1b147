"""The rail's set-point on the wire: fast write, and reading back."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from board_rig import BoardRig
from etd_hal.chips import mcp4725
from etd_hal.errors import BoardFault, BusError
from etd_hal.fake.faults import I2cFailure
from etd_hal.ports import I2c

ADDRESS = 0x60


@pytest.fixture
def rig(boards: Callable[..., BoardRig]) -> BoardRig:
    return boards("reference-hv507", begun=False)


def bus(rig: BoardRig) -> I2c:
    assert rig.stepped.backend.i2c is not None
    return rig.stepped.backend.i2c


@pytest.mark.parametrize(
    ("code", "sent"), [(0, "0000"), (1, "0001"), (0xDAC, "0dac"), (4095, "0fff")]
)
def test_a_code_is_a_fast_write_with_power_down_off(rig: BoardRig, code: int, sent: str) -> None:
    before = len(rig.records())
    mcp4725.write(bus(rig), ADDRESS, code)
    assert [record["tx"] for record in rig.since(before)] == [sent, ""]
    assert mcp4725.read(bus(rig), ADDRESS) == code


def test_nothing_is_written_to_the_memory_that_decides_the_power_up_output(rig: BoardRig) -> None:
    mcp4725.write(bus(rig), ADDRESS, 3_500)
    assert bus(rig).transfer(ADDRESS, b"", 5)[3:] == b"\x00\x00"


@pytest.mark.parametrize("code", [-1, 4096])
def test_a_code_outside_the_scale_is_refused_before_anything_is_sent(
    rig: BoardRig, code: int
) -> None:
    before = len(rig.records())
    with pytest.raises(ValueError, match=f"code {code} is outside"):
        mcp4725.write(bus(rig), ADDRESS, code)
    assert rig.since(before) == []


class HoldsOther:
    """A chip that takes every write and holds 0xDAB."""

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        return b"\x80\xda\xb0"[:read_length]


def test_a_set_point_that_does_not_hold_is_a_fault() -> None:
    with pytest.raises(BoardFault) as caught:
        mcp4725.write(HoldsOther(), ADDRESS, 0xDAC)
    assert (caught.value.measured, caught.value.expected) == (str(0xDAB), str(0xDAC))


def test_a_chip_that_is_not_there_is_a_bus_error(rig: BoardRig) -> None:
    rig.fake.world.put_in(I2cFailure(ADDRESS, "absent"))
    with pytest.raises(BusError):
        mcp4725.write(bus(rig), ADDRESS, 100)
