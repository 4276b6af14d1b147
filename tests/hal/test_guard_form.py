"""The last guard: the form of every message, silent ones included."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_rig import ZERO_WORD, BoardRig, board_rig
from etd_hal.errors import BusError, GuardRefusal
from etd_hal.ports import Message, Transfer
from guard_bench import ON, ZERO, approval, assert_refused, connected, send, silent

pytestmark = pytest.mark.slow

Boards = Callable[..., BoardRig]


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

    @pytest.mark.parametrize("between", [(), (Transfer(delay_us=5),)])
    def test_two_words_under_one_chip_select_are_refused(
        self, boards: Boards, between: tuple[Transfer, ...]
    ) -> None:
        refused = assert_refused(boards(), "chip select", Message((ZERO, *between, ZERO)))
        assert refused.allowed == "one word each"

    def test_chip_select_does_not_change_after_a_delay(self, boards: Boards) -> None:
        """Each change holds the level for 10 us more, which no delay tells."""
        rig = connected(boards())
        on = Transfer(ON, cs_change=True)
        gap = Transfer(cs_change=True)
        assert_refused(rig, "chip select", silent(on, gap), approval())

    @pytest.mark.parametrize("after", [(), (Transfer(delay_us=5),)])
    def test_a_message_ends_in_zero(self, boards: Boards, after: tuple[Transfer, ...]) -> None:
        rig = connected(boards())
        message = Message((Transfer(ZERO_WORD, cs_change=True), Transfer(ON), *after))
        assert_refused(rig, "end of message", message, approval())

    @pytest.mark.parametrize(
        "words",
        [
            ("0664", "0660", "0000"),
            ("0000", "0664", "0000"),
            ("0664", "0000", "0664", "0000"),
            ("0660", "0664", "0660", "0000"),
            ("0664", "0660", "0664", "0000"),
            ("0660", "0664", "0668", "0000"),
            ("0660", "0000", "0664", "0000"),
        ],
    )
    def test_there_is_one_step_upward_at_most_and_then_zero(
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
    assert len(rig.body()) <= 1
