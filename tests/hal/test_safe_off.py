"""The way to the safe state: from anywhere, whatever fails, and in the right order on the wire."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from board_rig import BoardRig, fire_phase
from etd_body.interface import Side
from etd_hal.errors import BusError, GuardRefusal
from etd_hal.fake.faults import LatchIgnored, MisoStuck, SpiError, SpiStall, StuckLine
from etd_hal.selection import Selection

Boards = Callable[..., BoardRig]

REFERENCE, KIT, RELAYS = "reference-hv507", "kajimoto-hv507", "feetthrough-relay"
#: Too short for an end sample: transfers are the word, four delays, and zero.
WIDTH_US = 60


def half_way(rig: BoardRig, output: int = 5) -> Selection:
    """Connected, nothing fired yet."""
    selection = rig.board.selection(output, None)
    rig.board.prepare(selection)
    rig.board.connect(selection, True)
    return selection


def fire_with_fault(rig: BoardRig, at_transfer: int = 2) -> None:
    """The message breaks off with the current on."""
    selection = half_way(rig)
    rig.fake.world.put_in(SpiError(at_transfer=at_transfer))
    with pytest.raises(BusError):
        fire_phase(rig.board, rig.board.pulse(1_000, 100), selection, True, 1_000, 100)
    assert rig.fake.dac_code == 409


class TestOrder:
    def test_one_call_grounds_all_and_cuts_the_supply_then_the_dac_goes_to_zero(
        self, boards: Boards
    ) -> None:
        rig = boards(REFERENCE)
        half_way(rig)
        before, calls = len(rig.records()), rig.gpio.calls
        assert rig.board.safe_off() == ()
        assert rig.story(before)[:5] == ["POL=1", "BL=0", "HV=0", "dac=0000", "dac=0000"]
        assert dict(rig.gpio.sent[calls]) == {4: 1, 23: 0, 25: 0}

    def test_then_zeros_go_through_the_whole_chain_and_are_latched(self, boards: Boards) -> None:
        rig = boards()
        half_way(rig)
        before = len(rig.records())
        rig.board.safe_off()
        story = rig.story(before)
        assert story.count("CLK=1") == 64
        assert "DATA=1" not in story
        assert story[-3:] == ["LE=1", "CLK=0", "LE=0"]

    def test_where_the_supply_has_no_line_the_outputs_are_what_there_is(
        self, boards: Boards
    ) -> None:
        rig = boards()
        half_way(rig)
        before = len(rig.records())
        rig.board.safe_off()
        assert rig.story(before)[:3] == ["POL=1", "BL=0", "dac=0000"]

    def test_relays_lose_their_supply_then_the_current_then_open(self, boards: Boards) -> None:
        rig = boards(RELAYS)
        half_way(rig)
        before = len(rig.records())
        assert rig.board.safe_off() == ()
        assert rig.story(before)[:3] == ["HV=0", "dac=0000", "CLK=0"]
        assert set(rig.sides) == {Side.OPEN}

    @pytest.mark.parametrize("name", [REFERENCE, KIT])
    def test_out_of_inverse_polarity_no_output_is_lifted_on_the_way(
        self, boards: Boards, name: str
    ) -> None:
        rig = boards(name)
        selection = rig.board.selection(5, None)
        rig.board.prepare(selection)
        rig.board.connect(selection, False)
        before = len(rig.records())
        assert rig.board.safe_off() == ()
        assert rig.story(before)[:2] == ["POL=1", "BL=0"]


class TestFromAnywhere:
    @pytest.mark.parametrize("name", [REFERENCE, KIT, RELAYS])
    @pytest.mark.parametrize("steps", range(7))
    def test_from_the_middle_of_a_visit(self, boards: Boards, name: str, steps: int) -> None:
        rig = boards(name)
        board, selection = rig.board, rig.board.selection(5, None)
        pulse = board.pulse(1_000, WIDTH_US)
        visit: tuple[Callable[[], object], ...] = (
            lambda: board.prepare(selection),
            lambda: board.connect(selection, False),
            lambda: fire_phase(board, pulse, selection, False, 1_000, WIDTH_US),
            lambda: board.flip(selection, True),
            lambda: fire_phase(board, pulse, selection, True, 1_000, WIDTH_US),
            board.discharge,
        )
        for step in visit[:steps]:
            step()
        assert board.safe_off() == ()
        assert set(rig.sides) == {Side.OPEN if name == RELAYS else Side.GROUND}
        assert board.is_supply_on is (name == KIT)

    @pytest.mark.parametrize("name", [REFERENCE, KIT, RELAYS])
    def test_from_power_up(self, boards: Boards, name: str) -> None:
        rig = boards(name, begun=False)
        assert rig.board.safe_off() == ()
        assert rig.fake.dac_code == 0

    @pytest.mark.parametrize("name", [REFERENCE, KIT, RELAYS])
    @pytest.mark.parametrize("at_transfer", [1, 2, 5])
    def test_from_a_message_that_broke_off_with_the_current_on(
        self, boards: Boards, name: str, at_transfer: int
    ) -> None:
        rig = boards(name)
        fire_with_fault(rig, at_transfer)
        assert rig.board.safe_off() == ()
        assert rig.fake.dac_code == 0
        assert set(rig.sides) == {Side.OPEN if name == RELAYS else Side.GROUND}

    @pytest.mark.parametrize("name", [REFERENCE, KIT, RELAYS])
    def test_twice_is_as_good_as_once(self, boards: Boards, name: str) -> None:
        rig = boards(name)
        half_way(rig)
        assert rig.board.safe_off() == ()
        before, sides = len(rig.records()), rig.sides
        assert rig.board.safe_off() == ()
        assert rig.sides == sides
        assert "BL=1" not in rig.story(before)

    def test_afterwards_nothing_fires_until_it_is_permitted_again(self, boards: Boards) -> None:
        rig = boards()
        rig.visit(5)
        rig.board.safe_off()
        with pytest.raises(GuardRefusal, match="state"):
            rig.visit(5)
        rig.board.safe_off()
        rig.board.guard.permit(10_000)
        rig.visit(5)
        assert len(rig.body()) == 2

    def test_the_next_selection_is_written_whole(self, boards: Boards) -> None:
        rig = boards()
        rig.visit(5)
        rig.board.safe_off()
        rig.board.guard.permit(10_000)
        before = len(rig.records())
        rig.board.switch.reset()
        rig.visit(5)
        assert rig.story(before).count("CLK=1") == 64


class TestEachStepIsTried:
    def test_without_lines_the_dac_still_goes_to_zero(self, boards: Boards) -> None:
        rig = boards()
        fire_with_fault(rig)
        rig.gpio.fails = frozenset({rig.gpio.calls})
        set_failed, *others = rig.board.safe_off()
        assert set_failed == "set on the lines failed (io)"
        # The electrode is still connected, so its charge stands on the node.
        assert all("node with the DAC at zero" in problem for problem in others)
        assert rig.fake.dac_code == 0
        assert rig.board.safe_off() == ()

    def test_without_spi_the_lines_are_still_made_safe(self, boards: Boards) -> None:
        rig = boards(REFERENCE)
        half_way(rig)
        rig.fake.world.put_in(SpiError(at_message=1))
        rig.fake.world.put_in(SpiError(at_message=2, at_transfer=0))
        before = len(rig.records())
        problems = rig.board.safe_off()
        assert len(problems) == 2
        assert rig.story(before)[:3] == ["POL=1", "BL=0", "HV=0"]
        assert rig.story(before).count("CLK=1") == 64

    @pytest.mark.parametrize("call", [1, 2, 3, 40, 131])
    def test_a_failure_while_shifting_is_told_and_can_be_done_again(
        self, boards: Boards, call: int
    ) -> None:
        rig = boards()
        half_way(rig)
        rig.gpio.fails = frozenset({rig.gpio.calls + call})
        assert rig.board.safe_off() == ("set on the lines failed (io)",)
        assert set(rig.sides) == {Side.GROUND}
        assert rig.board.safe_off() == ()

    def test_with_every_port_gone_each_step_is_told(self, boards: Boards) -> None:
        rig = boards(REFERENCE)
        half_way(rig)
        rig.stepped.backend.close()
        problems = rig.board.safe_off()
        assert len(problems) == 4
        assert all("failed" in problem for problem in problems)
        assert rig.board.is_supply_on

    @pytest.mark.parametrize("name", [REFERENCE, RELAYS])
    def test_the_supply_counts_as_on_until_a_call_has_switched_it_off(
        self, boards: Boards, name: str
    ) -> None:
        rig = boards(name)
        before = len(rig.records())
        rig.gpio.fails = frozenset({rig.gpio.calls})
        assert "set on the lines failed (io)" in rig.board.safe_off()
        assert rig.times("HV", 0, before) == []
        assert rig.board.is_supply_on
        assert rig.board.safe_off() == ()
        assert not rig.board.is_supply_on

    def test_the_guard_lets_no_output_be_lifted_while_the_supply_may_be_on(
        self, boards: Boards
    ) -> None:
        """BL 0 with POL 0 connects all outputs to the source."""
        rig = boards(REFERENCE)
        rig.gpio.fails = frozenset({rig.gpio.calls})
        rig.board.safe_off()
        pol = rig.file.used_lines()["POL"]
        with pytest.raises(GuardRefusal, match="blanking"):
            rig.board.guard.gpio.set(((pol, 0),))


class TestVerified:
    @pytest.mark.parametrize("name", [REFERENCE, KIT, RELAYS])
    def test_lines_that_did_not_move_are_told_by_name(self, boards: Boards, name: str) -> None:
        rig = boards(name)
        half_way(rig)
        rig.gpio.does_nothing = frozenset({rig.gpio.calls})
        first, *_ = rig.board.safe_off()
        line = "HV" if name == RELAYS else "BL"
        number = rig.file.used_lines()[line]
        assert first == f"{line} (GPIO {number}) when read back: measured 1, expected 0"
        assert rig.board.is_supply_on
        assert rig.board.safe_off() == ()
        assert rig.board.is_supply_on is (name == KIT)

    def test_an_enable_line_that_is_held_high_is_told_each_time(self, boards: Boards) -> None:
        rig = boards(REFERENCE)
        rig.fake.world.put_in(StuckLine("HV", 1))
        for _ in range(3):
            first, *_ = rig.board.safe_off()
            assert first == "HV (GPIO 25) when read back: measured 1, expected 0"
            assert rig.board.is_supply_on

    def test_a_line_that_cannot_be_read_counts_as_not_moved(self, boards: Boards) -> None:
        rig = boards(REFERENCE)
        rig.gpio.reads = False
        assert "get on the lines failed (io)" in rig.board.safe_off()
        assert rig.board.is_supply_on

    def test_a_dac_that_stays_on_is_told_with_the_volts_of_its_node(self, boards: Boards) -> None:
        """The first zero is not sent, so the second one samples a node under current."""
        rig = boards()
        fire_with_fault(rig)
        rig.fake.world.put_in(SpiError(at_message=1, at_transfer=0))
        failed, stands = rig.board.safe_off()
        assert "transfer" in failed
        assert stands == "node with the DAC at zero: measured 66 V, expected 5.0 V"
        assert rig.board.safe_off() == ()

    def test_a_floating_data_line_is_told(self, boards: Boards) -> None:
        rig = boards()
        rig.fake.world.put_in(MisoStuck(1))
        (problem,) = rig.board.safe_off()
        assert "AD7276 frame: measured ffff" in problem

    @pytest.mark.parametrize("name", [REFERENCE, KIT, RELAYS])
    def test_skin_that_is_still_charged_is_not(self, boards: Boards, name: str) -> None:
        rig = boards(name)
        rig.clock.spend(300_000_000)
        rig.visit(5, current_ua=10_000, width_us=200)
        assert rig.board.safe_off() == ()

    def test_a_latch_that_does_not_follow_is_no_danger_to_blanked_outputs(
        self, boards: Boards
    ) -> None:
        rig = boards()
        half_way(rig)
        rig.fake.world.put_in(LatchIgnored())
        assert rig.board.safe_off() == ()
        assert set(rig.sides) == {Side.GROUND}


class TestBlankNow:
    @pytest.mark.parametrize("name", [REFERENCE, KIT])
    def test_in_the_middle_of_a_stalled_message_it_grounds_all_at_once(
        self, boards: Boards, name: str
    ) -> None:
        rig = boards(name)
        rig.fake.world.put_in(SpiStall(stall_us=5_000, at_transfer=2))
        selection = half_way(rig)
        seen: list[tuple[int, set[Side]]] = []
        at_ns = rig.clock.now_ns() + 1_000_000

        def stop() -> None:
            rig.board.blank_now()
            seen.append((rig.fake.dac_code, set(rig.fake.sides)))

        rig.clock.at(at_ns, stop)
        result = fire_phase(rig.board, rig.board.pulse(1_000, 100), selection, True, 1_000, 100)
        assert seen == [(409, {Side.GROUND})]
        assert result.ended_ns > at_ns + 3_000_000
        assert rig.times("BL", 0)[-1] - at_ns < 5_000
        assert rig.fake.dac_code == 0

    def test_the_body_gets_nothing_more_from_then_on(self, boards: Boards) -> None:
        charges_ua_ns = []
        for stops in (False, True):
            rig = boards()
            rig.fake.world.put_in(SpiStall(stall_us=5_000, at_transfer=2))
            selection = half_way(rig)
            if stops:
                rig.clock.at(rig.clock.now_ns() + 1_000_000, rig.board.blank_now)
            fire_phase(rig.board, rig.board.pulse(1_000, 100), selection, True, 1_000, 100)
            body = rig.body()[-1]
            charges_ua_ns.append(body["current_ua"] * (body["to_ns"] - body["from_ns"]))
        stalled, stopped = charges_ua_ns
        assert 0 < stopped < stalled / 3

    def test_relays_cannot_open_at_once_so_the_supply_goes(self, boards: Boards) -> None:
        rig = boards(RELAYS)
        selection = half_way(rig)
        rig.fake.world.put_in(SpiStall(stall_us=5_000, at_transfer=2))
        before = len(rig.records())
        rig.clock.at(rig.clock.now_ns() + 1_000_000, rig.board.blank_now)
        fire_phase(rig.board, rig.board.pulse(1_000, 100), selection, True, 1_000, 100)
        assert "HV=0" in rig.story(before)

    def test_it_is_one_call_and_raises_what_fails(self, boards: Boards) -> None:
        rig = boards(REFERENCE)
        before = rig.gpio.calls
        rig.board.blank_now()
        assert rig.gpio.calls == before + 1
        rig.gpio.fails = frozenset({before + 1})
        with pytest.raises(BusError):
            rig.board.blank_now()
