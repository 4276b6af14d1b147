"""The last guard: every rule for messages refuses, and its near miss passes.

On the machine file of the Pi 4 the guard reckons 26 us a word and 1.2 us on top of a delay at
worst, 12 us a word at best; 1000 uA of 10 mA is code 409, which makes 998.8 uA.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_rig import ZERO_WORD, BoardRig, board_rig, changed, pulse_words
from etd_hal.errors import BusError, GuardRefusal
from etd_hal.ports import Message, Transfer
from etd_hal.watch import Approval
from stepped_board import shipped_board

Boards = Callable[..., BoardRig]

ON = bytes.fromhex("0664")
ALL = (1 << 64) - 1
ZERO = Transfer(ZERO_WORD)


def silent(*transfers: Transfer) -> Message:
    return Message((*transfers, ZERO))


def approval(output: int = 0, current_ua: int = 10_000, width_us: int = 200) -> Approval:
    return Approval(1 << output, ALL & ~(1 << output), current_ua, width_us)


def connected(rig: BoardRig, output: int = 0, is_anodic: bool = True) -> BoardRig:
    """Output 0 on the source against all others, with nothing approved yet."""
    selection = rig.board.selection(output, None)
    rig.board.prepare(selection)
    rig.board.connect(selection, is_anodic)
    return rig


def send(rig: BoardRig, message: Message, approved: Approval | None = None) -> None:
    if approved is not None:
        rig.board.guard.approve(approved)
    rig.board.guard.spi.transfer(message)


def assert_refused(
    rig: BoardRig, rule: str, message: Message, approved: Approval | None = None
) -> GuardRefusal:
    """It is refused by this rule, and nothing crosses the wire."""
    before = len(rig.records())
    with pytest.raises(GuardRefusal) as caught:
        send(rig, message, approved)
    assert caught.value.rule == rule
    assert rig.since(before) == []
    return caught.value


class TestForm:
    """What holds for every message, silent ones included."""

    @pytest.mark.parametrize("sent", ["00", "000000", "00000000"])
    def test_a_word_is_two_bytes(self, boards: Boards, sent: str) -> None:
        assert_refused(boards(), "word", silent(Transfer(bytes.fromhex(sent), cs_change=True)))

    @pytest.mark.parametrize(("sent", "bits"), [("4000", "01"), ("8000", "10"), ("c000", "11")])
    def test_control_bits_other_than_load_and_update_are_refused(
        self, boards: Boards, sent: str, bits: str
    ) -> None:
        word = Transfer(bytes.fromhex(sent), cs_change=True)
        assert assert_refused(boards(), "DAC command", silent(word)).value == bits

    @pytest.mark.parametrize("sent", ["0001", "0002", "0003"])
    def test_the_unused_bits_are_zero(self, boards: Boards, sent: str) -> None:
        assert_refused(boards(), "DAC word", silent(Transfer(bytes.fromhex(sent), cs_change=True)))

    def test_thirty_two_words_pass_and_one_more_does_not(self, boards: Boards) -> None:
        rig, word = boards(), Transfer(ZERO_WORD, cs_change=True)
        send(rig, silent(*[word] * 31))
        assert assert_refused(rig, "words", silent(*[word] * 32)).value == "33"

    def test_a_message_without_any_word_is_refused(self, boards: Boards) -> None:
        assert_refused(boards(), "words", Message((Transfer(delay_us=10),)))

    def test_511_transfers_pass_and_one_more_does_not(self, boards: Boards) -> None:
        rig = boards()
        send(rig, silent(*[Transfer()] * 510))
        assert assert_refused(rig, "transfers", silent(*[Transfer()] * 511)).value == "512"

    def test_a_message_of_nothing_is_refused(self, boards: Boards) -> None:
        assert_refused(boards(), "transfers", Message(()))

    def test_a_delay_of_ten_passes_and_one_that_would_be_slept_does_not(
        self, boards: Boards
    ) -> None:
        rig = boards()
        send(rig, silent(Transfer(delay_us=10)))
        assert_refused(rig, "delay", silent(Transfer(delay_us=11)))
        assert_refused(rig, "delay", silent(Transfer(ZERO_WORD, delay_us=11, cs_change=True)))
        assert_refused(rig, "delay", silent(Transfer(delay_us=-1)))

    def test_chip_select_is_released_at_the_end(self, boards: Boards) -> None:
        assert_refused(boards(), "chip select", Message((Transfer(ZERO_WORD, cs_change=True),)))

    @pytest.mark.parametrize("after", [(), (Transfer(delay_us=5),)])
    def test_a_message_ends_in_zero(self, boards: Boards, after: tuple[Transfer, ...]) -> None:
        rig = connected(boards())
        message = Message((ZERO, Transfer(ON), *after))
        assert_refused(rig, "end of message", message, approval())

    @pytest.mark.parametrize(
        "words",
        [
            ("0664", "0660", "0000"),
            ("0660", "0664", "0000"),
            ("0000", "0664", "0000"),
            ("0664", "0000", "0664", "0000"),
        ],
    )
    def test_there_is_one_level_and_it_only_falls(
        self, boards: Boards, words: tuple[str, ...]
    ) -> None:
        rig = connected(boards())
        *first, last = (bytes.fromhex(word) for word in words)
        message = Message((*(Transfer(word, cs_change=True) for word in first), Transfer(last)))
        assert_refused(rig, "levels", message, approval())

    def test_the_same_level_twice_is_one_level(self, boards: Boards) -> None:
        rig = connected(boards())
        on = Transfer(ON, cs_change=True)
        send(rig, Message((on, on, ZERO)), approval())
        assert len(rig.body()) == 1

    @pytest.mark.parametrize("permitted_ua", [0, 300])
    def test_silence_needs_neither_state_nor_approval(
        self, boards: Boards, permitted_ua: int
    ) -> None:
        rig = boards(begun=False)
        rig.board.guard.permit(permitted_ua)
        send(rig, silent(Transfer(ZERO_WORD, cs_change=True)))


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

    def test_a_third_phase_is_a_pulse_of_its_own(self, boards: Boards) -> None:
        rig = self.rig(boards)
        rig.visit(3, True, False, True)
        rig.visit(3, True, False, True)
        rig.visit(3, True, False)
        with pytest.raises(GuardRefusal, match="rate"):
            rig.visit(3)

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


@given(
    st.lists(
        st.builds(
            Transfer,
            tx=st.one_of(
                st.just(b""),
                st.sampled_from((0, 0, 409, 409, 819, 820, 4095)).map(
                    lambda code: (code << 2).to_bytes(2, "big")
                ),
                st.binary(min_size=1, max_size=3),
            ),
            delay_us=st.integers(-1, 12),
            cs_change=st.booleans(),
        ),
        max_size=6,
    )
)
def test_whatever_the_bytes_what_passes_keeps_to_the_approval(transfers: list[Transfer]) -> None:
    rig = board_rig()
    rig.begin()
    connected(rig)
    approved = approval(current_ua=2_000, width_us=100)
    try:
        send(rig, Message(tuple(transfers)), approved)
    except GuardRefusal:
        assert rig.fake.dac_code == 0
        return
    except BusError as error:
        pytest.fail(f"the guard let an invalid message through: {error}")
    assert rig.fake.dac_code == 0
    assert rig.fake.violations == []
    for body in rig.body():
        assert body["asked_ua"] <= 2_000
        # Six words may each take 4 us more than at best, and six delays 0.3 us.
        assert body["to_ns"] - body["from_ns"] <= 101_000 + 6 * 4_300


def test_a_refusal_tells_the_rule_the_value_and_what_is_allowed(boards: Boards) -> None:
    rig = boards()
    refused = assert_refused(rig, "delay", silent(Transfer(delay_us=11)))
    assert re.fullmatch(r"guard refused \(delay\): 11 us, allowed is 10 us", str(refused))
