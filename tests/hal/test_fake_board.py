"""The fake board as a whole: time, trace, limits, and the rules it watches."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_body.electrode import load
from etd_body.minimal import MinimalBody
from etd_hal.boardfile import BoardFile, HalfBridgeLines
from etd_hal.compose import line_setup, spi_setup
from etd_hal.errors import BusError
from etd_hal.fake.faults import (
    DacGain,
    I2cFailure,
    LostClock,
    MisoStuck,
    RailOff,
    SpiError,
    SpiShort,
    SpiStall,
    StuckLine,
)
from etd_hal.fake.timeline import Timeline
from etd_hal.fake.trace import Trace
from etd_hal.ports import Edge, InputLine, LineSetup, Message, Transfer
from stepped_board import SteppedBoard, shipped_board, stepped_board

MS = 1_000_000
PAUSE = Transfer(delay_us=10)
ALL_BOARDS = [
    "kajimoto-hv507",
    "reference-hv507",
    "etactilekit-hv513",
    "etactilekit-hv513-x8",
    "feetthrough-relay",
]


def word(code: int) -> bytes:
    return (code << 2 & 0x3FFC).to_bytes(2, "big")


def pulse(code: int, *pauses: Transfer) -> Message:
    return Message((Transfer(word(code), cs_change=True), *pauses, Transfer(word(0))))


class Hand:
    """Moves a board's lines as a driver would, without one."""

    def __init__(self, rig: SteppedBoard) -> None:
        self.rig = rig
        self.gpio = rig.backend.gpio
        self.spi = rig.backend.spi
        lines = rig.board.switch.lines
        assert isinstance(lines, HalfBridgeLines)
        self.lines = lines

    def select(self, output: int, polarity: int = 1) -> None:
        lines = self.lines
        for stage in reversed(range(self.rig.board.switch.outputs)):
            self.gpio.set(((lines.DATA, int(stage == output)), (lines.CLK, 1)))
            self.gpio.set(((lines.CLK, 0),))
        self.gpio.set(((lines.LE, 1),))
        self.gpio.set(((lines.LE, 0),))
        self.gpio.set(((lines.BL, 1),))
        if not polarity:
            self.gpio.set(((lines.POL, 0),))

    def discharge(self) -> None:
        self.gpio.set(((self.lines.POL, 1),))
        self.gpio.set(((self.lines.BL, 0),))

    def supply_on(self) -> None:
        """Enable the supply, set it to nominal, and keep it beating until it is up."""
        guards, board = self.rig.board.guards, self.rig.board
        assert guards.hv_enable != "absent"
        if board.rail_setpoint != "absent":
            assert self.rig.backend.i2c is not None
            code = board.rail_setpoint.code.to_bytes(2, "big")
            self.rig.backend.i2c.transfer(board.rail_setpoint.address, code, 0)
        self.gpio.set(((guards.hv_enable.line, guards.hv_enable.on),))
        self.beat(500 * MS)

    def beat(self, duration_ns: int) -> None:
        heartbeat = self.rig.board.guards.heartbeat
        assert heartbeat != "absent"
        until_ns = self.rig.clock.now_ns() + duration_ns
        for level in itertools.cycle((1, 0)):
            self.gpio.set(((heartbeat.line, level),))
            self.rig.clock.spend(10 * MS)
            if self.rig.clock.now_ns() >= until_ns:
                return


