"""When the source and the latch are checked, by which pulses, and what is said of them."""

from __future__ import annotations

import pytest

from board_rig import board_rig, changed
from charge_witness import even_skin
from engine_parts import body_site
from etd.engine.source_check import SourceCheck
from etd.firing import Firing
from etd.safety.ledger import Bounds, Ledger
from etd.safety.maxima import MaximaInForce, maxima_of
from etd_hal.boardfile import BoardFile
from etd_hal.fake.faults import DacGain, GainAbove, StuckBehind
from stepped_board import shipped_board

CHAIN, RELAYS = "kajimoto-hv507", "feetthrough-relay"
#: Each second, and each tenth of one; a check takes up to a millisecond.
SECOND_NS, TENTH_NS, TAKES_NS = 1_000_000_000, 100_000_000, 1_000_000
HERE, WIDTH_US = 5, 100
#: Blanked, or live with none selected; a third of a probe, or the whole.
PART, WHOLE, LIVE = "blanked, a third", "blanked, the whole", "live, a third"


class Checked:
    """A check of a live board on even skin, which has fired at one electrode."""

    def __init__(self, board: str | BoardFile = CHAIN) -> None:
        file = shipped_board(board) if isinstance(board, str) else board
        self.rig = board_rig(board=file, body=even_skin(file, file.switch.outputs))
        self.rig.begin()
        maxima = maxima_of(file, body_site())
        ledger = Ledger(file.switch.outputs, Bounds.of(maxima))
        firing = Firing(self.rig.board, ledger, self.rig.clock)
        self.probe_ua = maxima.probe_current_ua
        self.check = SourceCheck(self.rig.board, MaximaInForce(maxima), firing)
        self.rig.clock.spend(SECOND_NS)
        returns = (HERE + 1,) if self.rig.board.switch.can_choose_returns else None
        self.rig.visit(HERE, returns=returns, current_ua=200)
        self._seen = len(self._pulses())

    def _pulses(self) -> list[str]:
        followed = self.rig.stepped.followed
        found = [(phase.from_ns, PART if phase.current_ua <= self.probe_ua / 3 else WHOLE)
                 for phase in followed.unloaded()]  # fmt: skip
        for phase in followed.unselected():
            assert phase.current_ua <= self.probe_ua / 3
            found.append((phase.from_ns, LIVE))
        return [kind for _, kind in sorted(found)]

    def made(self, *, is_before_arming: bool = False) -> list[str]:
        """The pulses of a check now, which finds nothing."""
        assert self.said(is_before_arming=is_before_arming) is None
        return self.since()

    def said(self, *, is_before_arming: bool = False) -> str | None:
        """What it finds."""
        now_ns = self.rig.clock.now_ns()
        check = self.check.check
        fault = check(now_ns, is_before_arming=True) if is_before_arming else check(now_ns)
        return None if fault is None else str(fault)

    def since(self) -> list[str]:
        """The pulses since the last time."""
        pulses = self._pulses()
        new, self._seen = pulses[self._seen :], len(pulses)
        return new

    def later(self, ns: int) -> None:
        self.rig.clock.spend(ns)

    def is_due(self, after_ns: int, room_ns: int | None, *, is_ready: bool = True) -> bool:
        """So long after the last of all."""
        return self.check.is_due(self.check.checked_ns + after_ns, room_ns, is_ready=is_ready)


# --- when -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("room_ns", "is_ready", "from_ns"),
    [
        (None, True, TENTH_NS),
        (None, False, TENTH_NS),
        (TAKES_NS, True, TENTH_NS),
        (TAKES_NS, False, TENTH_NS),
        (TAKES_NS - 1, True, 2 * TENTH_NS),
        (0, True, 2 * TENTH_NS),
    ],
)
def test_the_latch_is_due_each_tenth_of_a_second_and_one_scan_may_go_first(
    room_ns: int | None, from_ns: int, *, is_ready: bool
) -> None:
    checked = Checked()
    checked.made(is_before_arming=True)
    assert not checked.is_due(from_ns - 1, room_ns, is_ready=is_ready)
    assert checked.is_due(from_ns, room_ns, is_ready=is_ready)


@pytest.mark.parametrize("room_ns", [None, 0, TAKES_NS - 1])
def test_where_relays_connect_there_is_one_each_second(room_ns: int | None) -> None:
    checked = Checked(RELAYS)
    checked.made(is_before_arming=True)
    assert not checked.is_due(SECOND_NS - 1, room_ns)
    assert checked.is_due(SECOND_NS, room_ns)


@pytest.mark.parametrize("board", [CHAIN, RELAYS])
def test_a_scan_whose_chain_is_rewritten_goes_first_whatever_is_due(board: str) -> None:
    checked = Checked(board)
    checked.made(is_before_arming=True)
    assert not checked.is_due(2 * SECOND_NS, TAKES_NS - 1, is_ready=False)
    assert checked.is_due(2 * SECOND_NS, TAKES_NS, is_ready=False)
    assert checked.is_due(2 * SECOND_NS, None, is_ready=False)
    assert checked.check.is_due(checked.check.checked_ns + 2 * SECOND_NS, 0), "it is ready"


