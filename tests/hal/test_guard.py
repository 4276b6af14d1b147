"""The last guard: state, width, charge, approval, switch; each near miss passes."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from board_rig import BoardRig, changed, pulse_words
from etd_hal.ports import Transfer
from etd_hal.switch_shadow import Approval
from guard_bench import ALL, ON, approval, assert_refused, connected, send, silent
from stepped_board import shipped_board

Boards = Callable[..., BoardRig]


class TestState:
    def test_before_any_permit_nothing_may_fire(self, boards: Boards) -> None:
        rig = boards(begun=False)
        assert rig.board.safe_off() == ()
        assert_refused(connected(rig), "state", pulse_words(1), approval())

    def test_up_to_what_the_state_permits(self, boards: Boards) -> None:
        rig = connected(boards())
        rig.board.guard.permit(300)
        send(rig, pulse_words(122), approval())
        refused = assert_refused(rig, "state", pulse_words(123), approval())
        assert refused.allowed == "300 uA now"

    def test_a_permit_cannot_go_above_the_maximum_of_the_board(self, boards: Boards) -> None:
        board = changed(shipped_board("kajimoto-hv507"), "maxima", current_ua=2_000)
        rig = connected(boards(board=board))
        rig.board.guard.permit(10_000)
        send(rig, pulse_words(819), approval())
        assert_refused(rig, "state", pulse_words(820), approval())

    def test_a_change_of_state_withdraws_the_approval(self, boards: Boards) -> None:
        rig = connected(boards())
        rig.board.guard.approve(approval())
        rig.board.guard.permit(10_000)
        assert_refused(rig, "approval", pulse_words(409))

    def test_full_scale_counts_as_the_board_file_says(self, boards: Boards) -> None:
        rig = connected(boards("etactilekit-hv513"))
        others = (1 << 32) - 2
        send(rig, pulse_words(998), Approval(1, others, 10_000, 200))
        assert_refused(rig, "state", pulse_words(999), Approval(1, others, 10_000, 200))


class TestAgain:
    """A message that was let through is judged anew wherever something else is asked of it."""

    def test_under_another_permission(self, boards: Boards) -> None:
        rig, message, approved = connected(boards()), pulse_words(409), approval()
        for _ in range(2):
            rig.board.guard.permit(5_000)
            send(rig, message, approved)
        rig.board.guard.permit(300)
        assert_refused(rig, "state", message, approved)

    def test_with_an_approval_of_less(self, boards: Boards) -> None:
        rig, message = connected(boards()), pulse_words(409)
        send(rig, message, approval())
        assert_refused(rig, "approval", message, approval(current_ua=300))

    def test_without_an_approval(self, boards: Boards) -> None:
        rig, message, approved = connected(boards()), pulse_words(409), approval()
        send(rig, message, approved)
        assert_refused(rig, "approval", message)

    def test_of_other_outputs_with_the_same_approval(self, boards: Boards) -> None:
        rig, message, approved = connected(boards()), pulse_words(409), approval()
        send(rig, message, approved)
        rig.board.discharge()
        assert_refused(connected(rig, output=3), "switch", message, approved)


class TestWidthAndCharge:
    def test_the_worst_case_stays_within_the_maximum_and_a_fifth(self, boards: Boards) -> None:
        """200 us: 26 + 19 x 11.2 = 238.8 us passes, 26 + 20 x 1.2 + 192 = 242 us does not."""
        rig = connected(boards())
        send(rig, pulse_words(409, *[10] * 19), approval(width_us=250))
        refused = assert_refused(rig, "width", pulse_words(409, *[10] * 19, 2), approval())
        assert (refused.value, refused.allowed) == ("242 us", "200 us")

    def test_each_word_at_the_level_counts_at_its_worst(self, boards: Boards) -> None:
        """Nine words are 234 us at worst, ten are 260 us."""
        rig, on = connected(boards()), Transfer(ON, cs_change=True)
        send(rig, silent(*[on] * 9), approval())
        assert_refused(rig, "width", silent(*[on] * 10), approval())

    def test_a_delay_on_the_word_itself_counts(self, boards: Boards) -> None:
        rig = connected(boards())
        held = Transfer(ON, delay_us=10, cs_change=True)
        assert_refused(rig, "width", silent(*[held] * 7), approval())

    @pytest.mark.parametrize("width_us", range(20, 201, 6))
    def test_no_width_that_the_maximum_allows_is_refused_on_the_modelled_machine(
        self, boards: Boards, width_us: int
    ) -> None:
        rig = boards()
        rig.visit(1, True, False, current_ua=10_000, width_us=width_us)
        assert len(rig.body()) == 2

    def test_the_charge_stays_within_the_maximum_and_a_fifth(self, boards: Boards) -> None:
        """998.8 uA: 115.6 us make 115 nC of at most 120, 121.8 us make 122."""
        board = changed(shipped_board("kajimoto-hv507"), "maxima", charge_nc=100)
        rig = connected(boards(board=board))
        send(rig, pulse_words(409, *[10] * 8), approval())
        refused = assert_refused(rig, "charge", pulse_words(409, *[10] * 8, 5), approval())
        assert (refused.value, refused.allowed) == ("122 nC", "100 nC")


class TestApproval:
    def test_without_one_nothing_fires(self, boards: Boards) -> None:
        assert_refused(connected(boards()), "approval", pulse_words(1))

    def test_it_passes_one_pulse_and_not_the_next(self, boards: Boards) -> None:
        rig = connected(boards())
        send(rig, pulse_words(409), approval())
        assert_refused(rig, "approval", pulse_words(409))

    def test_silence_in_between_does_not_use_it_up(self, boards: Boards) -> None:
        rig = connected(boards())
        rig.board.guard.approve(approval())
        send(rig, silent())
        send(rig, pulse_words(409))
        assert len(rig.body()) == 1

    def test_not_for_more_current_than_it_says(self, boards: Boards) -> None:
        rig = connected(boards())
        assert_refused(rig, "approval", pulse_words(409), approval(current_ua=998))
        send(rig, pulse_words(409), approval(current_ua=999))

    def test_not_for_what_is_surely_wider_than_it_says(self, boards: Boards) -> None:
        """12 + 50 us at best, one of tolerance for rounding."""
        rig = connected(boards())
        assert_refused(rig, "approval", pulse_words(409, *[10] * 5), approval(width_us=60))
        send(rig, pulse_words(409, *[10] * 5), approval(width_us=61))

    @pytest.mark.parametrize("output", [1, 63])
    def test_not_for_another_output(self, boards: Boards, output: int) -> None:
        rig = connected(boards())
        assert_refused(rig, "switch", pulse_words(409), approval(output))

    def test_not_for_the_other_polarity(self, boards: Boards) -> None:
        rig = connected(boards(), is_anodic=False)
        assert_refused(rig, "switch", pulse_words(409), approval())
        cathodic = Approval(ALL & ~1, 1, 10_000, 200)
        send(rig, pulse_words(409), cathodic)

    def test_not_when_the_picture_of_the_switch_was_lost(self, boards: Boards) -> None:
        rig = connected(boards())
        rig.board.guard.approve(approval())
        rig.board.guard.reset(())
        assert_refused(rig, "approval", pulse_words(409))

    def test_not_after_the_safe_state(self, boards: Boards) -> None:
        rig = connected(boards())
        rig.board.guard.approve(approval())
        assert rig.board.safe_off() == ()
        rig.board.guard.permit(10_000)
        assert_refused(rig, "approval", pulse_words(409))


class TestSwitch:
    def test_blanked_outputs_get_no_pulse(self, boards: Boards) -> None:
        rig = boards()
        rig.board.prepare(rig.board.selection(0, None))
        assert "blanked" in assert_refused(rig, "switch", pulse_words(409), approval()).value

    def test_discharged_outputs_get_no_pulse(self, boards: Boards) -> None:
        rig = connected(boards())
        rig.board.discharge()
        assert_refused(rig, "switch", pulse_words(409), approval())

    def test_an_open_latch_gets_no_pulse(self, boards: Boards) -> None:
        rig = boards()
        rig.board.prepare(rig.board.selection(0, None))
        rig.board.guard.gpio.set(((rig.file.used_lines()["BL"], 1),))
        assert "latch is open" in assert_refused(rig, "switch", pulse_words(1), approval()).value


def test_a_refusal_tells_the_rule_the_value_and_what_is_allowed(boards: Boards) -> None:
    rig = boards()
    refused = assert_refused(rig, "delay", silent(Transfer(delay_us=11)))
    assert re.fullmatch(r"guard refused \(delay\): 11 us, allowed is 10 us", str(refused))
