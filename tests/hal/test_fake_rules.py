"""The rules that the fake watches, and the faults it can have."""

from __future__ import annotations

import pytest

from board_hand import MS, PAUSE, Hand, pulse, word
from etd_body.interface import Side
from etd_hal.boardfile import BoardFile
from etd_hal.errors import BusError
from etd_hal.fake.faults import (
    DacGain,
    Fault,
    I2cFailure,
    LineInverted,
    LinesSwapped,
    LostClock,
    MisoFlipped,
    MisoStuck,
    MosiFlipped,
    MosiStuck,
    SpiError,
    SpiShort,
    SpiStall,
    StuckBehind,
    StuckLine,
)
from etd_hal.ports import Message, Transfer
from stepped_board import SteppedBoard, stepped_board


class TestViolations:
    def test_a_clean_pulse_breaks_no_rule(self) -> None:
        rig = stepped_board()
        hand = Hand(rig)
        for polarity in (1, 0):
            hand.select(5, polarity)
            hand.spi.transfer(pulse(2_000, *[PAUSE] * 4))
            hand.discharge()
        rig.fake.close()
        assert rig.fake.violations == []

    def leave_dac_on(self) -> tuple[SteppedBoard, Hand]:
        rig = stepped_board("reference-hv507", faults=[SpiError(at_transfer=2)])
        hand = Hand(rig)
        hand.supply_on()
        hand.select(5)
        with pytest.raises(BusError):
            hand.spi.transfer(pulse(1_000, PAUSE))
        assert rig.fake.dac_code == 1_000
        return rig, hand

    def test_a_switch_line_that_changes_with_the_dac_on(self) -> None:
        rig, hand = self.leave_dac_on()
        rig.backend.gpio.set(((hand.lines.DATA, 1), (hand.lines.BL, 1)))
        assert len(rig.fake.violations) == 1
        assert "DATA changed with the DAC at code 1000" in rig.fake.violations[0]

    def test_safe_off_may_come_while_current_flows(self) -> None:
        rig, hand = self.leave_dac_on()
        guards = rig.board.guards
        assert guards.hv_enable != "absent"
        rig.backend.gpio.set(((hand.lines.POL, 1), (hand.lines.BL, 0), (guards.hv_enable.line, 0)))
        assert rig.fake.violations == []

    def test_safe_off_may_not_move_the_chain_too(self) -> None:
        rig, hand = self.leave_dac_on()
        rig.backend.gpio.set(((hand.lines.DATA, 1), (hand.lines.POL, 1), (hand.lines.BL, 0)))
        assert len(rig.fake.violations) == 2

    def test_all_outputs_high_while_the_supply_is_on(self) -> None:
        rig = stepped_board()
        rig.backend.gpio.set(((Hand(rig).lines.POL, 0),))
        assert "BL 0 with POL 0" in rig.fake.violations[0]

    def test_a_dac_that_is_left_on(self) -> None:
        rig, _ = self.leave_dac_on()
        rig.fake.close()
        assert "left at code 1000" in rig.fake.violations[-1]

    def test_a_reserved_dac_word(self) -> None:
        rig = stepped_board()
        rig.backend.spi.transfer(Message((Transfer(b"\x40\x00"),)))
        assert "reserved" in rig.fake.violations[0]

    def test_cs_change_on_the_last_transfer(self) -> None:
        rig = stepped_board()
        rig.backend.spi.transfer(Message((Transfer(word(9), cs_change=True),)))
        assert "last transfer" in rig.fake.violations[0]
        assert rig.fake.dac_code == 0

    @pytest.mark.parametrize(("supply", "violations"), [(True, 1), (False, 0)])
    def test_both_relays_of_one_electrode_under_voltage(
        self, supply: bool, violations: int
    ) -> None:
        rig = stepped_board("feetthrough-relay")
        board: BoardFile = rig.board
        lines, hv_enable = board.switch.lines, board.guards.hv_enable
        assert hv_enable != "absent"
        level = hv_enable.on if supply else 1 - hv_enable.on
        bits = [0] * (2 * board.switch.outputs)
        for pair in ([0, 0], [1, 1]):
            bits[-2:] = pair
            for bit in bits:
                rig.backend.gpio.set(((lines.DATA, bit), (lines.CLK, 1)))
                rig.backend.gpio.set(((lines.CLK, 0),))
            rig.backend.gpio.set(((lines.LE, 1),))
            rig.backend.gpio.set(((lines.LE, 0), (hv_enable.line, level)))
            rig.clock.spend(200 * MS)
            rig.backend.gpio.get(lines.LE)
        told = [what for what in rig.fake.violations if "both relays" in what]
        assert len(rig.fake.violations) == len(told) == violations


