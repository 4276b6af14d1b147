"""A prepulse and its pulse in one message: what is on the wires, and what the guard makes of it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from board_rig import BoardRig, board_rig, changed
from etd_hal.errors import BoardFault, GuardRefusal
from etd_hal.ports import Message, Transfer
from etd_hal.switch_shadow import Prepulse
from etd_hal.timing import Timing
from guard_bench import ZERO, approval, assert_refused, connected, send
from stepped_board import shipped_board
from trace_decoder import Phase, decode, pulses, visits

pytestmark = pytest.mark.slow

Boards = Callable[..., BoardRig]
#: 500 and 1000 uA of 10 mA.
HALF, WHOLE = 204, 409


def words(*parts: int | None) -> Message:
    """A DAC code for each number, 10 us of delay for each None, then zero."""
    return Message((*(_part(ohm) for ohm in parts), ZERO))


def _part(code: int | None) -> Transfer:
    if code is None:
        return Transfer(delay_us=10)
    return Transfer((code << 2).to_bytes(2, "big"), cs_change=True)


class TestWire:
    @pytest.mark.parametrize("is_anodic", [True, False])
    def test_the_trace_shows_prepulse_and_pulse_without_a_gap(
        self, boards: Boards, is_anodic: bool
    ) -> None:
        rig = boards()
        rig.visit(5, is_anodic, prepulse=Prepulse(500, 60))
        (pulse,) = pulses(decode(rig.stepped.trace_lines()))
        assert [phase.electrode for phase in pulse] == [5, 5]
        assert [phase.is_anodic for phase in pulse] == [is_anodic] * 2
        assert [phase.code for phase in pulse] == [HALF, WHOLE]
        assert pulse[0].to_ns == pulse[1].from_ns
        assert 59 < pulse[0].width_us <= 60
        assert 99 < pulse[1].width_us <= 100

    def test_it_is_one_message(self, boards: Boards) -> None:
        rig = boards()
        before = len(rig.records())
        rig.visit(5, prepulse=Prepulse(500, 60))
        assert [entry.get("event") for entry in rig.since(before)].count("message") == 1

    def test_the_body_has_a_record_of_each_step(self, boards: Boards) -> None:
        rig = boards()
        rig.visit(5, False, prepulse=Prepulse(500, 60))
        first, second = rig.body()
        assert [entry["asked_ua"] for entry in (first, second)] == [-498, -999]
        assert first["to_ns"] == second["from_ns"]

    def test_both_phases_of_a_biphasic_pulse_have_one(self, boards: Boards) -> None:
        rig = boards()
        rig.visit(5, True, False, prepulse=Prepulse(500, 60))
        (visit,) = visits(decode(rig.stepped.trace_lines()))
        assert [(phase.code, phase.is_anodic) for phase in visit] == [
            (HALF, True),
            (WHOLE, True),
            (HALF, False),
            (WHOLE, False),
        ]

    def test_what_it_takes_is_planned(self, boards: Boards) -> None:
        assert abs(boards().visit(5, prepulse=Prepulse(500, 60)).excess_ns) <= 2

    def test_the_voltage_that_comes_back_is_that_of_the_pulse(self, boards: Boards) -> None:
        rig = boards()
        rig.fake.world.lift(5)
        open_v = 998.8e-6 * 66_000
        assert rig.visit(5, prepulse=Prepulse(500, 60)).voltage_v == pytest.approx(open_v, abs=0.1)


class TestBoard:
    @pytest.mark.parametrize("prepulse", [Prepulse(2, 60), Prepulse(1_000, 60), Prepulse(999, 60)])
    def test_what_is_no_step_of_the_dac_is_no_prepulse(
        self, boards: Boards, prepulse: Prepulse
    ) -> None:
        board = boards().board
        alone, pulse = board.pulse(1_000, 100), board.pulse(1_000, 100, prepulse)
        assert pulse.message.transfers == alone.message.transfers
        assert (pulse.prepulse_ua, pulse.planned_ns) == (0, alone.planned_ns)

    def test_its_code_is_the_largest_not_above_its_current(self, boards: Boards) -> None:
        assert boards().board.pulse(1_000, 100, Prepulse(500, 60)).prepulse_ua == 498

    def test_a_prepulse_shorter_than_a_word_is_a_fault(self, boards: Boards) -> None:
        with pytest.raises(BoardFault, match="shortest pulse"):
            boards().board.pulse(1_000, 100, Prepulse(500, 10))

    @pytest.mark.parametrize("prepulse_us", [20, 60, 100, 150])
    def test_no_width_up_to_the_widest_is_refused(self, boards: Boards, prepulse_us: int) -> None:
        """One word more at its worst: a little less than without."""
        rig = boards()
        widest_us = rig.board.widest_us(prepulse_us)
        assert 180 < widest_us < rig.board.widest_us() == 200
        for width_us in range(20, widest_us - prepulse_us + 1, 5):
            rig.visit(1, width_us=width_us, prepulse=Prepulse(500, prepulse_us))
        too_wide = {"width_us": widest_us - prepulse_us + 1, "prepulse": Prepulse(500, prepulse_us)}
        with pytest.raises(GuardRefusal, match="width"):
            rig.visit(1, **too_wide)  # type: ignore[arg-type]


@given(
    st.builds(
        Timing,
        word_us=st.floats(8.0, 20.0),
        delay_extra_us=st.floats(0.0, 6.0),
        message_us=st.floats(1.0, 2_000.0),
        spread_us=st.just(0.0),
    ),
    st.integers(20, 150),
    st.integers(20, 200),
)
def test_neither_step_is_ever_wider_than_asked(
    timing: Timing, prepulse_us: int, width_us: int
) -> None:
    shape = timing.two_steps(prepulse_us, width_us)
    assert shape.prepulse_us <= prepulse_us + 1e-9
    assert shape.width_us <= width_us + 1e-9
    parts_us = shape.prepulse_us + shape.width_us
    assert shape.duration_us == pytest.approx(parts_us + timing.message_us)


class TestGuard:
    def test_it_needs_an_approval_of_its_own(self, boards: Boards) -> None:
        rig = connected(boards())
        refused = assert_refused(rig, "approval", words(HALF, None, WHOLE), approval())
        assert refused.allowed == "a pulse of one level"
        send(rig, words(HALF, None, WHOLE), approval(prepulse=Prepulse(500, 30)))

    def test_not_for_more_current_than_that_says(self, boards: Boards) -> None:
        rig = connected(boards())
        message = words(HALF, None, WHOLE)
        assert_refused(rig, "approval", message, approval(prepulse=Prepulse(498, 30)))
        send(rig, message, approval(prepulse=Prepulse(499, 30)))

    def test_not_for_what_is_surely_wider_than_that_says(self, boards: Boards) -> None:
        """12 + 30 us at best, one of tolerance for rounding."""
        rig = connected(boards())
        message = words(HALF, None, None, None, WHOLE)
        assert_refused(rig, "approval", message, approval(prepulse=Prepulse(500, 40)))
        send(rig, message, approval(prepulse=Prepulse(500, 41)))

    def test_the_pulse_after_it_keeps_to_its_own_width(self, boards: Boards) -> None:
        """What the prepulse leaves of its width is not the pulse's."""
        rig = connected(boards())
        message = words(HALF, WHOLE, *[None] * 5)
        wide = Prepulse(500, 100)
        assert_refused(rig, "approval", message, approval(width_us=60, prepulse=wide))
        send(rig, message, approval(width_us=61, prepulse=wide))

    def test_an_approved_prepulse_is_no_room_for_a_stronger_first_step(
        self, boards: Boards
    ) -> None:
        rig = connected(boards())
        approved = approval(current_ua=1_000, prepulse=Prepulse(1_000, 30))
        assert_refused(rig, "approval", words(WHOLE, None, 2 * WHOLE), approved)

    def test_a_pulse_of_one_level_may_follow_the_approval_of_two(self, boards: Boards) -> None:
        rig = connected(boards())
        send(rig, words(WHOLE, None), approval(prepulse=Prepulse(500, 30)))

    def test_both_together_stay_within_the_width(self, boards: Boards) -> None:
        """52 us for two words, 11.2 for each delay: 16 of them are 231 us, 17 are 242."""
        rig, approved = connected(boards()), approval(prepulse=Prepulse(500, 200))
        send(rig, words(HALF, *[None] * 8, WHOLE, *[None] * 8), approved)
        message = words(HALF, *[None] * 9, WHOLE, *[None] * 8)
        assert assert_refused(rig, "width", message, approved).value == "242 us"

    def test_both_together_stay_within_the_charge(self, boards: Boards) -> None:
        """498 uA for 70.8 us and 999 uA for 82 make 117 nC of at most 120; 5.6 more with another
        delay before.
        """
        board = changed(shipped_board("kajimoto-hv507"), "maxima", charge_nc=100)
        rig, approved = connected(boards(board=board)), approval(prepulse=Prepulse(500, 100))
        send(rig, words(HALF, *[None] * 4, WHOLE, *[None] * 5), approved)
        message = words(HALF, *[None] * 5, WHOLE, *[None] * 5)
        assert assert_refused(rig, "charge", message, approved).value == "123 nC"

    def test_a_delay_while_the_last_word_waits_holds_the_pulse(self, boards: Boards) -> None:
        """Chip select has not risen: the DAC still has the level before."""
        rig = connected(boards())
        waiting = Message((*words(WHOLE).transfers, *[Transfer(delay_us=10)] * 20))
        assert_refused(rig, "width", waiting, approval())


