"""The rule of visits: what no sequence of messages may win, by the rule and on the wires."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from board_rig import BoardRig, board_rig, changed, fire_phase
from etd_hal.errors import GuardRefusal
from etd_hal.visitrule import longest_flip_ns
from stepped_board import shipped_board
from trace_decoder import Phase, decode
from visit_wires import FLIP_NS, HALF_BRIDGES, LONGEST_US, MS, RATE_HZ, RELAYS, SECOND_NS, Wires

pytestmark = pytest.mark.slow

PROBE, PULSE = (300, 50), (1_000, 100)


@dataclass(frozen=True)
class Sent:
    """A message that the rule let pass."""

    source: int
    ground: int
    is_probe: bool
    is_blanked: bool
    t_ns: int
    moves: int


def begins_ns(sent: list[Sent], output: int) -> list[int]:
    """When visits of an output began, told by the text of the rule."""
    found, may_lead, may_be_reversed = [], False, False
    for number, one in enumerate(sent):
        before = sent[number - 1] if number else one
        moves = one.moves - before.moves
        sides = (one.source, one.ground)
        is_led = may_lead and moves == 0 and sides == (before.source, before.ground)
        is_second = (
            may_be_reversed
            and moves == 1
            and sides == (before.ground, before.source)
            and one.t_ns - before.t_ns <= LONGEST_US * 1_000 + FLIP_NS
        )
        goes_on = (is_led or is_second) and not one.is_blanked
        if not goes_on and 1 << output in sides:
            found.append(one.t_ns)
        may_lead = one.is_probe and not one.is_blanked and not goes_on
        may_be_reversed = not one.is_blanked and not (goes_on and is_second)
    return found


SIDES = [(0b1, 0b1110), (0b1110, 0b1), (0b1, 0b10), (0b10, 0b1), (0b10, 0b1101), (0b1101, 0b10)]
messages = st.lists(
    st.tuples(
        st.sampled_from(SIDES),
        st.sampled_from(["", "flip", "let go", "safe"]),
        st.sampled_from([0, 1, FLIP_NS, FLIP_NS + 200_000, 20 * MS, 300 * MS]) | st.integers(0, MS),
        st.booleans(),
        st.booleans(),
    ),
    max_size=60,
)


@settings(deadline=None, max_examples=300)
@given(messages=messages)
def test_no_output_that_is_alone_begins_more_visits_than_the_rate_in_any_second(
    messages: list[tuple[tuple[int, int], str, int, bool, bool]],
) -> None:
    wires, sent = Wires(), list[Sent]()
    for (source, ground), move, waits_ns, is_probe, is_blanked in messages:
        if move == "flip":
            wires.flip()
        elif move == "let go":
            wires.let_go()
        elif move == "safe":
            wires.rule.reset()
            wires.let_go()
        wires.now_ns += waits_ns
        try:
            wires.send(source, ground, is_probe=is_probe, is_blanked=is_blanked)
        except GuardRefusal:
            continue
        sent.append(
            Sent(source, ground, is_probe, is_blanked, wires.now_ns, wires.watch.edge_count)
        )
    for output in (0, 1):
        begun_ns = begins_ns(sent, output)
        for first_ns, one_too_many_ns in zip(begun_ns, begun_ns[RATE_HZ:], strict=False):
            assert one_too_many_ns - first_ns >= SECOND_NS


#: What happens before a message, how long it waits then, and what it is.
actions = st.lists(
    st.tuples(
        st.sampled_from(["", "flip", "again", "the other way", "another", "safe"]),
        st.sampled_from([0, 0, 500_000, 3 * MS, 20 * MS, 300 * MS]),
        st.sampled_from([PROBE, PULSE]),
    ),
    max_size=25,
)


def fire(rig: BoardRig, output: int, way: bool, what: tuple[int, int]) -> None:
    fire_phase(rig.board, rig.board.pulse(*what), rig.board.selection(output, None), way, *what)


def connect(rig: BoardRig, output: int, way: bool) -> None:
    selection = rig.board.selection(output, None)
    rig.board.prepare(selection)
    rig.board.connect(selection, way)


def visits_ns(rig: BoardRig, phases: list[Phase], output: int) -> list[int]:
    """When they began, by the wires: what follows so late, or with other moves, is another one.
    Twice as late as the guard allows, because what is sent lasts less than its worst.
    """
    is_relays = rig.file.switch.chip == "74HC595"
    names = ("LE",) if is_relays else ("POL", "BL", "LE", "CLK", "DATA")
    watched = [rig.file.used_lines()[name] for name in names]
    times = [
        entry["t_ns"]
        for entry in rig.records()
        if entry["bus"] == "gpio" and entry["line"] in watched and (entry["value"] or not is_relays)
    ]
    late_ns = 2 * longest_flip_ns(rig.file, rig.board.machine)
    found, may_lead, may_be_reversed = [], False, False
    for number, phase in enumerate(phases):
        before = phases[number - 1] if number else phase
        moves = sum(before.to_ns <= t_ns <= phase.from_ns for t_ns in times)
        sides = (phase.source, phase.ground)
        is_led = may_lead and moves == 0 and sides == (before.source, before.ground)
        is_second = (
            may_be_reversed
            and moves == (2 if is_relays else 1)
            and sides == (before.ground, before.source)
            and phase.from_ns - before.to_ns <= late_ns
        )
        if not (is_led or is_second) and phase.electrode == output:
            found.append(phase.from_ns)
        may_lead = phase.current_ua < 310 and not (is_led or is_second)
        may_be_reversed = not is_second
    return found


@pytest.mark.parametrize("name", [HALF_BRIDGES, RELAYS])
@settings(
    deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(actions=actions)
def test_on_the_wires_no_electrode_has_more_visits_than_the_rate_in_any_second(
    name: str, actions: list[tuple[str, int, tuple[int, int]]]
) -> None:
    rig = board_rig(board=changed(shipped_board(name), "maxima", rate_hz=RATE_HZ))
    rig.begin()
    output, way, rules = 3, True, set[str]()
    connect(rig, output, way)
    for before, waits_ns, what in actions:
        if before == "flip":
            way = not way
            rig.board.flip(rig.board.selection(output, None), way)
        elif before == "safe":
            assert rig.board.safe_off() == ()
            rig.board.supply_on()
            rig.board.guard.permit(rig.file.maxima.current_ua)
        elif before:
            rig.board.discharge()
            output = 7 - output if before == "another" else output
            way = not way if before == "the other way" else way
        if before not in ("", "flip"):
            rig.clock.spend(waits_ns)
            connect(rig, output, way)
        else:
            rig.clock.spend(waits_ns)
        try:
            fire(rig, output, way, what)
        except GuardRefusal as refusal:
            rules.add(refusal.rule)
    assert rules <= {"rate"}
    assert rig.board.safe_off() == ()
    phases = decode(rig.stepped.trace_lines())
    for one in (3, 4):
        begun_ns = visits_ns(rig, phases, one)
        for first_ns, one_too_many_ns in zip(begun_ns, begun_ns[RATE_HZ:], strict=False):
            # The guard looks a little before a message begins.
            assert one_too_many_ns - first_ns >= SECOND_NS - MS
