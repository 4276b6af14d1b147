"""A probe and its pulse as one visit: what the last guard counts, and what it does not."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from board_rig import BoardRig, board_rig, changed, fire_phase
from etd_hal.errors import GuardRefusal
from stepped_board import shipped_board
from trace_decoder import decode, is_led

Boards = Callable[..., BoardRig]
RATE_HZ = 5
BOARDS = ["kajimoto-hv507", "feetthrough-relay"]
#: The bounds of all shipped boards; pulses as weak and short are probes to the guard.
PROBE = (300, 50)
PULSE = (1_000, 100)


def rig_of(boards: Boards, name: str = "kajimoto-hv507", **maxima: int) -> BoardRig:
    return boards(board=changed(shipped_board(name), "maxima", rate_hz=RATE_HZ, **maxima))


def connect(rig: BoardRig, output: int = 3, is_anodic: bool = True) -> None:
    selection = rig.board.selection(output, None)
    rig.board.prepare(selection)
    rig.board.connect(selection, is_anodic)


def fire(rig: BoardRig, what: tuple[int, int], output: int = 3, is_anodic: bool = True) -> None:
    pulse = rig.board.pulse(*what)
    fire_phase(rig.board, pulse, rig.board.selection(output, None), is_anodic, *what)


def visit(rig: BoardRig, *parts: tuple[int, int]) -> None:
    connect(rig)
    for entry in parts:
        fire(rig, entry)
    rig.board.discharge()


@pytest.mark.parametrize("name", BOARDS)
def test_a_probe_and_its_pulse_are_one_visit(boards: Boards, name: str) -> None:
    rig = rig_of(boards, name)
    for _ in range(RATE_HZ):
        visit(rig, PROBE, PULSE)
    with pytest.raises(GuardRefusal, match="6 pulses in a second"):
        visit(rig, PROBE, PULSE)
    assert len(rig.body()) == 2 * RATE_HZ


@pytest.mark.parametrize("name", BOARDS)
def test_both_phases_behind_a_probe_belong_to_its_visit(boards: Boards, name: str) -> None:
    rig = rig_of(boards, name)
    for _ in range(RATE_HZ):
        connect(rig)
        fire(rig, PROBE)
        fire(rig, PULSE)
        rig.board.flip(rig.board.selection(3, None), False)
        fire(rig, PULSE, is_anodic=False)
        rig.board.discharge()
    with pytest.raises(GuardRefusal, match="rate"):
        visit(rig, PULSE)
    assert len(rig.body()) == 3 * RATE_HZ


@pytest.mark.parametrize(
    "first", [(310, 50), (300, 70), PULSE], ids=["too strong", "too long", "a pulse"]
)
def test_what_is_more_than_a_probe_leads_nothing(boards: Boards, first: tuple[int, int]) -> None:
    rig = rig_of(boards)
    for _ in range(2):
        visit(rig, first, PULSE)
    with pytest.raises(GuardRefusal, match="rate"):
        visit(rig, first, PULSE)


def test_a_visit_has_one_probe(boards: Boards) -> None:
    """Of three, the third begins a visit of its own."""
    rig = rig_of(boards)
    for _ in range(2):
        visit(rig, PROBE, PROBE, PULSE)
    with pytest.raises(GuardRefusal, match="rate"):
        visit(rig, PROBE, PROBE, PULSE)


def test_a_probe_that_was_let_go_leads_nothing(boards: Boards) -> None:
    """Relays stay closed through a rest: there the next visit of the same output may pass for it,
    and there as well each visit has one at most.
    """
    rig = rig_of(boards)
    for _ in range(2):
        visit(rig, PROBE)
        visit(rig, PULSE)
    visit(rig, PROBE)
    with pytest.raises(GuardRefusal, match="rate"):
        visit(rig, PULSE)


def test_a_probe_from_before_the_safe_state_leads_nothing(boards: Boards) -> None:
    rig = rig_of(boards)
    for _ in range(RATE_HZ):
        connect(rig)
        fire(rig, PROBE)
        assert rig.board.safe_off() == ()
        rig.board.guard.permit(10_000)
    connect(rig)
    with pytest.raises(GuardRefusal, match="rate"):
        fire(rig, PULSE)


def test_the_charge_of_a_probe_counts_to_the_pulse_behind_it(boards: Boards) -> None:
    """At worst 125 nC, of 108 and a fifth more allowed; the probe's 22 are too much."""
    rig = rig_of(boards, charge_nc=108)
    visit(rig, PULSE)
    connect(rig)
    fire(rig, PROBE)
    with pytest.raises(GuardRefusal, match="charge"):
        fire(rig, PULSE)


#: What is fired, and whether the switch is let go first; and whether the other way round.
actions = st.lists(
    st.tuples(st.sampled_from([PROBE, PULSE]), st.booleans(), st.booleans()),
    min_size=1,
    max_size=40,
)


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(actions=actions)
def test_whatever_is_tried_no_flood_goes_uncounted(
    actions: list[tuple[tuple[int, int], bool, bool]],
) -> None:
    """In a second, no more pulses one way than the rate, and no more than one probe a visit."""
    rig = board_rig(board=changed(shipped_board("kajimoto-hv507"), "maxima", rate_hz=RATE_HZ))
    rig.begin()
    connect(rig)
    way = True
    for what, is_let_go, is_reversed in actions:
        if is_let_go:
            rig.board.discharge()
            connect(rig, is_anodic=way)
        if is_reversed:
            way = not way
            rig.board.flip(rig.board.selection(3, None), way)
        try:
            fire(rig, what, is_anodic=way)
        except GuardRefusal:
            continue
    fired = decode(rig.stepped.trace_lines())
    assert fired[-1].to_ns - fired[0].from_ns < 1_000_000_000
    strong = [phase for phase in fired if phase.current_ua > 900]
    weak = [phase for phase in fired if phase.current_ua < 900]
    assert len(strong) <= 2 * RATE_HZ
    assert len(weak) + len(strong) <= 3 * RATE_HZ
    led = sum(is_led(phase, other) for phase, other in pairwise(fired))
    assert led <= RATE_HZ