def test_the_latch_counts_from_its_own_last_pulse() -> None:
    checked = Checked()
    checked.made(is_before_arming=True)
    checked.later(TENTH_NS)
    assert checked.made() == [LIVE]
    since_ns = checked.rig.clock.now_ns() - checked.check.checked_ns
    assert not checked.is_due(since_ns + TENTH_NS // 2, None)
    assert checked.is_due(since_ns + TENTH_NS, None)


@pytest.mark.parametrize(("board", "period_ns"), [(CHAIN, TENTH_NS), (RELAYS, SECOND_NS)])
def test_before_the_first_one_the_last_counts_as_of_time_zero(board: str, period_ns: int) -> None:
    assert Checked(board).check.checked_ns == 0
    assert not Checked(board).is_due(period_ns - 1, None)
    assert Checked(board).is_due(period_ns, None)


# --- which pulses ---------------------------------------------------------------------------------


def test_before_arming_all_are_made() -> None:
    for _ in range(2):
        assert Checked().made(is_before_arming=True) == [PART, WHOLE, LIVE]
        assert Checked(RELAYS).made(is_before_arming=True) == [PART, WHOLE]
    checked = Checked()
    checked.is_due(0, 0)
    checked.made(is_before_arming=True)
    assert checked.made(is_before_arming=True) == [PART, WHOLE, LIVE], "also while a frame waits"


def test_while_armed_the_live_pulses_stand_for_the_blanked_third() -> None:
    checked = Checked()
    checked.made(is_before_arming=True)
    checked.later(SECOND_NS)
    assert checked.is_due(SECOND_NS, None)
    assert checked.made() == [WHOLE, LIVE]
    relays = Checked(RELAYS)
    relays.made(is_before_arming=True)
    relays.later(SECOND_NS)
    assert relays.made() == [PART, WHOLE]


def test_between_two_scans_there_is_one_message_and_the_live_one_comes_next() -> None:
    checked = Checked()
    checked.made(is_before_arming=True)
    checked.later(SECOND_NS)
    assert checked.is_due(SECOND_NS, TAKES_NS)
    assert checked.made() == [WHOLE]
    assert checked.is_due(0, TAKES_NS)
    assert checked.made() == [LIVE]
    assert not checked.is_due(0, TAKES_NS)


def test_the_second_counts_from_the_whole_and_not_from_the_live_ones() -> None:
    checked = Checked()
    checked.made(is_before_arming=True)
    begun_ns = checked.check.checked_ns
    checked.later(SECOND_NS // 2)
    assert checked.made() == [LIVE]
    assert checked.check.checked_ns == begun_ns
    checked.later(begun_ns + SECOND_NS - checked.rig.clock.now_ns())
    assert checked.made() == [WHOLE, LIVE]


def test_where_the_node_of_the_whole_cannot_be_read_a_third_of_it_is_made() -> None:
    blind = changed(shipped_board(CHAIN), "source", leak_ohm=900_000)
    checked = Checked(blind)
    assert checked.check.limitations == ()
    assert checked.made(is_before_arming=True) == [PART, LIVE]
    checked.later(SECOND_NS)
    assert checked.made() == [PART, LIVE]


def test_where_not_even_that_can_be_read_it_says_so_and_nothing_is_fired() -> None:
    blind = changed(shipped_board(CHAIN), "source", leak_ohm=1_000)
    checked = Checked(blind)
    said = checked.check.limitations[0]
    assert said.startswith("the source is not checked while armed: ")
    assert "1000 ohm" in said
    assert not checked.is_due(10 * SECOND_NS, None)
    assert checked.made(is_before_arming=True) == []


# --- what is said ---------------------------------------------------------------------------------


@pytest.mark.parametrize("board", [CHAIN, RELAYS])
@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_a_wrong_gain_is_told_by_the_first_pulse_and_no_stronger_one_follows(
    board: str, factor: float
) -> None:
    checked = Checked(board)
    checked.rig.fake.world.put_in(DacGain(factor))
    assert "with nothing connected" in str(checked.said(is_before_arming=True))
    assert len(checked.since()) == 1


@pytest.mark.parametrize("board", [CHAIN, RELAYS])
def test_what_is_wrong_above_a_third_only_is_told_by_the_whole_with_no_output_live(
    board: str,
) -> None:
    checked = Checked(board)
    code = checked.rig.file.source.code_for(checked.probe_ua * 2 // 3)
    checked.rig.fake.world.put_in(GainAbove(code=code, factor=1.5))
    said = str(checked.said(is_before_arming=True))
    assert f"node at {checked.probe_ua - 3} uA with nothing connected" in said
    assert len(checked.since()) == 2


def test_a_latch_that_does_not_move_is_told_by_the_live_pulse_alone() -> None:
    checked = Checked()
    checked.made(is_before_arming=True)
    checked.rig.visit(HERE, current_ua=200)
    checked.rig.fake.world.put_in(StuckBehind("LE", 0))
    checked.later(TENTH_NS)
    assert "with no output selected" in str(checked.said())
    assert checked.since() == [LIVE, PART], "which of the two it is"


def test_a_latch_that_does_not_move_is_told_before_arming_and_each_second() -> None:
    for is_before_arming in (True, False):
        checked = Checked()
        checked.rig.fake.world.put_in(StuckBehind("LE", 0))
        said = str(checked.said(is_before_arming=is_before_arming))
        assert "with no output selected" in said
        assert checked.since()[-1] == LIVE, "the source has been looked at"


def test_a_source_that_is_wrong_is_not_taken_for_a_latch() -> None:
    checked = Checked()
    checked.made(is_before_arming=True)
    checked.rig.fake.world.put_in(DacGain(1.5))
    checked.later(TENTH_NS)
    assert "with nothing connected" in str(checked.said())
