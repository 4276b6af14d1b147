"""The last guard over time: the rate of each output, and what it remembers of messages."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from board_rig import BoardRig, changed, fire_phase, pulse_words
from etd_hal.errors import GuardRefusal
from etd_hal.ports import Transfer
from guard_bench import approval, assert_refused, connected, send, silent
from stepped_board import shipped_board

Boards = Callable[..., BoardRig]


class TestRate:
    def rig(self, boards: Boards, name: str = "kajimoto-hv507") -> BoardRig:
        return boards(board=changed(shipped_board(name), "maxima", rate_hz=5))

    def test_as_many_pulses_as_the_rate_in_any_second(self, boards: Boards) -> None:
        rig = self.rig(boards)
        begun_ns = [rig.visit(3).begun_ns for _ in range(5)]
        with pytest.raises(GuardRefusal, match="6 pulses in a second, allowed is 5"):
            rig.visit(3)
        assert rig.board.safe_off() == ()
        rig.board.guard.permit(10_000)
        rig.clock.sleep_until_ns(begun_ns[0] + 999_000_000)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3)
        assert rig.board.safe_off() == ()
        rig.board.guard.permit(10_000)
        rig.clock.sleep_until_ns(begun_ns[1] + 1_000_000_000)
        rig.visit(3)
        assert len(rig.body()) == 6

    def test_each_output_has_its_own_count(self, boards: Boards) -> None:
        rig = self.rig(boards)
        for output in (3, 4) * 5:
            rig.visit(output)
        assert len(rig.body()) == 10

    @pytest.mark.parametrize("phases", [(True, False), (False, True)])
    @pytest.mark.parametrize("name", ["kajimoto-hv507", "feetthrough-relay"])
    def test_the_two_phases_of_a_biphasic_pulse_are_one(
        self, boards: Boards, name: str, phases: tuple[bool, bool]
    ) -> None:
        rig = self.rig(boards, name)
        for _ in range(5):
            rig.visit(3, *phases)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3, *phases)
        assert len(rig.body()) == 10

    def test_two_phases_of_one_direction_are_two(self, boards: Boards) -> None:
        rig = self.rig(boards)
        for _ in range(2):
            rig.visit(3, True, True)
        rig.visit(3, True)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3, True)

    @pytest.mark.parametrize("third", [True, False])
    def test_a_third_phase_is_a_pulse_of_its_own(self, boards: Boards, third: bool) -> None:
        rig = self.rig(boards)
        rig.visit(3, True, False, third)
        rig.visit(4)
        rig.visit(3, True, False, third)
        rig.visit(4)
        rig.visit(3, True, False)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3)

    def test_the_reverse_of_a_phase_before_the_safe_state_is_a_pulse_of_its_own(
        self, boards: Boards
    ) -> None:
        rig = self.rig(boards)
        for is_anodic in (True, False, True, False, True):
            rig.visit(3, is_anodic)
            assert rig.board.safe_off() == ()
            rig.board.guard.permit(10_000)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3, False)

    def test_a_pulse_back_from_the_same_returns_to_another_output_is_that_outputs(
        self, boards: Boards
    ) -> None:
        rig = self.rig(boards, "feetthrough-relay")
        for round_of in range(6):
            rig.visit(10 + round_of, True, returns=(3, 4))
            if round_of < 5:
                rig.visit(5, False, returns=(3, 4))
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(5, False, returns=(3, 4))

    @pytest.mark.parametrize("name", ["kajimoto-hv507", "feetthrough-relay"])
    def test_visits_that_alternate_their_polarity_are_each_counted(
        self, boards: Boards, name: str
    ) -> None:
        """At the rate that is allowed they lie far apart; relays stay closed until the next."""
        rig = self.rig(boards, name)
        for number in range(5):
            rig.visit(3, number % 2 == 0)
            rig.clock.spend(20_000_000)
        with pytest.raises(GuardRefusal, match="6 pulses in a second"):
            rig.visit(3, False)
        assert len(rig.body()) == 5

    def test_half_bridges_that_were_blanked_in_between_have_no_second_phase(
        self, boards: Boards
    ) -> None:
        rig = self.rig(boards)
        for is_anodic in (True, False, True, False, True):
            rig.visit(3, is_anodic)
        with pytest.raises(GuardRefusal, match="6 pulses in a second"):
            rig.visit(3, False)

    @pytest.mark.parametrize("name", ["kajimoto-hv507", "feetthrough-relay"])
    @pytest.mark.parametrize(("waits_us", "counts"), [(900, 1), (4_000, 2)])
    def test_a_second_phase_that_is_late_is_a_pulse_of_its_own(
        self, boards: Boards, name: str, waits_us: int, counts: int
    ) -> None:
        rig = self.rig(boards, name)
        pulse, selection = rig.board.pulse(1_000, 100), rig.board.selection(3, None)
        rig.board.prepare(selection)
        rig.board.connect(selection, True)
        fire_phase(rig.board, pulse, selection, True, 1_000, 100)
        rig.board.flip(selection, False)
        rig.clock.spend(waits_us * 1_000)
        fire_phase(rig.board, pulse, selection, False, 1_000, 100)
        rig.board.discharge()
        # Through relays that stay closed the next one could be the reverse of that.
        rig.clock.spend(20_000_000)
        for _ in range(5 - counts):
            rig.visit(3)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3)

    @pytest.mark.parametrize("is_anodic", [True, False])
    def test_of_one_output_against_one_both_are_counted(
        self, boards: Boards, is_anodic: bool
    ) -> None:
        rig = self.rig(boards, "feetthrough-relay")
        for other in (4, 5, 6, 7):
            rig.visit(3, is_anodic, returns=(other,))
        rig.visit(8, is_anodic, returns=(3,))
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3, is_anodic, returns=(9,))

    def test_a_reverse_pulse_after_another_output_is_a_pulse_of_its_own(
        self, boards: Boards
    ) -> None:
        rig = self.rig(boards)
        for is_anodic in (True, False, True, False, True):
            rig.visit(3, is_anodic)
            rig.visit(rig.file.switch.outputs - len(rig.body()), True)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3, False)

    def test_the_visited_output_is_counted_and_not_its_returns(self, boards: Boards) -> None:
        rig = self.rig(boards)
        for output in range(20):
            rig.visit(output, False)
        assert len(rig.body()) == 20


class TestMemory:
    """A message is decoded once; the verdict on its bytes must be on its own bytes."""

    def test_messages_that_come_and_go_are_each_judged_by_their_own_bytes(
        self, boards: Boards
    ) -> None:
        rig = connected(boards())
        rig.board.guard.permit(1_000)
        rig.board.guard.approve(approval())
        for code in range(412, 1_600):
            rig.board.guard.check(silent())
            with pytest.raises(GuardRefusal, match="state"):
                rig.board.guard.check(pulse_words(code))

    def test_a_message_of_equal_form_but_other_code_gets_its_own_verdict(
        self, boards: Boards
    ) -> None:
        rig = connected(boards())
        weak, strong = pulse_words(100, 10), pulse_words(4_000, 10)
        send(rig, weak, approval(current_ua=300))
        assert_refused(rig, "approval", strong, approval(current_ua=300))

    def test_a_refused_message_is_refused_again(self, boards: Boards) -> None:
        rig = boards()
        message = silent(Transfer(b"\xc0\x00", cs_change=True))
        for _ in range(3):
            assert_refused(rig, "DAC command", message)

    def test_what_was_let_through_once_is_checked_against_the_state_each_time(
        self, boards: Boards
    ) -> None:
        rig, message = connected(boards()), pulse_words(409)
        send(rig, message, approval())
        rig.board.guard.permit(0)
        assert_refused(rig, "state", message, approval())

    def test_more_messages_than_are_remembered_are_still_judged(self, boards: Boards) -> None:
        rig = boards()
        kept = [silent(Transfer(delay_us=index % 11)) for index in range(1_100)]
        for message in kept:
            rig.board.guard.check(message)
        assert_refused(rig, "delay", silent(Transfer(delay_us=11)))
