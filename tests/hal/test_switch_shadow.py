"""The guard's picture of the switch: every rule for lines refuses, and its near miss passes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from board_rig import BoardRig, changed, pulse_words
from etd_hal.boardfile import HvEnable
from etd_hal.errors import GuardRefusal
from etd_hal.switch_shadow import Approval
from guard_bench import refused
from stepped_board import shipped_board

Boards = Callable[..., BoardRig]

US = 1_000


def lines(rig: BoardRig, **levels: int) -> None:
    """Set lines by name in one call, through the guard."""
    of = rig.file.used_lines()
    rig.board.guard.gpio.set(tuple((of[name], value) for name, value in levels.items()))


def shift(rig: BoardRig, word: int, stages: int) -> None:
    for stage in range(stages - 1, -1, -1):
        lines(rig, DATA=word >> stage & 1, CLK=1)
        lines(rig, CLK=0)


def assert_refused(rig: BoardRig, rule: str, **levels: int) -> GuardRefusal:
    """The call is refused by this rule, and no line moves."""
    before = len(rig.records())
    with pytest.raises(GuardRefusal) as caught:
        lines(rig, **levels)
    assert caught.value.rule == rule
    assert rig.since(before) == []
    return caught.value


def fire(rig: BoardRig, source: int, ground: int) -> None:
    rig.board.guard.approve(Approval(source, ground, 1_000, 100))
    rig.board.guard.spi.transfer(pulse_words(100))


def assert_no_pulse(rig: BoardRig, rule: str, source: int, ground: int) -> GuardRefusal:
    before = len(rig.records())
    with pytest.raises(GuardRefusal) as caught:
        fire(rig, source, ground)
    assert caught.value.rule == rule
    assert rig.since(before) == []
    return caught.value


def probe_blanked(rig: BoardRig, source: int = 0, ground: int = 0) -> None:
    """A probe while the outputs are blanked, with these, or none, selected behind that."""
    rig.board.guard.approve(Approval(source, ground, 300, 50, is_blanked=True))
    rig.board.guard.spi.transfer(pulse_words(100))


def assert_no_probe(
    rig: BoardRig, source: int = 0, ground: int = 0, rule: str = "switch"
) -> GuardRefusal:
    with refused(rig, rule) as told:
        probe_blanked(rig, source, ground)
    return told.error


class TestBlanking:
    def test_inverting_blanked_outputs_lifts_them_all_and_is_refused(self, boards: Boards) -> None:
        refused = assert_refused(boards(), "blanking", POL=0)
        assert refused.value == "BL 0 with POL 0: all outputs high"

    def test_blanking_inverted_outputs_is_refused(self, boards: Boards) -> None:
        rig = boards()
        lines(rig, BL=1)
        lines(rig, POL=0)
        assert_refused(rig, "blanking", BL=0)

    def test_in_one_call_the_lower_line_moves_first(self, boards: Boards) -> None:
        """POL has the lower number: out of inverse polarity that is right, into it it is not."""
        rig = boards()
        assert_refused(rig, "blanking", BL=1, POL=0)
        lines(rig, BL=1)
        lines(rig, POL=0)
        lines(rig, BL=0, POL=1)
        assert rig.story()[-2:] == ["POL=1", "BL=0"]

    def test_while_the_supply_is_off_nothing_can_be_lifted(self, boards: Boards) -> None:
        rig = boards("reference-hv507", begun=False)
        lines(rig, POL=0)
        refused = assert_refused(rig, "blanking", HV=1)
        assert refused.allowed == "POL 1 first"

    def test_the_supply_may_come_on_with_all_outputs_on_ground(self, boards: Boards) -> None:
        rig = boards("reference-hv507", begun=False)
        lines(rig, HV=1)
        assert_refused(rig, "blanking", POL=0)

    def test_the_level_that_switches_the_supply_on_is_the_files(self, boards: Boards) -> None:
        shipped = shipped_board("reference-hv507")
        board = changed(shipped, "guards", hv_enable=HvEnable(line=25, on=0))
        rig = boards(board=board, begun=False)
        lines(rig, POL=0)
        assert_refused(rig, "blanking", HV=0)

    def test_after_a_refusal_the_lines_count_as_they_are(self, boards: Boards) -> None:
        rig = boards()
        assert_refused(rig, "blanking", POL=0)
        lines(rig, BL=1)
        lines(rig, BL=0)


class TestShifting:
    def test_a_clock_with_latch_open_and_outputs_live_is_refused(self, boards: Boards) -> None:
        rig = boards()
        lines(rig, LE=1)
        lines(rig, BL=1)
        assert_refused(rig, "shift", DATA=1, CLK=1)

    def test_a_clock_with_the_latch_closed_is_not(self, boards: Boards) -> None:
        rig = boards()
        lines(rig, BL=1)
        lines(rig, DATA=1, CLK=1)
        lines(rig, CLK=0)
        lines(rig, BL=0)

    def test_a_clock_with_the_outputs_blanked_is_not(self, boards: Boards) -> None:
        rig = boards()
        lines(rig, LE=1)
        lines(rig, DATA=1, CLK=1)

    def test_opening_the_latch_to_live_outputs_is_refused(self, boards: Boards) -> None:
        rig = boards()
        lines(rig, BL=1)
        assert_refused(rig, "latch", LE=1)

    def test_closing_it_while_they_are_live_is_not(self, boards: Boards) -> None:
        rig = boards()
        lines(rig, LE=1)
        lines(rig, BL=1)
        lines(rig, LE=0)


class TestHalfBridgeSelection:
    OTHERS = (1 << 64) - 2

    def select(self, rig: BoardRig, word: int, stages: int = 64) -> None:
        lines(rig, CLK=0)
        shift(rig, word, stages)
        lines(rig, LE=1)
        lines(rig, LE=0)
        lines(rig, BL=1)

    def test_one_output_against_all_others_may_fire(self, boards: Boards) -> None:
        rig = boards()
        self.select(rig, 1)
        fire(rig, 1, self.OTHERS)
        assert rig.body()[-1]["electrode"] == 0

    @pytest.mark.parametrize(("word", "count"), [(0b11, 2), (2**64 - 1, 64)])
    def test_several_may_not(self, boards: Boards, word: int, count: int) -> None:
        rig = boards()
        self.select(rig, word)
        refused = assert_no_pulse(rig, "switch", word, 2**64 - 1 - word)
        assert refused.value == f"{count} outputs selected"

    def test_a_register_one_clock_short_of_written_may_not(self, boards: Boards) -> None:
        rig = boards(begun=False)
        rig.board.guard.permit(10_000)
        self.select(rig, 0, stages=63)
        refused = assert_no_pulse(rig, "switch", 1, self.OTHERS)
        assert refused.value == "register not wholly written"
        lines(rig, BL=0)
        self.select(rig, 1, stages=1)
        fire(rig, 1, self.OTHERS)

    def test_after_the_safe_state_the_register_counts_as_unknown(self, boards: Boards) -> None:
        rig = boards()
        rig.board.guard.reset(((4, 1), (23, 0)))
        self.select(rig, 1, stages=63)
        assert_no_pulse(rig, "switch", 1, self.OTHERS)

    def test_what_was_latched_before_the_safe_state_does_not_count(self, boards: Boards) -> None:
        rig = boards()
        self.select(rig, 1)
        rig.board.guard.reset(((4, 1), (23, 0)))
        lines(rig, BL=1)
        refused = assert_no_pulse(rig, "switch", 1, self.OTHERS)
        assert refused.value == "register not wholly written"

    def test_all_others_are_approved_as_well(self, boards: Boards) -> None:
        rig = boards()
        self.select(rig, 1)
        assert_no_pulse(rig, "switch", 1, self.OTHERS - 2)

    def test_outputs_that_are_blanked_and_inverted_are_not_on_ground(self, boards: Boards) -> None:
        """Which only a supply that is off lets through."""
        rig = boards("reference-hv507", begun=False)
        rig.board.guard.permit(10_000)
        rig.board.isolate(whole=True)
        lines(rig, POL=0)
        refused = assert_no_probe(rig)
        assert refused.value == "not blanked to ground"
        lines(rig, POL=1)
        probe_blanked(rig)

    def test_behind_the_blanking_is_one_output_at_most(self, boards: Boards) -> None:
        rig = boards()
        self.select(rig, 0b11)
        lines(rig, BL=0)
        refused = assert_no_probe(rig, 0b11, 2**64 - 4)
        assert refused.value == "3 behind the blanking"

    def test_behind_the_blanking_an_unknown_register_is_none_that_is_empty(
        self, boards: Boards
    ) -> None:
        rig = boards()
        rig.board.isolate(whole=True)
        probe_blanked(rig)
        rig.board.guard.reset(((4, 1), (23, 0)))
        assert_no_probe(rig)

    def test_a_rise_that_was_perhaps_none_does_not_count(self, boards: Boards) -> None:
        rig = boards(begun=False)
        rig.board.guard.permit(10_000)
        shift(rig, 1, 64)
        lines(rig, LE=1)
        lines(rig, LE=0)
        lines(rig, BL=1)
        assert_no_pulse(rig, "switch", 1, self.OTHERS)

    def test_what_was_shifted_and_not_latched_does_not_count(self, boards: Boards) -> None:
        rig = boards()
        self.select(rig, 1)
        lines(rig, BL=0)
        shift(rig, 0b10, 64)
        lines(rig, BL=1)
        fire(rig, 1, self.OTHERS)
        assert_no_pulse(rig, "switch", 0b10, 2**64 - 3)

    def test_a_latch_that_stands_open_follows_the_register(self, boards: Boards) -> None:
        rig = boards()
        lines(rig, LE=1)
        shift(rig, 0b100, 64)
        lines(rig, LE=0)
        lines(rig, BL=1)
        fire(rig, 0b100, 2**64 - 5)
        assert rig.body()[-1]["electrode"] == 2

    def test_inverted_outputs_count_as_inverted(self, boards: Boards) -> None:
        rig = boards()
        self.select(rig, 1)
        lines(rig, POL=0)
        assert_no_pulse(rig, "switch", 1, self.OTHERS)
        fire(rig, self.OTHERS, 1)
        assert rig.body()[-1]["asked_ua"] < 0


class TestRelays:
    """Stage 2i of output i goes to the source, stage 2i + 1 to ground."""

    @pytest.fixture
    def rig(self, boards: Boards) -> BoardRig:
        rig = boards("feetthrough-relay")
        rig.clock.spend(1_000 * US)
        return rig

    def copy(self, rig: BoardRig, word: int) -> None:
        shift(rig, word, 64)
        lines(rig, LE=1)
        lines(rig, LE=0)

    def refuse_copy(self, rig: BoardRig, word: int) -> GuardRefusal:
        shift(rig, word, 64)
        return assert_refused(rig, "relays", LE=1)

    def test_one_against_its_returns_may_fire(self, rig: BoardRig) -> None:
        self.copy(rig, 0b10_10_01)
        rig.clock.spend(1_000 * US)
        fire(rig, 0b001, 0b110)
        assert rig.body()[-1]["electrode"] == 0

    @pytest.mark.parametrize("output", [0, 13, 31])
    def test_both_relays_of_one_output_are_refused(self, rig: BoardRig, output: int) -> None:
        refused = self.refuse_copy(rig, 0b11 << 2 * output)
        assert refused.value == "both relays of one electrode"

    def test_neighbouring_relays_of_two_outputs_are_not(self, rig: BoardRig) -> None:
        self.copy(rig, 0b01_10)

    def test_a_word_one_clock_short_of_shifted_is_refused(self, boards: Boards) -> None:
        rig = boards("feetthrough-relay", begun=False)
        lines(rig, CLK=0, LE=0)
        shift(rig, 0, 63)
        assert assert_refused(rig, "relays", LE=1).value == "a word not wholly shifted"
        lines(rig, LE=0)
        shift(rig, 0, 1)
        lines(rig, LE=1)

    def test_from_one_word_to_another_without_a_break_is_refused(self, rig: BoardRig) -> None:
        self.copy(rig, 0b10_01)
        rig.clock.spend(10_000 * US)
        assert self.refuse_copy(rig, 0b01_10).value == "made before broken"

    def test_closing_more_relays_without_a_break_is_refused(self, rig: BoardRig) -> None:
        self.copy(rig, 0b10_01)
        rig.clock.spend(10_000 * US)
        self.refuse_copy(rig, 0b10_10_01)

    def test_the_same_word_again_is_not(self, rig: BoardRig) -> None:
        self.copy(rig, 0b10_01)
        self.copy(rig, 0b10_01)

    def test_what_relays_closed_at_power_up_is_unknown_and_must_be_broken_first(
        self, boards: Boards
    ) -> None:
        rig = boards("feetthrough-relay", begun=False)
        rig.clock.spend(10_000 * US)
        lines(rig, CLK=0, LE=0)
        assert self.refuse_copy(rig, 0b10_01).value == "made before broken"

    def test_making_waits_for_the_slowest_relay_to_break(self, rig: BoardRig) -> None:
        self.copy(rig, 0)
        opened_ns = rig.times("LE", 1)[-1] - 3_000
        shift(rig, 0b10_01, 64)
        rig.clock.sleep_until_ns(opened_ns + 1_000 * US - 1)
        assert assert_refused(rig, "relays", LE=1).allowed == "1000 us or later"
        lines(rig, LE=0)
        rig.clock.sleep_until_ns(opened_ns + 1_000 * US)
        lines(rig, LE=1)

    def test_firing_waits_for_the_slowest_relay_to_make(self, rig: BoardRig) -> None:
        self.copy(rig, 0b10_01)
        closed_ns = rig.times("LE", 1)[-1] - 3_000
        rig.clock.sleep_until_ns(closed_ns + 1_000 * US - 1)
        assert assert_no_pulse(rig, "relays", 0b01, 0b10).value == "not settled"
        rig.clock.sleep_until_ns(closed_ns + 1_000 * US)
        fire(rig, 0b01, 0b10)

    def test_a_probe_of_nobody_waits_for_the_slowest_relay_to_break(self, rig: BoardRig) -> None:
        self.copy(rig, 0b10_01)
        rig.clock.spend(1_000 * US)
        assert_no_probe(rig, rule="relays")
        self.copy(rig, 0)
        opened_ns = rig.times("LE", 1)[-1] - 3_000
        rig.clock.sleep_until_ns(opened_ns + 1_000 * US - 1)
        assert_no_probe(rig, rule="relays")
        rig.clock.sleep_until_ns(opened_ns + 1_000 * US)
        probe_blanked(rig)

    def test_open_relays_get_no_pulse(self, rig: BoardRig) -> None:
        self.copy(rig, 0)
        rig.clock.spend(10_000 * US)
        assert_no_pulse(rig, "relays", 0, 0)

    @pytest.mark.parametrize(
        ("word", "source", "ground"),
        [(0b10_10_01_01, 0b0011, 0b1100), (0b01, 0b1, 0), (0b10, 0, 0b1)],
    )
    def test_a_pulse_needs_one_output_alone_and_one_on_the_other_side(
        self, rig: BoardRig, word: int, source: int, ground: int
    ) -> None:
        self.copy(rig, word)
        rig.clock.spend(1_000 * US)
        assert assert_no_pulse(rig, "relays", source, ground)

    @pytest.mark.parametrize(("source", "ground"), [(0b01, 0b110), (0b10, 0b01), (0b100, 0b10)])
    def test_a_pulse_needs_just_the_outputs_approved(
        self, rig: BoardRig, source: int, ground: int
    ) -> None:
        self.copy(rig, 0b10_01)
        rig.clock.spend(1_000 * US)
        assert "were approved" in assert_no_pulse(rig, "relays", source, ground).allowed
        fire(rig, 0b01, 0b10)

    def test_a_pulse_on_what_is_shifted_but_not_copied_is_refused(self, rig: BoardRig) -> None:
        shift(rig, 0b10_01, 64)
        rig.clock.spend(10_000 * US)
        assert_no_pulse(rig, "relays", 0b01, 0b10)

    def test_a_copy_that_was_perhaps_none_does_not_count(self, boards: Boards) -> None:
        rig = boards("feetthrough-relay", begun=False)
        rig.board.guard.permit(10_000)
        lines(rig, CLK=0)
        shift(rig, 0, 64)
        lines(rig, LE=1)
        lines(rig, LE=0)
        rig.clock.spend(10_000 * US)
        assert self.refuse_copy(rig, 0b10_01).value == "made before broken"
