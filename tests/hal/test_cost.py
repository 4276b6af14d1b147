"""The planned cost of a visit, against what the fake really takes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import msgspec
import pytest

from board_rig import BoardRig, fire_phase
from etd_hal.cost import FIRING_PART, CostModel, FiledComputing
from stepped_board import shipped_board

Boards = Callable[..., BoardRig]


#: What is computed for a pulse: while the electrode before rests, and beside its message.
COMPUTING_US = 60.0
FIRING_US = FIRING_PART * COMPUTING_US
RESTING_US = COMPUTING_US - FIRING_US


def model(rig: BoardRig) -> CostModel:
    return CostModel(rig.file, rig.board.machine, rig.board.timing, FiledComputing(COMPUTING_US))


def taken_us(
    rig: BoardRig, outputs: list[int], phases: tuple[bool, ...] = (True,), width_us: int = 100
) -> float:
    """Mean time from pulse to pulse, with the computing where the engine does it."""
    board, begun_ns = rig.board, []
    pulse = board.pulse(1_000, width_us)
    board.prepare(board.selection(outputs[0], None))
    for output, following in pairwise(outputs):
        selection = board.selection(output, None)
        first, *others = phases
        board.connect(selection, first)
        begun_ns.append(rig.clock.now_ns())
        rig.clock.spend(round(FIRING_US * 1_000))
        fire_phase(board, pulse, selection, first, 1_000, width_us)
        for is_anodic in others:
            board.flip(selection, is_anodic)
            rig.clock.spend(round(FIRING_US * 1_000))
            fire_phase(board, pulse, selection, is_anodic, 1_000, width_us)
        board.discharge()
        rig.clock.spend(round(RESTING_US * 1_000))
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
    assert far == pytest.approx(near + 2 * 40 * 4.4 + RESTING_US - 200.0)


@pytest.mark.parametrize("phases", [(True,), (False,), (True, False)])
def test_relays_cost_their_switching(boards: Boards, phases: tuple[bool, ...]) -> None:
    rig = boards("feetthrough-relay")
    planned_us = model(rig).visit(100, len(phases), clocks=1).slot_us
    assert taken_us(rig, list(range(12)), phases) == pytest.approx(planned_us, rel=0.03)


def test_a_visit_is_busy_but_for_what_is_slept_of_the_rest(boards: Boards) -> None:
    cost = model(boards()).visit(100, 1, clocks=1)
    assert cost.slot_us - cost.busy_us == pytest.approx(200.0 - 2 * 4.4 - RESTING_US - 50.0)


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


def test_the_parts_of_a_slot_are_its_wire_its_rest_and_what_computing_no_rest_hides(
    boards: Boards,
) -> None:
    rig = boards()
    message_us = rig.board.timing.message_us + 100 + 2 * 4.4
    hidden = model(rig).visit(100, 1, clocks=1)
    assert hidden[:3] == pytest.approx((message_us, 200.0, FIRING_US))
    slow = CostModel(rig.file, rig.board.machine, rig.board.timing, FiledComputing(400.0))
    shown_us = 400.0 - 200.0 + 2 * 4.4
    assert slow.visit(100, 1, clocks=1)[:3] == pytest.approx((message_us, 200.0, shown_us))


def test_clocks_that_no_rest_hides_are_the_wires(boards: Boards) -> None:
    near, far = (model(boards()).visit(100, 1, clocks) for clocks in (1, 40))
    assert far.wire_us - near.wire_us == pytest.approx(2 * 40 * 4.4 - 200.0)
    assert far.processor_us == pytest.approx(COMPUTING_US)


@pytest.mark.parametrize("pulse_us", [0.0, 60.0, 200.0, 900.0])
@pytest.mark.parametrize("clocks", [1, 20, 64])
@pytest.mark.parametrize("board", ["kajimoto-hv507", "feetthrough-relay"])
def test_no_part_is_negative_and_no_pulse_is_busy_for_longer_than_it_lasts(
    boards: Boards, board: str, clocks: int, pulse_us: float
) -> None:
    rig = boards(board)
    costs = CostModel(rig.file, rig.board.machine, rig.board.timing, FiledComputing(pulse_us))
    for phases, probe_us in ((1, 0), (2, 0), (1, 50)):
        cost = costs.visit(100, phases, clocks, probe_us)
        assert min(cost) >= 0
        assert cost.busy_us <= cost.slot_us + 1e-6
