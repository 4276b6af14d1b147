"""A word through the whole chain and back, on both kinds of switch; and the supply's latch."""

from __future__ import annotations

import pytest

from board_rig import board_rig, changed
from etd_hal.chips import mcp4725
from etd_hal.errors import BoardFault
from etd_hal.fake.faults import HeartbeatRearms, LostClock, SetpointAtPowerUp
from stepped_board import shipped_board, stepped_board

MS = 1_000_000


@pytest.mark.parametrize("name", ["reference-hv507", "feetthrough-relay"])
def test_a_word_comes_back_as_it_was_sent(name: str) -> None:
    rig = board_rig(board=changed(shipped_board(name), "guards", readback=18))
    assert rig.board.safe_off() == ()
    for sent in (0x8000_0000_0000_0001, 0x1234_5678_9ABC_DEF0, 0):
        assert rig.board.switch.loop_back(sent) == sent
    rig.board.switch.clear()
    assert rig.fake.violations == []


def test_a_lost_clock_moves_it() -> None:
    rig = board_rig("reference-hv507", faults=[LostClock(at_edge=70)])
    rig.board.safe_off()
    assert rig.board.switch.loop_back(1 << 63 | 1) != 1 << 63 | 1


def test_without_a_line_for_it_there_is_nothing_to_read() -> None:
    rig = board_rig("kajimoto-hv507")
    rig.board.safe_off()
    with pytest.raises(BoardFault, match="readback"):
        rig.board.switch.loop_back(1)


@pytest.mark.parametrize("stored", [0, 0xABC])
def test_the_set_points_value_at_power_up_is_read_from_its_eeprom(stored: int) -> None:
    made = stepped_board("reference-hv507", faults=[SetpointAtPowerUp(stored)])
    assert made.backend.i2c is not None
    mcp4725.write(made.backend.i2c, 0x60, 1_000)
    assert mcp4725.read_power_up(made.backend.i2c, 0x60) == stored


@pytest.mark.parametrize(("faults", "comes_back"), [((), False), ((HeartbeatRearms(),), True)])
def test_a_supply_that_lost_its_heartbeat_comes_back_only_by_way_of_its_enable(
    faults: tuple[HeartbeatRearms, ...], comes_back: bool
) -> None:
    rig = board_rig("reference-hv507", faults=faults)
    rig.board.safe_off()

    def beat_for_ms(duration_ms: int) -> float:
        for _ in range(duration_ms // 5):
            rig.board.beat()
            rig.clock.spend(5 * MS)
        return rig.fake.world.rail_v()

    rig.board.supply_on()
    assert beat_for_ms(1_000) > 100
    rig.clock.spend(3_000 * MS)
    assert (beat_for_ms(1_000) > 100) is comes_back
    rig.board.supply_off()
    rig.board.supply_on()
    assert beat_for_ms(1_000) > 100
    rig.board.safe_off()
