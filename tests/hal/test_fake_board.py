"""The fake board as a whole: time, current, supply, stop lines, and who holds it."""

from __future__ import annotations

from math import log

import msgspec
import pytest

from board_hand import MS, PAUSE, Hand, pulse, word
from etd_body.electrode import load
from etd_body.minimal import MinimalBody
from etd_hal.errors import BusError
from etd_hal.fake.faults import (
    RailOff,
    SpiStall,
)
from etd_hal.fake.timeline import Timeline
from etd_hal.fake.trace import Trace
from etd_hal.linesetup import line_setup, spi_setup
from etd_hal.ports import Edge, InputLine, LineSetup, Message, Transfer
from stepped_board import shipped_board, stepped_board

ALL_BOARDS = [
    "kajimoto-hv507",
    "reference-hv507",
    "etactilekit-hv513",
    "etactilekit-hv513-x8",
    "feetthrough-relay",
]


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

    @pytest.mark.parametrize("current_ua", [100, 400, 4_000])
    def test_what_the_capacitor_holds_is_all_that_a_current_gets_without_its_supply(
        self, current_ua: int
    ) -> None:
        """272 nF, and the string of resistors beside it."""
        shipped = shipped_board("reference-hv507")
        guards = msgspec.structs.replace(shipped.guards, one_shot="absent")
        board = msgspec.structs.replace(shipped, guards=guards)
        body = MinimalBody([load(10_000), load(1.0)], leak_ohm=1e9, compliance_v=300)
        rig = stepped_board(board=board, electrodes=[0, 1], body=body)
        hand = Hand(rig)
        hand.supply_on()
        hand.select(0)
        code = round(current_ua * 4_095 / board.source.full_scale_ua)
        hand.spi.transfer(Message((Transfer(word(code)),)))
        assert guards.hv_enable != "absent"
        assert guards.rail_monitor != "absent"
        flowed_pc = body.charge_pc(0)
        rig.backend.gpio.set(((guards.hv_enable.line, 0),))
        rig.clock.spend(10_000 * MS)
        rig.fake.settle()
        # V(t) = (V0 + I R) exp(-t / RC) - I R, and the current ends with it.
        tau_s = guards.rail_monitor.fall_ms / 4_000
        string_ohm = tau_s / 272e-9
        alone_v = current_ua * 1e-6 * string_ohm
        expected_uc = current_ua * tau_s * log(1 + 300 / alone_v)
        got_uc = (body.charge_pc(0) - flowed_pc) / 1e6
        # The load sees no more than the rail: what the last volts drive is less than the current.
        assert expected_uc - 272e-3 * current_ua * 0.01 < got_uc < min(1.02 * expected_uc, 82)
        rig.clock.spend(1_000 * MS)
        rig.fake.settle()
        assert (body.charge_pc(0) - flowed_pc) / 1e6 == pytest.approx(got_uc)


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


def test_an_electrode_on_an_output_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match="output 64"):
        stepped_board(electrodes=[64])


def test_a_call_that_comes_with_an_earlier_time_is_put_after_what_happened() -> None:
    timeline = Timeline(1_000, Trace())
    timeline.end(5_000)
    assert timeline.start(4_000) == 5_000
