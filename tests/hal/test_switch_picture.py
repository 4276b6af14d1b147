"""The guard's picture of the switch, by itself: what counts as a move, what is known after the safe
state, and the time of relays to the nanosecond.

Levels are handed over as the guard hands them over; there is no board.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from etd_hal.boardfile import HalfBridges, Relays
from etd_hal.errors import GuardRefusal
from etd_hal.ports import Changes
from etd_hal.switch_shadow import Approval, HalfBridgeShadow, Prepulse, RelayShadow, SwitchShadow
from hand_clock import HandClock
from stepped_board import shipped_board

#: The lines of both boards' switches.
POL, DATA, LE, BL, CLK = 4, 5, 22, 23, 24
HV = 25
#: What else is set through the guard.
SYNC = 12
ALL = (1 << 64) - 1
MS = 1_000_000


def bridges(hv_on: int | None = None) -> HalfBridgeShadow:
    """64 half-bridges; `hv_on`: the level at which their supply is on."""
    switch = shipped_board("kajimoto-hv507").switch
    assert isinstance(switch, HalfBridges)
    return HalfBridgeShadow(switch, None if hv_on is None else (HV, hv_on))


def relays(clock: HandClock) -> RelayShadow:
    """Two for each of 32 outputs, that take a millisecond to open or to close."""
    switch = shipped_board("feetthrough-relay").switch
    assert isinstance(switch, Relays)
    return RelayShadow(switch, clock)


def rises(line: int, times: int) -> Iterator[Changes]:
    for _ in range(times):
        yield ((line, 0),)
        yield ((line, 1),)


def follow(shadow: SwitchShadow, *calls: Changes) -> None:
    for changes in calls:
        shadow.follow(changes)


def shift(shadow: SwitchShadow, word: int) -> None:
    """64 stages, the highest first; CLK is left high."""
    for stage in range(63, -1, -1):
        follow(shadow, ((CLK, 0),), ((DATA, word >> stage & 1),), ((CLK, 1),))


def refused(shadow: SwitchShadow, approval: Approval) -> GuardRefusal:
    with pytest.raises(GuardRefusal) as caught:
        shadow.check_selection(approval)
    return caught.value


def blanked(source: int = 0) -> Approval:
    return Approval(source, 0, 300, 50, is_blanked=True)


@pytest.mark.parametrize(
    ("source", "is_blanked", "reaches_any"),
    [(0b01, False, True), (0b01, True, False), (0, False, False), (0, True, False)],
)
def test_an_approval_holds_what_the_limits_let_through_and_whether_it_reaches_anybody(
    source: int, is_blanked: bool, reaches_any: bool
) -> None:
    approval = Approval(source, 0b10, 1_000, 100, Prepulse(500, 60), is_blanked)
    assert (approval.source, approval.ground, approval.is_blanked) == (source, 0b10, is_blanked)
    assert approval.prepulse == (500, 60)
    assert approval.figures == (1_000, 100, (500, 60), reaches_any)


class TestMoves:
    def test_each_line_that_changes_is_one(self) -> None:
        shadow = bridges(hv_on=1)
        assert shadow.edge_count == shadow.switched == 0
        follow(shadow, ((BL, 1), (CLK, 0)), ((HV, 1), (POL, 0), (SYNC, 1)))
        assert shadow.edge_count == shadow.switched == 4

    @pytest.mark.parametrize("hv_on", [0, 1])
    def test_the_safe_levels_of_the_start_are_none(self, hv_on: int) -> None:
        shadow = bridges(hv_on)
        follow(shadow, ((POL, 1), (DATA, 0), (LE, 0), (BL, 0), (CLK, 1), (HV, 1 - hv_on)))
        assert shadow.edge_count == 0

    def test_what_was_refused_has_left_its_line_where_it_was(self) -> None:
        """Inverting blanked outputs, and the supply on with inverted ones."""
        shadow = bridges()
        with pytest.raises(GuardRefusal):
            shadow.follow(((POL, 0),))
        counted = shadow.edge_count
        shadow.follow(((POL, 1),))
        assert shadow.edge_count == counted
        shadow = bridges(hv_on=1)
        shadow.follow(((POL, 0),))
        for _ in range(2):
            with pytest.raises(GuardRefusal):
                shadow.follow(((HV, 1),))
        counted = shadow.edge_count
        shadow.follow(((HV, 0),))
        assert shadow.edge_count == counted

    def test_of_relays_their_three_lines_are_counted_and_each_copy_switches(self) -> None:
        shadow = relays(HandClock())
        assert (shadow.edge_count, shadow.switched) == (0, 0)
        follow(shadow, ((DATA, 0), (CLK, 1), (LE, 1)), ((HV, 1), (SYNC, 1)))
        assert (shadow.edge_count, shadow.switched) == (0, 0)
        follow(shadow, *rises(CLK, 64))
        assert (shadow.edge_count, shadow.switched) == (128, 0)
        follow(shadow, ((LE, 0),), ((LE, 1),))
        assert (shadow.edge_count, shadow.switched) == (130, 1)


class TestAfterTheSafeState:
    def test_levels_that_are_told_are_where_the_next_change_begins(self) -> None:
        """CLK low: the next level is a rise. Of 64 shifts it is the first."""
        shadow = bridges()
        shadow.reset(((CLK, 0), (DATA, 1), (SYNC, 1)))
        follow(shadow, ((CLK, 1),), *rises(CLK, 63), ((LE, 1),), ((LE, 0),), ((BL, 1),))
        assert refused(shadow, Approval(1, ALL - 1, 1_000, 100)).value == "64 outputs selected"

    def test_so_it_is_with_relays(self) -> None:
        clock = HandClock()
        shadow = relays(clock)
        shadow.reset(((CLK, 0), (DATA, 1), (SYNC, 1)))
        follow(shadow, ((CLK, 1),), *rises(CLK, 63), ((LE, 0),))
        with pytest.raises(GuardRefusal, match="both relays of one electrode"):
            shadow.follow(((LE, 1),))

    def test_relays_of_which_nothing_is_known_are_not_settled_however_long(self) -> None:
        clock = HandClock()
        shadow = relays(clock)
        clock.t_ns += 60_000 * MS
        assert refused(shadow, Approval(0b01, 0b10, 1_000, 100)).value == "not settled"
        assert refused(shadow, blanked()).value == "not all open"

    def test_half_bridges_of_which_nothing_is_known_have_nothing_selected(self) -> None:
        shadow = bridges()
        assert refused(shadow, blanked()).value == "0 behind the blanking"
        shift(shadow, 0b100)
        follow(shadow, ((LE, 1),), ((LE, 0),))
        shadow.check_selection(blanked(0b100))
        shadow.reset(())
        assert refused(shadow, blanked(0b100)).value == "0 behind the blanking"


class TestSelection:
    def test_the_source_is_approved_as_well_as_all_others(self) -> None:
        shadow = bridges()
        shift(shadow, 0b1)
        follow(shadow, ((LE, 1),), ((LE, 0),), ((BL, 1),))
        shadow.check_selection(Approval(0b1, ALL - 1, 1_000, 100))
        told = refused(shadow, Approval(0b11, ALL - 1, 1_000, 100))
        assert (told.rule, told.value, told.allowed) == (
            "switch",
            "outputs 1 on source",
            "3 was approved",
        )

    def test_an_output_that_is_selected_is_not_none(self) -> None:
        shadow = bridges()
        shift(shadow, 0b1000)
        follow(shadow, ((LE, 1),), ((LE, 0),), ((BL, 1),))
        told = refused(shadow, Approval(0, ALL, 300, 50))
        assert (told.rule, told.value) == ("switch", "8 selected")


class TestBreakBeforeMake:
    """Opened at 5 s; what has to be open for a millisecond may close a millisecond later."""

    WORD = 0b10_01

    def opened(self) -> tuple[HandClock, RelayShadow]:
        clock = HandClock()
        shadow = relays(clock)
        shift(shadow, 0)
        follow(shadow, ((LE, 0),), ((LE, 1),))
        shift(shadow, self.WORD)
        shadow.follow(((LE, 0),))
        return clock, shadow

    def test_in_that_very_nanosecond(self) -> None:
        clock, shadow = self.opened()
        clock.t_ns += MS
        shadow.follow(((LE, 1),))
        clock.t_ns += MS
        shadow.check_selection(Approval(0b01, 0b10, 1_000, 100))

    @pytest.mark.parametrize(("waited_ns", "told_us"), [(MS - 1, 999), (MS // 2, 500)])
    def test_not_a_nanosecond_before(self, waited_ns: int, told_us: int) -> None:
        clock, shadow = self.opened()
        clock.t_ns += waited_ns
        with pytest.raises(GuardRefusal) as caught:
            shadow.follow(((LE, 1),))
        assert caught.value.value == f"made {told_us} us after breaking"
