"""A board made live: pulses and what comes back, rests, supply, heartbeat, stop lines."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import msgspec
import pytest

from board_rig import BoardRig, fire_phase
from etd_hal.cutlatch import DUE_NS
from etd_hal.errors import BoardFault, BusError, GuardRefusal
from etd_hal.fake.faults import DacGain, MisoStuck, SpiError, SpiShort, SpiStall
from etd_hal.switch_shadow import Approval
from stepped_board import BOARDS, shipped_board

Boards = Callable[..., BoardRig]

#: Nothing connected: the source's node stands at the current times the leak of 66 k.
OPEN_V = 409 * 10_000 / 4095 * 1e-6 * 66_000
ONE_CODE_V = 0.0893


class TestPulse:
    @pytest.mark.parametrize(
        ("current_ua", "code", "commanded_ua"),
        [(0, 0, 0), (1_000, 409, 998), (10_000, 4095, 10_000)],
    )
    def test_its_code_is_the_largest_not_above_the_current(
        self, boards: Boards, current_ua: int, code: int, commanded_ua: int
    ) -> None:
        pulse = boards().board.pulse(current_ua, 100)
        assert (pulse.code, pulse.commanded_ua) == (code, commanded_ua)

    def test_the_same_pulse_is_prepared_once(self, boards: Boards) -> None:
        board = boards().board
        assert board.pulse(1_000, 100) is board.pulse(1_000, 100)

    def test_pulses_stay_right_beyond_what_is_remembered(self, boards: Boards) -> None:
        board = boards().board
        for current_ua in range(2_100):
            assert board.pulse(current_ua, 50).commanded_ua <= current_ua
        assert board.pulse(1_000, 50).code == 409
        assert board.pulse(1_000, 100).shape.width_us > 99

    def test_beyond_what_is_remembered_the_oldest_goes_and_no_other(self, boards: Boards) -> None:
        board = boards().board
        oldest, *others = [board.pulse(current_ua, 50) for current_ua in range(2_049)]
        assert all(board.pulse(ua, 50) is pulse for ua, pulse in enumerate(others, start=1))
        assert board.pulse(0, 50) is not oldest

    def test_before_any_calibration_there_is_no_pulse(self, boards: Boards) -> None:
        with pytest.raises(BoardFault, match="timing: measured not calibrated"):
            boards(begun=False).board.pulse(1_000, 100)

    def test_a_new_calibration_makes_new_pulses(self, boards: Boards) -> None:
        board = boards().board
        before = board.pulse(1_000, 100)
        board.calibrate()
        assert board.pulse(1_000, 100) is not before


class TestShot:
    def test_its_times_are_those_of_the_call(self, boards: Boards) -> None:
        rig = boards()
        result = rig.visit(5)
        body = rig.body()[-1]
        assert result.begun_ns < body["from_ns"] < body["to_ns"] < result.ended_ns
        assert abs(result.excess_ns) <= 2

    def test_a_pulse_that_the_board_has_forgotten_meanwhile_is_not_over_its_plan(
        self, boards: Boards
    ) -> None:
        rig = boards()
        rig.visit(5)
        for current_ua in range(2_000, 6_200, 2):
            rig.board.pulse(current_ua, 50)
        assert abs(rig.visit(6).excess_ns) <= 2

    def test_the_way_to_the_safe_state_lays_nothing_out_whatever_was_sent_before(
        self, boards: Boards
    ) -> None:
        rig = boards()

        def took_ns() -> int:
            begun_ns = rig.clock.now_ns()
            assert rig.board.safe_off() == ()
            return rig.clock.now_ns() - begun_ns

        before_ns = took_ns()
        for current_ua in range(2_000, 6_200, 2):
            rig.board.pulse(current_ua, 50)
        assert took_ns() == before_ns

    def test_what_a_message_takes_over_its_plan_is_excess(self, boards: Boards) -> None:
        rig = boards()
        rig.fake.world.put_in(SpiStall(stall_us=400))
        assert rig.visit(5).excess_ns == pytest.approx(400_000, abs=2)

    @pytest.mark.parametrize("width_us", [25, 50, 100])
    def test_an_electrode_in_the_air_reads_as_the_leak_alone(
        self, boards: Boards, width_us: int
    ) -> None:
        rig = boards()
        rig.fake.world.lift(5)
        result = rig.visit(5, width_us=width_us)
        assert result.baseline_v == 0.0
        assert result.voltage_v == pytest.approx(OPEN_V, abs=ONE_CODE_V)

    def test_with_an_end_sample_the_voltage_is_that_near_the_end(self, boards: Boards) -> None:
        """The skin charges through the pulse, so the end lies above the value after 10 us."""
        early = boards().visit(5, width_us=32)
        late = boards().visit(5, width_us=100)
        assert late.voltage_v > early.voltage_v + ONE_CODE_V > 10

    def test_the_baseline_shows_what_is_on_the_node_before_the_pulse(self, boards: Boards) -> None:
        rig = boards()
        selection = rig.board.selection(5, None)
        rig.fake.world.lift(5)
        rig.board.prepare(selection)
        rig.board.connect(selection, True)
        rig.fake.world.put_in(SpiError(at_message=1, at_transfer=2))
        pulse = rig.board.pulse(1_000, 100)
        with pytest.raises(BusError):
            fire_phase(rig.board, pulse, selection, True, 1_000, 100)
        result = fire_phase(rig.board, pulse, selection, True, 1_000, 100)
        assert result.baseline_v == pytest.approx(OPEN_V, abs=ONE_CODE_V)

    def test_a_source_that_makes_more_than_told_shows_in_the_voltage(self, boards: Boards) -> None:
        rig = boards(faults=[DacGain(1.5)])
        rig.fake.world.lift(5)
        assert rig.visit(5).voltage_v == pytest.approx(1.5 * OPEN_V, abs=ONE_CODE_V)

    def test_a_floating_data_line_is_a_fault_and_no_voltage(self, boards: Boards) -> None:
        rig = boards()
        rig.fake.world.put_in(MisoStuck(1))
        with pytest.raises(BoardFault) as caught:
            rig.visit(5)
        assert caught.value.measured == "ffff"
        assert rig.fake.dac_code == 0

    @pytest.mark.parametrize("fault", [SpiError(), SpiShort(), SpiError(kind="timeout")])
    def test_a_failed_message_is_raised_and_never_sent_again(
        self, boards: Boards, fault: SpiError | SpiShort
    ) -> None:
        rig = boards()
        rig.fake.world.put_in(fault)
        before = len(rig.records())
        with pytest.raises(BusError):
            rig.visit(5)
        assert len([entry for entry in rig.since(before) if entry.get("event") == "message"]) == 1


class TestOverdue:
    def test_while_a_message_is_under_way_its_end_is_known(self, boards: Boards) -> None:
        rig = boards()
        rig.fake.world.put_in(SpiStall(stall_us=2_000, at_transfer=2))
        seen: list[int] = []
        rig.clock.at(
            rig.clock.now_ns() + 2_000_000, lambda: seen.append(rig.board.cut.words[DUE_NS])
        )
        result = rig.visit(5)
        assert seen == [result.ended_ns - result.excess_ns]
        assert rig.board.cut.words[DUE_NS] == 0

    def test_after_a_failed_message_none_is_under_way(self, boards: Boards) -> None:
        rig = boards()
        rig.fake.world.put_in(SpiError())
        with pytest.raises(BusError):
            rig.visit(5)
        assert rig.board.cut.words[DUE_NS] == 0


class TestRest:
    def test_all_rest_on_ground_for_the_boards_time_before_the_next(self, boards: Boards) -> None:
        rig = boards()
        for output in range(5):
            rig.visit(output)
        grounded, live = rig.times("BL", 0)[-5:-1], rig.times("BL", 1)[-4:]
        for from_ns, to_ns in zip(grounded, live, strict=True):
            assert to_ns - from_ns >= 200_000

    def test_the_rest_is_not_longer_than_it_must_be(self, boards: Boards) -> None:
        rig = boards()
        begun = [rig.visit(output).begun_ns for output in range(5)]
        assert all(later - earlier < 340_000 for earlier, later in pairwise(begun))

    def test_there_is_a_rest_after_the_safe_state_too(self, boards: Boards) -> None:
        rig = boards()
        rig.visit(1)
        assert rig.board.safe_off() == ()
        safe_ns = rig.clock.now_ns()
        rig.board.guard.permit(10_000)
        rig.visit(2)
        assert rig.times("BL", 1)[-1] - safe_ns >= 200_000

    def test_relays_stay_closed_through_the_rest_and_open_at_the_release(
        self, boards: Boards
    ) -> None:
        rig = boards("feetthrough-relay")
        ended_ns = rig.visit(5).ended_ns
        rig.board.release()
        assert rig.times("LE", 1)[-1] - ended_ns >= 200_000

    def test_a_release_leaves_half_bridges_as_they_are(self, boards: Boards) -> None:
        rig = boards()
        rig.visit(5)
        calls = rig.gpio.calls
        rig.board.release()
        assert rig.gpio.calls == calls


class TestApprovedAsFired:
    def test_a_pulse_stronger_than_its_limit_is_refused(self, boards: Boards) -> None:
        rig = boards()
        selection = rig.board.selection(5, None)
        rig.board.prepare(selection)
        rig.board.connect(selection, True)
        with pytest.raises(GuardRefusal, match="998 uA for 100 us"):
            fire_phase(rig.board, rig.board.pulse(1_000, 100), selection, True, 998, 100)

    def test_a_pulse_wider_than_its_limit_is_refused(self, boards: Boards) -> None:
        rig = boards()
        selection = rig.board.selection(5, None)
        rig.board.prepare(selection)
        rig.board.connect(selection, True)
        with pytest.raises(GuardRefusal, match="1000 uA for 50 us"):
            fire_phase(rig.board, rig.board.pulse(1_000, 100), selection, True, 1_000, 50)

    def test_a_selection_that_is_not_connected_is_refused(self, boards: Boards) -> None:
        rig = boards()
        there, elsewhere = (rig.board.selection(output, None) for output in (5, 6))
        rig.board.prepare(there)
        rig.board.connect(there, True)
        with pytest.raises(GuardRefusal, match="switch"):
            fire_phase(rig.board, rig.board.pulse(1_000, 100), elsewhere, True, 1_000, 100)
        with pytest.raises(GuardRefusal, match="switch"):
            fire_phase(rig.board, rig.board.pulse(1_000, 100), there, False, 1_000, 100)

    def test_what_is_approved_is_what_is_fired_and_no_more(self, boards: Boards) -> None:
        rig = boards()
        rig.visit(5)
        rig.board.guard.approve(Approval(1 << 6, 0, 1_000, 100))
        before = len(rig.body())
        rig.visit(6)
        assert len(rig.body()) == before + 1


class TestSupply:
    def test_it_follows_the_enable_line(self, boards: Boards) -> None:
        rig = boards("reference-hv507", begun=False)
        assert not rig.board.is_supply_on
        rig.board.supply_on()
        assert rig.story()[-1] == "HV=1"
        assert rig.board.is_supply_on
        rig.board.supply_off()
        assert rig.story()[-1] == "HV=0"
        assert not rig.board.is_supply_on

    def test_a_call_that_failed_leaves_it_counted_as_on(self, boards: Boards) -> None:
        """The line may have moved all the same."""
        rig = boards("reference-hv507", begun=False)
        rig.gpio.fails = frozenset({rig.gpio.calls, rig.gpio.calls + 1})
        for call in (rig.board.supply_on, rig.board.supply_off):
            with pytest.raises(BusError):
                call()
            assert rig.board.is_supply_on
        rig.board.supply_off()
        assert not rig.board.is_supply_on

    def test_without_an_enable_line_it_is_always_on(self, boards: Boards) -> None:
        rig = boards(begun=False)
        before = rig.gpio.calls
        assert rig.board.is_supply_on
        rig.board.supply_off()
        assert rig.board.is_supply_on
        rig.board.supply_on()
        assert rig.gpio.calls == before


class TestHeartbeat:
    def test_each_beat_is_one_edge(self, boards: Boards) -> None:
        rig = boards("reference-hv507")
        before = len(rig.records())
        for _ in range(4):
            rig.board.beat()
        assert rig.story(before) == ["HEARTBEAT=1", "HEARTBEAT=0", "HEARTBEAT=1", "HEARTBEAT=0"]

    def test_beats_hold_the_rail_up_and_their_end_lets_it_fall(self, boards: Boards) -> None:
        rig = boards("reference-hv507")
        for _ in range(100):
            rig.board.beat()
            rig.clock.spend(10_000_000)
        held_v = rig.fake.world.rail_v()
        rig.clock.spend(2_000_000_000)
        rig.board.sync()
        assert rig.fake.world.rail_v() < held_v / 2
        assert held_v > 100

    def test_without_its_line_nothing_is_sent(self, boards: Boards) -> None:
        rig = boards()
        before = rig.gpio.calls
        rig.board.beat()
        assert rig.gpio.calls == before


class TestSync:
    @pytest.mark.parametrize("name", sorted(path.stem for path in BOARDS.glob("*.toml")))
    def test_it_is_one_pulse_on_its_line_which_was_low_before(
        self, boards: Boards, name: str
    ) -> None:
        rig = boards(name)
        before = len(rig.records())
        assert rig.times("SYNC", 1) == []
        assert rig.board.sync()
        assert rig.story(before) == ["SYNC=1", "SYNC=0"]

    def test_without_its_line_it_says_so(self, boards: Boards) -> None:
        bare = msgspec.structs.replace(shipped_board("kajimoto-hv507"), sync_line="absent")
        rig = boards(board=bare)
        before = rig.gpio.calls
        assert not rig.board.sync()
        assert rig.gpio.calls == before


class TestStops:
    def test_closed_loops_are_no_stop(self, boards: Boards) -> None:
        rig = boards("reference-hv507")
        assert rig.board.stops() == {"emergency_stop": False, "wearer_stop": False}
        assert rig.board.stop_edges() == ()

    @pytest.mark.parametrize("stop", ["emergency_stop", "wearer_stop"])
    def test_an_open_loop_is_a_stop(self, boards: Boards, stop: str) -> None:
        rig = boards("reference-hv507")
        rig.fake.world.press(stop)  # type: ignore[arg-type]
        assert [name for name, is_open in rig.board.stops().items() if is_open] == [stop]
        assert rig.board.stop_edges() == ((stop, True),)

    def test_edges_come_once_in_the_order_of_their_times(self, boards: Boards) -> None:
        rig = boards("reference-hv507")
        now_ns = rig.clock.now_ns()
        rig.fake.world.press("wearer_stop", now_ns + 3_000)
        rig.fake.world.press("emergency_stop", now_ns + 1_000)
        rig.fake.world.release("wearer_stop", now_ns + 5_000)
        rig.clock.spend(10_000)
        assert rig.board.stop_edges() == (
            ("emergency_stop", True),
            ("wearer_stop", True),
            ("wearer_stop", False),
        )
        assert rig.board.stop_edges() == ()

    def test_a_short_press_between_two_looks_is_not_lost(self, boards: Boards) -> None:
        rig = boards("reference-hv507")
        now_ns = rig.clock.now_ns()
        rig.fake.world.press("emergency_stop", now_ns + 1_000)
        rig.fake.world.release("emergency_stop", now_ns + 2_000)
        rig.clock.spend(10_000)
        assert rig.board.stops()["emergency_stop"] is False
        assert ("emergency_stop", True) in rig.board.stop_edges()

    def test_without_stop_lines_there_are_none(self, boards: Boards) -> None:
        board = boards().board
        assert board.stops() == {}
        assert board.stop_edges() == ()