class TestTime:
    def test_a_pulse_lasts_as_the_cost_model_says(self) -> None:
        rig = stepped_board()
        hand = Hand(rig)
        hand.select(3)
        hand.spi.transfer(pulse(1_000, *[PAUSE] * 8))
        rises = [event["t_ns"] for event in rig.events("spi") if event.get("active") is False]
        clocking_ns = round(18e9 / rig.board.source.speed_hz)
        assert rises[1] - rises[0] == 10_000 + 400 + 3_000 + clocking_ns + 700 + 8 * 10_300

    def test_a_delay_above_10_us_is_overslept(self) -> None:
        rig = stepped_board()
        Hand(rig).spi.transfer(pulse(0, Transfer(delay_us=100)))
        rises = [event["t_ns"] for event in rig.events("spi") if event.get("active") is False]
        assert rises[1] - rises[0] > 160_000

    def test_a_set_call_costs_the_same_for_any_number_of_lines(self) -> None:
        rig = stepped_board()
        lines = Hand(rig).lines
        begun_ns = rig.clock.now_ns()
        rig.backend.gpio.set(((lines.DATA, 1),))
        rig.backend.gpio.set(((lines.DATA, 0), (lines.CLK, 1), (lines.LE, 0)))
        assert rig.clock.now_ns() - begun_ns == 8_800

    def test_lines_of_one_call_change_in_ascending_order_50_ns_apart(self) -> None:
        rig = stepped_board()
        lines = Hand(rig).lines
        rig.backend.gpio.set(((lines.CLK, 1), (lines.DATA, 1)))
        (first, second) = rig.events("gpio")[-2:]
        assert (first["line"], second["line"]) == (lines.DATA, lines.CLK)
        assert second["t_ns"] - first["t_ns"] == 50


class TestTrace:
    def test_the_header_is_the_documented_one(self) -> None:
        rig = stepped_board(electrodes=[5, 3, 60])
        header = rig.trace_lines()[0]
        assert list(header) == [
            *("etd_trace", "board", "switch", "outputs", "lines"),
            *("full_scale_ua", "codes", "electrodes"),
        ]
        assert header["lines"] == {"POL": 4, "DATA": 5, "LE": 22, "BL": 23, "CLK": 24}
        assert (header["switch"], header["electrodes"]) == ("HV507", [5, 3, 60])

    def test_a_relay_board_adds_how_to_read_its_stages(self) -> None:
        header = stepped_board("feetthrough-relay").trace_lines()[0]
        assert list(header)[-5:] == [
            "bits_per_electrode",
            "on_bit",
            "return_bit",
            "ton_us",
            "toff_us",
        ]
        assert set(header["lines"]) == {"DATA", "LE", "CLK", "HV"}

    def test_the_reference_board_names_its_guards_lines(self) -> None:
        lines = stepped_board("reference-hv507").trace_lines()[0]["lines"]
        assert set(lines) == {
            *("POL", "DATA", "LE", "BL", "CLK", "HV", "HEARTBEAT"),
            *("READBACK", "EMERGENCY_STOP", "WEARER_STOP", "SYNC"),
        }

    @pytest.mark.parametrize("name", ALL_BOARDS)
    def test_the_levels_of_the_request_come_first_in_its_order(self, name: str) -> None:
        rig = stepped_board(name)
        events = [(event["line"], event["value"]) for event in rig.trace_lines()[1:]]
        assert events == list(line_setup(rig.board).outputs)

    def test_a_message_is_written_step_by_step(self) -> None:
        rig = stepped_board()
        Hand(rig).spi.transfer(pulse(0, Transfer(delay_us=7)))
        events = rig.events("spi")
        assert [list(event) for event in events] == [
            ["t_ns", "bus", "event", "transfers"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "tx", "rx", "delay_us", "cs_change"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "tx", "rx", "delay_us", "cs_change"],
            ["t_ns", "bus", "event", "tx", "rx", "delay_us", "cs_change"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "bytes"],
        ]
        assert [event["active"] for event in events if event["event"] == "cs"] == [
            *(True, False, True, False)
        ]
        assert events[0]["transfers"] == 3
        assert events[2]["cs_change"] is True
        assert (events[5]["tx"], events[5]["rx"], events[5]["delay_us"]) == ("", "", 7)
        assert events[-1]["bytes"] == 4

    @pytest.mark.parametrize(("output", "polarity"), [(3, 1), (3, 0), (63, 1)])
    def test_each_phase_has_the_bodys_account(self, output: int, polarity: int) -> None:
        rig = stepped_board(electrodes=range(63, -1, -1))
        hand = Hand(rig)
        hand.select(output, polarity)
        before_pc = rig.body.charge_pc(63 - output)
        hand.spi.transfer(pulse(1_228, *[PAUSE] * 8))
        (record,) = rig.events("body")
        rises = [event["t_ns"] for event in rig.events("spi") if event.get("active") is False]
        sign = 1 if polarity else -1
        width_us = (rises[1] - rises[0]) / 1_000
        assert record["electrode"] == 63 - output
        assert (record["from_ns"], record["to_ns"], record["t_ns"]) == (*rises, rises[1])
        assert record["asked_ua"] == sign * round(1_228 * 10_000 / 4_095)
        charge_pc = record["current_ua"] * width_us
        assert charge_pc == pytest.approx(rig.body.charge_pc(63 - output) - before_pc, rel=0.01)
        assert 0 < record["current_ua"] * sign < record["asked_ua"] * sign

    def test_repeating_the_code_for_an_end_sample_is_one_phase(self) -> None:
        rig = stepped_board()
        hand = Hand(rig)
        hand.select(0)
        again = Transfer(word(500), cs_change=True)
        reads = hand.spi.transfer(Message((again, PAUSE, again, Transfer(word(0)))))
        assert len(rig.events("body")) == 1
        samples = [int.from_bytes(read, "big") >> 2 for read in reads]
        assert samples[0] == 0 < samples[1] < samples[2]

    def test_an_engines_mark_stands_between_the_calls(self) -> None:
        rig = stepped_board()
        rig.backend.marker.mark("frame", 7, 3)
        rig.backend.marker.mark("mark", 8, None)
        assert [list(event.values())[1:] for event in rig.events("engine")] == [
            ["engine", "frame", 7, 3],
            ["engine", "mark", 8, None],
        ]

    @given(st.lists(st.integers(0, 5), max_size=12))
    def test_events_are_in_order_of_time_whatever_is_called(self, calls: list[int]) -> None:
        rig = stepped_board("reference-hv507")
        lines = Hand(rig).lines
        for call in calls:
            match call:
                case 0:
                    rig.backend.spi.transfer(pulse(0, PAUSE))
                case 1:
                    rig.backend.gpio.set(((lines.DATA, 1), (lines.CLK, 1)))
                case 2:
                    rig.backend.gpio.edges()
                case 3:
                    assert rig.backend.i2c is not None
                    rig.backend.i2c.transfer(0x48, b"\x00", 2)
                case 4:
                    rig.fake.world.press("wearer_stop", rig.clock.now_ns() + 6_000)
                case _:
                    rig.fake.world.release("wearer_stop")
        times = [event["t_ns"] for event in rig.trace_lines()[1:]]
        assert times == sorted(times)


