"""Half-bridges on the wire: what changes, in which order, and in how few calls."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest

from board_rig import BoardRig
from etd_body.interface import Side
from etd_hal.errors import BoardFault, CannotSelect
from etd_hal.fake.faults import LostClock, StuckLine
from plain_records import told

pytestmark = pytest.mark.slow

Boards = Callable[..., BoardRig]

#: 1000 uA of 10 mA is code 409, which is sent as 0664.
ON, OFF = "dac=0664", "dac=0000"
STEP = ["DATA=0", "CLK=1", "LE=1", "CLK=0"]


def second_visit(rig: BoardRig, *phases: bool) -> list[str]:
    """The story of a visit next in scan order, with a width too short for an end sample."""
    rig.visit(4, True, width_us=30)
    rig.clock.spend(1_000_000)
    before = len(rig.records())
    rig.visit(5, *phases, width_us=30)
    return rig.story(before)


def test_an_anodic_visit_latches_then_un_blanks_then_fires_then_grounds(boards: Boards) -> None:
    assert second_visit(boards(), True) == [
        *STEP, "LE=0", "BL=1", ON, OFF, "POL=1", "BL=0",
    ]  # fmt: skip


def test_a_cathodic_visit_inverts_after_un_blanking_and_restores_before_blanking(
    boards: Boards,
) -> None:
    assert second_visit(boards(), False) == [
        *STEP, "LE=0", "BL=1", "POL=0", ON, OFF, "POL=1", "BL=0",
    ]  # fmt: skip


def test_a_biphasic_visit_flips_between_two_messages(boards: Boards) -> None:
    assert second_visit(boards(), True, False) == [
        *STEP, "LE=0", "BL=1", ON, OFF, "POL=0", ON, OFF, "POL=1", "BL=0",
    ]  # fmt: skip


def test_a_biphasic_visit_can_begin_cathodic(boards: Boards) -> None:
    assert second_visit(boards(), False, True) == [
        *STEP, "LE=0", "BL=1", "POL=0", ON, OFF, "POL=1", ON, OFF, "POL=1", "BL=0",
    ]  # fmt: skip


@pytest.mark.parametrize(("phases", "calls"), [((True,), 5), ((False,), 6)])
@pytest.mark.parametrize("name", ["kajimoto-hv507", "etactilekit-hv513"])
def test_in_scan_order_a_pulse_takes_so_many_bus_calls(
    boards: Boards, name: str, phases: tuple[bool, ...], calls: int
) -> None:
    rig = boards(name)
    rig.visit(0, *phases)
    for output in range(1, 32):
        before, records = rig.gpio.calls, len(rig.records())
        rig.visit(output, *phases)
        messages = [entry for entry in rig.since(records) if entry.get("event") == "message"]
        assert rig.gpio.calls - before + len(messages) == calls


@pytest.mark.parametrize("name", ["kajimoto-hv507", "etactilekit-hv513-x8"])
@pytest.mark.parametrize(("is_anodic", "sign"), [(True, 1), (False, -1)])
def test_each_output_gets_its_own_pulse_in_any_order(
    boards: Boards, name: str, is_anodic: bool, sign: int
) -> None:
    rig = boards(name)
    last = rig.file.switch.outputs - 1
    order = [0, 1, 2, last, 0, 17, 5, 5, 31, last]
    for output in order:
        rig.visit(output, is_anodic, current_ua=2_000)
    assert [entry["electrode"] for entry in rig.body()] == order
    assert all(
        entry["asked_ua"] * sign > 0 and entry["current_ua"] * sign > 0 for entry in rig.body()
    )


@pytest.mark.parametrize(("phases", "signs"), [((True, False), [1, -1]), ((False, True), [-1, 1])])
def test_the_body_feels_both_phases_in_the_order_asked(
    boards: Boards, phases: tuple[bool, bool], signs: list[int]
) -> None:
    rig = boards()
    rig.visit(9, *phases)
    assert [entry["asked_ua"] // abs(entry["asked_ua"]) for entry in rig.body()] == signs


def test_the_same_output_again_needs_no_clock(boards: Boards) -> None:
    rig = boards()
    rig.visit(7, width_us=30)
    before = len(rig.records())
    rig.visit(7, width_us=30)
    assert rig.story(before) == ["BL=1", ON, OFF, "POL=1", "BL=0"]


def test_the_latch_is_closed_before_the_outputs_go_live(boards: Boards) -> None:
    rig = boards()
    for output in (3, 4, 60, 0):
        before = len(rig.records())
        rig.visit(output)
        assert rig.times("LE", 0, before)[-1] < rig.times("BL", 1, before)[0]


def test_all_rest_together_on_ground_between_visits(boards: Boards) -> None:
    rig = boards()
    for output in range(6):
        rig.visit(output)
        assert set(rig.sides) == {Side.GROUND}
    grounded, live = rig.times("BL", 0)[-6:], rig.times("BL", 1)[-6:]
    for rest_from_ns, next_ns in pairwise(sorted(grounded + live)[1:]):
        if rest_from_ns in grounded:
            assert next_ns - rest_from_ns >= rig.file.rest_us * 1_000


def test_a_whole_prepare_shifts_every_stage(boards: Boards) -> None:
    rig = boards()
    rig.visit(3)
    before = len(rig.records())
    rig.visit(4, whole=True)
    assert len(rig.times("CLK", 1, before)) == 64
    assert rig.body()[-1]["electrode"] == 4


def test_a_whole_prepare_shifts_every_stage_for_the_same_output_too(boards: Boards) -> None:
    rig = boards()
    rig.visit(3)
    before = len(rig.records())
    rig.visit(3, whole=True)
    assert len(rig.times("CLK", 1, before)) == 64


def test_clearing_shifts_every_stage_whatever_is_held(boards: Boards) -> None:
    rig = boards()
    rig.visit(3)
    before = len(rig.records())
    rig.board.switch.clear()
    assert rig.story(before).count("CLK=1") == 64
    assert "DATA=1" not in rig.story(before)


def test_a_chosen_set_of_returns_names_the_output_that_cannot_be_open(boards: Boards) -> None:
    rig = boards()
    returns = tuple(electrode for electrode in range(64) if electrode not in (5, 41))
    with pytest.raises(CannotSelect, match="HV507 connects every output") as caught:
        rig.board.selection(5, returns)
    assert (caught.value.output, caught.value.wanted) == (41, "left open")


def test_returns_that_are_all_others_are_what_the_chip_does(boards: Boards) -> None:
    board = boards().board
    others = tuple(electrode for electrode in range(64) if electrode != 5)
    assert told(board.selection(5, others)) == told(board.selection(5, None))


@pytest.mark.parametrize("output", [-1, 64, 1_000])
def test_an_output_that_is_not_there_cannot_be_selected(boards: Boards, output: int) -> None:
    with pytest.raises(CannotSelect, match="the board has 64") as caught:
        boards().board.selection(output, None)
    assert caught.value.output == output


def test_a_lost_clock_is_found_at_the_next_whole_prepare(boards: Boards) -> None:
    rig = boards("reference-hv507")
    rig.visit(0, whole=True)
    fault = LostClock(at_edge=3)
    rig.fake.world.put_in(fault)
    for output in range(1, 8):
        rig.visit(output)
    with pytest.raises(BoardFault, match="switch register readback"):
        rig.board.prepare(rig.board.selection(0, None), whole=True)
    assert rig.board.safe_off() == ()


@pytest.mark.parametrize("level", [0, 1])
def test_a_readback_line_that_is_stuck_is_found(boards: Boards, level: int) -> None:
    rig = boards("reference-hv507")
    rig.visit(0, whole=True)
    rig.fake.world.put_in(StuckLine("READBACK", 1 if level else 0))
    with pytest.raises(BoardFault, match="readback"):
        rig.board.prepare(rig.board.selection(1, None), whole=True)


def test_after_a_failed_call_nothing_old_is_left_in_the_chain(boards: Boards) -> None:
    rig = boards()
    rig.visit(0)
    rig.gpio.fails = frozenset({rig.gpio.calls + 1})
    with pytest.raises(Exception, match="set on the lines failed"):
        rig.board.prepare(rig.board.selection(1, None))
    assert rig.board.safe_off() == ()
    rig.board.guard.permit(10_000)
    rig.visit(5, whole=True)
    assert rig.body()[-1]["electrode"] == 5