def sent_steps(
    steps: list[tuple[int, int]], current_ua: int, width_us: int, prepulse: Prepulse
) -> list[Phase] | None:
    """(code, delays) of each step; what flowed, or None when it was refused and nothing did."""
    rig = board_rig()
    rig.begin()
    connected(rig)
    approved = approval(current_ua=current_ua, width_us=width_us, prepulse=prepulse)
    parts = [part for code, delays in steps for part in (code, *[None] * delays)]
    try:
        send(rig, words(*parts), approved)
    except GuardRefusal:
        assert rig.body() == []
        return None
    return decode(rig.stepped.trace_lines())


@given(
    st.lists(st.tuples(st.sampled_from((0, HALF, WHOLE, 2 * WHOLE)), st.integers(0, 2)), max_size=4)
)
@example([(HALF, 0), (WHOLE, 0), (2 * WHOLE, 0)])
@example([(WHOLE, 0), (HALF, 0)])
@example([(HALF, 0), (WHOLE, 0), (HALF, 0)])
def test_one_level_or_one_step_upward_passes_and_nothing_else(steps: list[tuple[int, int]]) -> None:
    found = sent_steps(steps, 10_000, 200, Prepulse(10_000, 200))
    levels = [code for code, _ in groupby(steps, key=lambda step: step[0])]
    if levels and not levels[-1]:
        levels.pop()
    if len(levels) <= 2 and levels == sorted({*levels} - {0}):
        assert found is not None
        assert [phase.code for phase in found] == levels
    else:
        assert found is None


@given(
    st.integers(0, 4),
    st.integers(0, 4),
    st.sampled_from((400, 900, 1_000, 2_500)),
    st.integers(20, 70),
    st.sampled_from((0, 400, 500, 2_500)),
    st.integers(0, 70),
)
def test_what_passes_has_no_more_charge_in_either_step_than_was_approved(
    first: int, second: int, current_ua: int, width_us: int, before_ua: int, before_us: int
) -> None:
    prepulse = Prepulse(before_ua, before_us)
    found = sent_steps([(HALF, first), (WHOLE, second)], current_ua, width_us, prepulse)
    if found is None:
        return
    before, pulse = found
    # A word may take 3 us more than at best, each delay 0.3 us; 1 us is for rounding.
    assert before.current_ua <= before_ua
    assert before.width_us <= before_us + 1 + 3 + 0.3 * first
    assert pulse.current_ua <= current_ua
    assert pulse.width_us <= width_us + 1 + 3 + 0.3 * second