class TestFaults:
    def test_after_an_spi_error_the_rest_is_not_sent(self) -> None:
        rig = stepped_board(faults=[SpiError(at_message=2, at_transfer=1)])
        hand = Hand(rig)
        hand.spi.transfer(pulse(0))
        begun_ns = rig.clock.now_ns()
        with pytest.raises(BusError) as raised:
            hand.spi.transfer(pulse(700))
        assert raised.value.kind == "io"
        assert rig.fake.dac_code == 700
        assert rig.clock.now_ns() > begun_ns
        assert rig.events("spi")[-1]["bytes"] == 2

    def test_a_short_return_is_an_error_though_all_was_sent(self) -> None:
        rig = stepped_board(faults=[SpiShort()])
        with pytest.raises(BusError) as raised:
            Hand(rig).spi.transfer(pulse(700))
        assert raised.value.kind == "short"
        assert rig.fake.dac_code == 0

    def test_a_stall_lengthens_the_pulse_and_lets_others_act(self) -> None:
        rig = stepped_board(faults=[SpiStall(2_000)])
        hand = Hand(rig)
        hand.select(0)
        stop_ns = rig.clock.now_ns() + 1 * MS
        blanked = ((hand.lines.POL, 1), (hand.lines.BL, 0))
        rig.clock.at(stop_ns, lambda: hand.gpio.set(blanked))
        hand.spi.transfer(pulse(1_000, PAUSE))
        rises = [event["t_ns"] for event in rig.events("spi") if event.get("active") is False]
        blank_ns = rig.events("gpio")[-1]["t_ns"]
        assert rises[0] < blank_ns < rises[1]
        assert rises[1] - rises[0] > 2 * MS
        assert rig.fake.violations == []

    def test_a_gain_error_passes_more_than_the_word_says(self) -> None:
        currents = []
        for faults in ([], [DacGain(1.5)]):
            rig = stepped_board(faults=faults)
            hand = Hand(rig)
            hand.select(0)
            hand.spi.transfer(pulse(500, *[PAUSE] * 8))
            currents.append(rig.events("body")[0])
        assert currents[0]["asked_ua"] == currents[1]["asked_ua"]
        assert currents[1]["current_ua"] == pytest.approx(1.5 * currents[0]["current_ua"], rel=0.01)

    @pytest.mark.parametrize(("level", "read"), [(0, b"\x00\x00"), (1, b"\xff\xff")])
    def test_a_stuck_data_line_reads_the_same_for_ever(self, level: int, read: bytes) -> None:
        rig = stepped_board(faults=[MisoStuck(1 if level else 0)])
        assert set(rig.backend.spi.transfer(pulse(100, PAUSE))) == {read}

    def test_a_stuck_blank_line_does_not_select(self) -> None:
        rig = stepped_board(faults=[StuckLine("BL", 0)])
        grounded = rig.fake.sides
        Hand(rig).select(3)
        assert rig.fake.sides is grounded

    @pytest.mark.parametrize(
        ("board", "name"),
        [("reference-hv507", "SYNC"), ("reference-hv507", "hv"), ("kajimoto-hv507", "HEARTBEAT")],
    )
    def test_a_line_with_nothing_behind_it_cannot_be_wrong_there(
        self, board: str, name: str
    ) -> None:
        rig = stepped_board(board)
        said = f"'{name}' cannot be wrong beyond its pin: name POL, "
        for fault in (StuckBehind(name, 1), LineInverted(name), LinesSwapped("POL", name)):
            with pytest.raises(ValueError, match=said):
                rig.fake.world.put_in(fault)
            with pytest.raises(ValueError, match=said):
                stepped_board(board, faults=[fault])

    @pytest.mark.parametrize(
        ("fault", "bl"), [(LinesSwapped("BL", "POL"), 0), (LineInverted("POL"), 1)]
    )
    def test_wires_beyond_the_pins_may_be_swapped_or_inverted(self, fault: Fault, bl: int) -> None:
        """The board sees BL 1 and POL 0, where the pins say POL 1."""
        rig = stepped_board(faults=[fault])
        hand = Hand(rig)
        hand.select(3)
        for pol in (0, 1):
            hand.gpio.set(((hand.lines.POL, pol),))
        hand.gpio.set(((hand.lines.BL, bl),))
        assert (hand.gpio.get(hand.lines.POL), hand.gpio.get(hand.lines.BL)) == (1, bl)
        assert rig.fake.sides[3] is Side.GROUND
        assert rig.fake.sides.count(Side.GROUND) == 1

    @pytest.mark.parametrize("kind", ["absent", "io", "timeout"])
    def test_i2c_fails_as_often_as_it_is_told(self, kind: str) -> None:
        rig = stepped_board(
            "reference-hv507",
            faults=[I2cFailure(0x48, kind, times=2)],  # type: ignore[arg-type]
        )
        i2c = rig.backend.i2c
        assert i2c is not None
        begun_ns = rig.clock.now_ns()
        for _ in range(2):
            with pytest.raises(BusError) as raised:
                i2c.transfer(0x48, b"\x00", 2)
            assert raised.value.kind == kind
        assert (rig.clock.now_ns() - begun_ns > 1_900 * MS) is (kind == "timeout")
        assert len(i2c.transfer(0x48, b"\x00", 2)) == 2

    def test_a_bit_on_the_way_to_the_dac_is_flipped_once(self) -> None:
        rig = stepped_board(faults=[MosiFlipped(bit=12, at_word=2)])
        rig.backend.spi.transfer(pulse(5))
        assert rig.fake.dac_code == 1_024
        rig.backend.spi.transfer(pulse(5))
        assert rig.fake.dac_code == 0

    @pytest.mark.parametrize(("level", "complaints"), [(0, 0), (1, 2)])
    def test_a_data_line_that_does_not_move_sends_zeros_or_words_that_are_none(
        self, level: int, complaints: int
    ) -> None:
        rig = stepped_board(faults=[MosiStuck(1 if level else 0)])
        rig.backend.spi.transfer(pulse(900))
        assert rig.fake.dac_code == 0
        assert len(rig.fake.violations) == complaints

    def test_a_bit_of_every_second_word_is_read_the_other_way(self) -> None:
        rig = stepped_board(faults=[MisoFlipped(bit=9, every=2)])
        read = [*rig.backend.spi.transfer(pulse(0)), *rig.backend.spi.transfer(pulse(0))]
        assert read == [b"\x00\x00", b"\x02\x00", b"\x00\x00", b"\x02\x00"]

    def test_a_fault_can_be_put_in_and_taken_out_while_the_board_runs(self) -> None:
        rig = stepped_board()
        rig.fake.world.put_in(LostClock())
        rig.fake.world.put_in(MisoStuck(1))
        assert rig.backend.spi.transfer(pulse(0))[0] == b"\xff\xff"
        rig.fake.world.take_out(MisoStuck(1))
        assert rig.backend.spi.transfer(pulse(0))[0] == b"\x00\x00"
