"""A probe into outputs that are blanked: what the last guard lets through, and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from board_rig import BoardRig, changed, fire_phase
from etd_hal.errors import GuardRefusal
from etd_hal.switch_shadow import Approval
from stepped_board import shipped_board

Boards = Callable[..., BoardRig]
BOARDS = ["kajimoto-hv507", "feetthrough-relay"]
PROBE, PULSE = (300, 50), (1_000, 100)


def fire(
    rig: BoardRig,
    output: int = 3,
    what: tuple[int, int] = PROBE,
    is_blanked: bool = True,
    is_anodic: bool = True,
) -> None:
    pulse = rig.board.pulse(*what)
    selection = rig.board.selection(output, None)
    fire_phase(rig.board, pulse, selection, is_anodic, *what, is_blanked=is_blanked)


def prepared(rig: BoardRig, output: int = 3) -> BoardRig:
    rig.board.prepare(rig.board.selection(output, None))
    rig.board.release()
    return rig


def connected(rig: BoardRig, output: int = 3) -> BoardRig:
    selection = rig.board.selection(output, None)
    rig.board.prepare(selection)
    rig.board.connect(selection, True)
    return rig


@pytest.mark.parametrize("name", BOARDS)
def test_a_probe_may_go_into_outputs_that_are_blanked_and_a_pulse_may_not(
    boards: Boards, name: str
) -> None:
    rig = prepared(boards(name))
    fire(rig)
    for stronger in (PULSE, (301 + 3, 50), (300, 60)):
        with pytest.raises(GuardRefusal, match="a pulse with nothing connected"):
            fire(rig, what=stronger)


@pytest.mark.parametrize("name", BOARDS)
def test_nothing_else_may(boards: Boards, name: str) -> None:
    rig = prepared(boards(name))
    with pytest.raises(GuardRefusal):
        fire(rig, is_blanked=False)


@pytest.mark.parametrize("name", BOARDS)
def test_what_is_said_to_be_blanked_must_be(boards: Boards, name: str) -> None:
    rig = connected(boards(name))
    with pytest.raises(GuardRefusal, match=r"not blanked|not all open"):
        fire(rig)


def test_behind_the_blanking_is_the_one_that_was_approved(boards: Boards) -> None:
    rig = prepared(boards("kajimoto-hv507"), output=4)
    with pytest.raises(GuardRefusal, match="behind the blanking"):
        fire(rig, output=3)


def test_it_is_counted_and_is_no_first_phase(boards: Boards) -> None:
    """What reverses it begins a visit of its own."""
    file = changed(shipped_board("kajimoto-hv507"), "maxima", rate_hz=1)
    rig = prepared(boards(board=file))
    selection = rig.board.selection(3, None)
    fire(rig)
    rig.board.connect(selection, False)
    with pytest.raises(GuardRefusal, match="rate"):
        fire(rig, is_blanked=False, is_anodic=False)


# --- nothing selected -----------------------------------------------------------------------------


def fire_unloaded(rig: BoardRig, what: tuple[int, int] = PROBE) -> float:
    """What the node comes to."""
    return rig.board.fire_unloaded(rig.board.pulse(*what), *what).voltage_v


@pytest.mark.parametrize("is_whole", [False, True])
@pytest.mark.parametrize("name", BOARDS)
def test_a_probe_may_go_into_the_node_alone_as_often_as_anybody_likes(
    boards: Boards, name: str, is_whole: bool
) -> None:
    rig = boards(board=changed(shipped_board(name), "maxima", rate_hz=1))
    rig.board.supply_on()
    rig.clock.sleep_until_ns(rig.clock.now_ns() + 1_000_000_000)
    rig.board.isolate(is_whole)
    for _ in range(3):
        assert fire_unloaded(rig) == pytest.approx(300e-6 * 66_000, rel=0.02)
    rig = connected(rig)
    fire(rig, is_blanked=False)


@pytest.mark.parametrize("name", BOARDS)
def test_a_pulse_may_not(boards: Boards, name: str) -> None:
    rig = boards(name)
    rig.board.isolate()
    with pytest.raises(GuardRefusal, match="a pulse with nothing connected"):
        fire_unloaded(rig, PULSE)


@pytest.mark.parametrize("name", BOARDS)
def test_no_probe_that_is_said_to_be_unloaded_goes_into_an_electrode(
    boards: Boards, name: str
) -> None:
    rig = connected(boards(name))
    with pytest.raises(GuardRefusal, match=r"not blanked|not all open"):
        fire_unloaded(rig)


def test_no_output_may_be_selected_behind_the_blanking(boards: Boards) -> None:
    rig = prepared(boards("kajimoto-hv507"), output=4)
    with pytest.raises(GuardRefusal, match="behind the blanking"):
        fire_unloaded(rig)
    rig.board.isolate()
    fire_unloaded(rig)


# --- live outputs, none selected -----------------------------------------------------------------


def fire_unselected(rig: BoardRig, what: tuple[int, int] = PROBE) -> float:
    return rig.board.fire_unselected(rig.board.pulse(*what), *what).voltage_v


def test_a_probe_may_go_into_live_outputs_of_which_none_is_selected(boards: Boards) -> None:
    rig = boards(board=changed(shipped_board("kajimoto-hv507"), "maxima", rate_hz=1))
    rig.board.supply_on()
    rig.clock.sleep_until_ns(rig.clock.now_ns() + 1_000_000_000)
    for _ in range(3):
        rig.board.isolate()
        assert fire_unselected(rig) == pytest.approx(300e-6 * 66_000, rel=0.02)
    rig = connected(rig)
    fire(rig, is_blanked=False)


def test_a_pulse_may_not_go_there(boards: Boards) -> None:
    rig = boards("kajimoto-hv507")
    rig.board.isolate()
    with pytest.raises(GuardRefusal, match="a pulse with nothing connected"):
        fire_unselected(rig, PULSE)


def test_with_an_output_selected_it_is_refused(boards: Boards) -> None:
    rig = prepared(boards("kajimoto-hv507"))
    with pytest.raises(GuardRefusal, match="8 selected"):
        fire_unselected(rig)


def test_with_all_outputs_on_the_source_it_is_refused(boards: Boards) -> None:
    """Zeros in the latch are all ones with POL 0."""
    rig = boards("kajimoto-hv507")
    rig.board.isolate()
    selection = rig.board.selection(3, None)
    rig.board.switch.connect(selection, False)
    pulse, ground = rig.board.pulse(*PROBE), (1 << 64) - 1
    with pytest.raises(GuardRefusal, match="none, with POL 1"):
        rig.board.send(pulse, Approval(0, ground, *PROBE))


def test_behind_a_blanking_it_is_refused(boards: Boards) -> None:
    rig = boards("kajimoto-hv507")
    rig.board.isolate()
    pulse, ground = rig.board.pulse(*PROBE), (1 << 64) - 1
    with pytest.raises(GuardRefusal, match="closed and un-blanked"):
        rig.board.send(pulse, Approval(0, ground, *PROBE))


@pytest.mark.parametrize("way", ["none selected", "blanked"])
def test_a_pulse_that_was_let_through_at_an_electrode_may_still_not(
    boards: Boards, way: str
) -> None:
    """What follows from message and approval is judged once; where it goes is no part of that."""
    rig = connected(boards("kajimoto-hv507"))
    pulse, selection = rig.board.pulse(*PULSE), rig.board.selection(3, None)
    fire_phase(rig.board, pulse, selection, True, *PULSE)
    rig.board.discharge()
    rig.board.release()
    rig.board.isolate()
    fire = rig.board.fire_unselected if way == "none selected" else rig.board.fire_unloaded
    with pytest.raises(GuardRefusal, match="a pulse with nothing connected"):
        fire(pulse, *PULSE)
