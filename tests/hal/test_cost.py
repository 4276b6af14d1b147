"""The planned cost of a visit, against what the fake really takes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import msgspec
import pytest

from board_rig import BoardRig
from etd_hal.cost import CostModel
from stepped_board import shipped_board

Boards = Callable[..., BoardRig]


def model(rig: BoardRig) -> CostModel:
    return CostModel(rig.file, rig.board.machine, rig.board.timing)


def taken_us(
    rig: BoardRig, outputs: list[int], phases: tuple[bool, ...] = (True,), width_us: int = 100
) -> float:
    """Mean time from pulse to pulse, each visit's own work done in the rest as the engine does."""
    board, begun_ns = rig.board, []
    pulse = board.pulse(1_000, width_us)
    board.prepare(board.selection(outputs[0], None))
    for output, following in pairwise(outputs):
        selection = board.selection(output, None)
        first, *others = phases
        board.connect(selection, first)
        begun_ns.append(rig.clock.now_ns())
        board.fire(pulse, selection, first, 1_000, width_us)
        for is_anodic in others:
            board.flip(selection, is_anodic)
            board.fire(pulse, selection, is_anodic, 1_000, width_us)
        board.discharge()
        rig.clock.spend(int(board.machine.visit_us * 1_000))
        board.prepare(board.selection(following, None))
    return (begun_ns[-1] - begun_ns[0]) / (len(begun_ns) - 1) / 1_000


@pytest.mark.parametrize("width_us", [20, 50, 100, 200])
@pytest.mark.parametrize("phases", [(True,), (True, False)])
def test_in_scan_order_the_plan_is_what_it_takes(
    boards: Boards, phases: tuple[bool, ...], width_us: int
) -> None:
    rig = boards()
    cost = model(rig).visit(width_us, len(phases), clocks=1)
    assert taken_us(rig, list(range(30)), phases, width_us) == pytest.approx(cost.slot_us, rel=0.02)


def test_an_inverse_first_phase_costs_one_call_more_than_planned(boards: Boards) -> None:
    rig = boards()
    planned_us = model(rig).visit(100, 1, clocks=1).slot_us
    assert taken_us(rig, list(range(30)), (False,)) == pytest.approx(planned_us + 4.4, rel=0.02)


@pytest.mark.parametrize("step", [5, 20, 31])
def test_jumps_cost_their_clocks(boards: Boards, step: int) -> None:
    rig = boards()
    outputs = list(range(0, 64, step))
    planned_us = model(rig).visit(100, 1, clocks=step).slot_us
    assert taken_us(rig, outputs) == pytest.approx(planned_us, rel=0.03)


def test_clocks_within_the_rest_are_free_and_beyond_it_are_not(boards: Boards) -> None:
    costs = model(boards())
    near, still_near, far = (costs.visit(100, 1, clocks).slot_us for clocks in (1, 10, 40))
    assert near == still_near
    assert far == pytest.approx(near + 2 * 40 * 4.4 + 60.0 - 200.0)


@pytest.mark.parametrize("phases", [(True,), (False,), (True, False)])
def test_relays_cost_their_switching(boards: Boards, phases: tuple[bool, ...]) -> None:
    rig = boards("feetthrough-relay")
    planned_us = model(rig).visit(100, len(phases), clocks=1).slot_us
    assert taken_us(rig, list(range(12)), phases) == pytest.approx(planned_us, rel=0.03)


def test_a_visit_is_busy_but_for_what_is_slept_of_the_rest(boards: Boards) -> None:
    cost = model(boards()).visit(100, 1, clocks=1)
    assert cost.slot_us - cost.busy_us == pytest.approx(200.0 - 2 * 4.4 - 60.0 - 50.0)


def test_a_visit_that_fills_its_rest_with_work_never_sleeps(boards: Boards) -> None:
    cost = model(boards()).visit(100, 1, clocks=40)
    assert cost.busy_us == cost.slot_us


@pytest.mark.parametrize("phases", [1, 2])
def test_relay_waits_are_slept_but_for_their_last_spins(boards: Boards, phases: int) -> None:
    cost = model(boards("feetthrough-relay")).visit(100, phases, clocks=1)
    assert cost.slot_us - cost.busy_us == pytest.approx(phases * (2_000 - 2 * 50) + 200)


def test_the_rewrite_of_a_scan_is_what_does_not_fit_into_a_rest(boards: Boards) -> None:
    rig = boards()
    rig.visit(3)
    grounded_ns = rig.clock.now_ns()
    rig.board.prepare(rig.board.selection(4, None), whole=True)
    rig.board.connect(rig.board.selection(4, None), True)
    over_us = (rig.clock.now_ns() - grounded_ns) / 1_000 - 200.0
    assert over_us == pytest.approx(model(rig).rewrite_us(), rel=0.03)
    rig.board.discharge()


def test_a_chain_that_fits_into_the_rest_is_rewritten_for_nothing(boards: Boards) -> None:
    patient = msgspec.structs.replace(shipped_board("kajimoto-hv507"), rest_us=600)
    assert model(boards(board=patient)).rewrite_us() == 0.0


def test_relays_are_rewritten_outside_the_rest(boards: Boards) -> None:
    assert model(boards("feetthrough-relay")).rewrite_us() == pytest.approx(2 * 64 * 4.4)