class TestCurrent:
    def test_the_sample_is_the_voltage_of_the_node(self) -> None:
        board = shipped_board("kajimoto-hv507")
        body = MinimalBody(
            [load(33_000), load(1.0)],
            leak_ohm=board.source.leak_ohm,
            compliance_v=board.source.compliance_v,
        )
        rig = stepped_board(electrodes=[0, 1], body=body)
        hand = Hand(rig)
        hand.select(0)
        _, read = hand.spi.transfer(pulse(1_638, *[PAUSE] * 8))
        expected_v = 4e-3 * 66_000 * 33_001 / 99_001
        code = int.from_bytes(read, "big") >> 2
        assert code == pytest.approx(expected_v / 0.0893, abs=1)

    def test_outputs_without_an_electrode_are_connected_to_nothing(self) -> None:
        rig = stepped_board(electrodes=range(8))
        hand = Hand(rig)
        hand.select(30)
        _, read = hand.spi.transfer(pulse(1_000, *[PAUSE] * 4))
        open_v = 1_000 * 10e-3 / 4_095 * 66_000
        assert int.from_bytes(read, "big") >> 2 == pytest.approx(open_v / 0.0893, abs=1)
        assert rig.events("body") == []

    def test_without_supply_nothing_flows(self) -> None:
        rig = stepped_board("reference-hv507")
        hand = Hand(rig)
        hand.select(0)
        hand.spi.transfer(pulse(1_000, *[PAUSE] * 8))
        assert rig.events("body")[0]["current_ua"] == 0

    def test_the_one_shot_ends_a_pulse_that_lasts_too_long(self) -> None:
        delivered = []
        for stall_us in (0, 100, 5_000):
            rig = stepped_board("reference-hv507", faults=[SpiStall(stall_us)])
            hand = Hand(rig)
            hand.supply_on()
            hand.select(0)
            before_pc = rig.body.charge_pc(0)
            hand.spi.transfer(pulse(1_000, *[PAUSE] * 2))
            delivered.append(rig.body.charge_pc(0) - before_pc)
        assert delivered[0] < delivered[1] < delivered[2]
        assert delivered[2] < 2_442 * 250

    def test_the_one_shot_is_ready_again_for_the_next_pulse(self) -> None:
        rig = stepped_board("reference-hv507", faults=[SpiStall(5_000)])
        hand = Hand(rig)
        hand.supply_on()
        hand.select(0)
        for _ in range(3):
            hand.spi.transfer(pulse(1_000, *[PAUSE] * 8))
            rig.clock.spend(2 * MS)
        cut, first, second = (record["current_ua"] for record in rig.events("body"))
        assert cut < first / 10
        assert first == pytest.approx(second, rel=0.05)


class TestSupply:
    def test_a_board_without_enable_line_has_its_supply_on(self) -> None:
        assert stepped_board("kajimoto-hv507").fake.world.rail_v() == 300.0

    def test_the_rail_rises_within_a_part_of_its_time_and_is_seen_by_the_monitor(self) -> None:
        rig = stepped_board("reference-hv507")
        hand = Hand(rig)
        assert rig.fake.world.rail_v() == 0.0
        hand.supply_on()
        assert rig.fake.world.rail_v() == pytest.approx(300.0, abs=3)
        i2c = rig.backend.i2c
        assert i2c is not None
        i2c.transfer(0x48, bytes((1, 0xC3, 0xE3)), 0)
        hand.beat(20 * MS)
        i2c.transfer(0x48, b"\x00", 0)
        code = int.from_bytes(i2c.transfer(0x48, b"", 2), "big")
        assert code / 32_768 * 4.096 * 100 == pytest.approx(300.0, abs=3)

    def test_a_set_point_that_was_never_written_leaves_the_rail_low(self) -> None:
        rig = stepped_board("reference-hv507")
        guards = rig.board.guards
        assert guards.hv_enable != "absent"
        rig.backend.gpio.set(((guards.hv_enable.line, 1),))
        Hand(rig).beat(500 * MS)
        assert rig.fake.world.rail_v() == pytest.approx(150.0, abs=2)

    def test_without_heartbeat_the_rail_falls(self) -> None:
        rig = stepped_board("reference-hv507")
        hand = Hand(rig)
        hand.supply_on()
        rig.clock.spend(15 * MS)
        up_v = rig.fake.world.rail_v()
        rig.clock.spend(3_500 * MS)
        assert up_v > 290.0
        rig.backend.gpio.edges()
        assert rig.fake.world.rail_v() < 30.0

    def test_the_enable_line_takes_the_rail_down_within_its_time(self) -> None:
        rig = stepped_board("reference-hv507")
        hand = Hand(rig)
        hand.supply_on()
        guards = rig.board.guards
        assert guards.hv_enable != "absent"
        rig.backend.gpio.set(((guards.hv_enable.line, 0),))
        hand.beat(1_000 * MS)
        assert rig.fake.world.rail_v() > 30.0
        hand.beat(2_500 * MS)
        assert rig.fake.world.rail_v() < 30.0

    @pytest.mark.parametrize("factor", [0.8, 1.2])
    def test_a_rail_that_is_off_shows(self, factor: float) -> None:
        rig = stepped_board("reference-hv507", faults=[RailOff(factor)])
        Hand(rig).supply_on()
        assert rig.fake.world.rail_v() == pytest.approx(300.0 * factor, rel=0.01)


class TestStopLines:
    def test_a_press_is_an_edge_with_its_own_time(self) -> None:
        rig = stepped_board("reference-hv507")
        at_ns = rig.clock.now_ns() + 3_000
        rig.fake.world.press("emergency_stop", at_ns)
        assert rig.backend.gpio.edges() == ()
        assert rig.backend.gpio.edges() == (Edge(17, 0, at_ns),)
        assert rig.backend.gpio.get(17) == 0
        rig.fake.world.release("emergency_stop")
        assert rig.backend.gpio.get(17) == 1

    def test_a_line_without_edges_asked_for_has_none(self) -> None:
        rig = stepped_board("reference-hv507")
        rig.backend.close()
        asked = line_setup(rig.board)
        quiet = tuple(InputLine(entry.line, entry.pull) for entry in asked.inputs)
        ports = rig.fake.request(LineSetup(asked.outputs, quiet), spi_setup(rig.board))
        rig.fake.world.press("emergency_stop")
        assert ports.gpio.edges() == ()
        assert ports.gpio.get(17) == 0

    def test_a_board_without_a_stop_says_so(self) -> None:
        with pytest.raises(ValueError, match="no wearer_stop"):
            stepped_board("kajimoto-hv507").fake.world.press("wearer_stop")


class TestHolding:
    @pytest.mark.parametrize("name", ALL_BOARDS)
    def test_a_second_request_is_busy_and_names_the_holder(self, name: str) -> None:
        rig = stepped_board(name)
        with pytest.raises(BusError) as raised:
            rig.fake.request(line_setup(rig.board), spi_setup(rig.board))
        assert raised.value.kind == "busy"
        assert "etd" in raised.value.detail

    def test_lines_keep_their_levels_when_they_are_let_go(self) -> None:
        rig = stepped_board()
        hand = Hand(rig)
        hand.select(9)
        selected = rig.fake.sides
        rig.backend.close()
        assert rig.fake.sides is selected

    def test_after_a_release_they_can_be_requested_again(self) -> None:
        rig = stepped_board()
        rig.backend.close()
        ports = rig.fake.request(line_setup(rig.board), spi_setup(rig.board))
        assert ports.gpio.get(4) == 1

    def test_ports_that_were_let_go_are_gone(self) -> None:
        rig = stepped_board()
        rig.backend.close()
        with pytest.raises(BusError):
            rig.backend.spi.transfer(pulse(0))
        with pytest.raises(BusError):
            rig.backend.gpio.set(((4, 1),))

    def test_a_wrong_spi_device_is_absent(self) -> None:
        rig = stepped_board()
        rig.backend.close()
        other = spi_setup(rig.board)
        wrong = type(other)("/dev/spidev1.0", other.mode, other.speed_hz)
        with pytest.raises(BusError) as raised:
            rig.fake.request(line_setup(rig.board), wrong)
        assert raised.value.kind == "absent"


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

    def test_a_fault_can_be_put_in_and_taken_out_while_the_board_runs(self) -> None:
        rig = stepped_board()
        rig.fake.world.put_in(LostClock())
        rig.fake.world.put_in(MisoStuck(1))
        assert rig.backend.spi.transfer(pulse(0))[0] == b"\xff\xff"
        rig.fake.world.take_out(MisoStuck(1))
        assert rig.backend.spi.transfer(pulse(0))[0] == b"\x00\x00"


def test_an_electrode_on_an_output_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match="output 64"):
        stepped_board(electrodes=[64])


def test_a_call_that_comes_with_an_earlier_time_is_put_after_what_happened() -> None:
    timeline = Timeline(1_000, Trace())
    timeline.end(5_000)
    assert timeline.start(4_000) == 5_000
