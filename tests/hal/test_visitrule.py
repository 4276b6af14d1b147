"""The rule of visits: its states one by one, and what no sequence may win."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from board_rig import BoardRig, board_rig, changed, fire_phase, machine_file
from etd_hal.boardfile import HalfBridges, Relays
from etd_hal.errors import GuardRefusal
from etd_hal.switch_shadow import Approval, HalfBridgeShadow
from etd_hal.visitrule import VisitRule, VisitState, longest_flip_ns
from stepped_board import shipped_board
from trace_decoder import Phase, decode

pytestmark = pytest.mark.slow

MS = 1_000_000
SECOND_NS = 1_000 * MS
RATE_HZ = 3
HALF_BRIDGES, RELAYS = "kajimoto-hv507", "feetthrough-relay"
PROBE, PULSE = (300, 50), (1_000, 100)
#: What is sent is told to last so long, at worst.
LONGEST_US = 130.0
FLIP_NS = longest_flip_ns(shipped_board(HALF_BRIDGES), machine_file())


class Wires:
    """The rule, and the watch that it goes by, moved line by line."""

    def __init__(self) -> None:
        switch = shipped_board(HALF_BRIDGES).switch
        assert isinstance(switch, HalfBridges)
        self.lines = switch.lines
        self.watch = HalfBridgeShadow(switch, None)
        self.rule = VisitRule(RATE_HZ, FLIP_NS, self.watch)
        self.watch.follow(((self.lines.BL, 1),))
        self.now_ns = 7 * SECOND_NS
        self.pol = 1

    def flip(self) -> None:
        self.pol = 1 - self.pol
        self.watch.follow(((self.lines.POL, self.pol),))

    def let_go(self) -> None:
        """Blanked, and un-blanked again as it was."""
        for line, value in (
            *((self.lines.POL, 1), (self.lines.BL, 0)),
            *((self.lines.BL, 1), (self.lines.POL, self.pol)),
        ):
            self.watch.follow(((line, value),))

    def send(
        self, source: int, ground: int, *, is_probe: bool = False, is_blanked: bool = False
    ) -> None:
        approval = Approval(source, ground, 1_000, 100, is_blanked=is_blanked)
        self.rule.take(approval, LONGEST_US, 100.0, is_probe, self.now_ns)

    def room(self, output: int) -> int:
        """How many visits an output may still have now; afterwards it has none."""
        for found in range(RATE_HZ + 1):
            try:
                # Blanked ones begin a visit, whatever was before.
                self.send(1 << output, 1 << 40 | 1 << 41, is_blanked=True)
            except GuardRefusal:
                return found
        raise AssertionError("more than the rate")


ONE, OTHERS = 0b1, 0b1110


@pytest.mark.parametrize(("is_probe", "state"), [(True, "probed"), (False, "fired")])
def test_what_begins_a_visit_is_counted(is_probe: bool, state: VisitState) -> None:
    wires = Wires()
    assert wires.rule.state == "idle"
    wires.send(ONE, OTHERS, is_probe=is_probe)
    assert wires.rule.state == state
    assert wires.room(0) == RATE_HZ - 1


def test_a_blanked_probe_is_counted_and_nothing_goes_on_with_it() -> None:
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=True, is_blanked=True)
    assert wires.rule.state == "idle"
    wires.flip()
    wires.send(OTHERS, ONE)
    assert wires.room(0) == RATE_HZ - 2


@pytest.mark.parametrize(
    ("source", "is_blanked", "visits"), [(ONE, True, 3), (0, True, 2), (0, False, 2)]
)
def test_a_probe_that_reaches_no_electrode_ends_the_visit_of_one_that_did(
    source: int, is_blanked: bool, visits: int
) -> None:
    """It counts where an output is selected behind the blanking, and not where none is."""
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=True)
    wires.send(source, OTHERS if source else 0, is_probe=True, is_blanked=is_blanked)
    assert wires.rule.state == "idle"
    wires.send(ONE, OTHERS)
    assert wires.room(0) == RATE_HZ - visits


def test_a_visit_counts_for_a_second_and_not_for_longer() -> None:
    wires = Wires()
    for _ in range(RATE_HZ):
        wires.send(ONE, OTHERS)
    wires.now_ns += SECOND_NS - 1
    with pytest.raises(GuardRefusal, match="4 pulses in a second, allowed is 3"):
        wires.send(ONE, OTHERS)
    wires.now_ns += 1
    wires.send(ONE, OTHERS)
    assert wires.room(0) == RATE_HZ - 1


@pytest.mark.parametrize("is_probe", [True, False])
def test_a_blanked_probe_is_no_second_phase(is_probe: bool) -> None:
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=is_probe)
    wires.flip()
    wires.send(OTHERS, ONE, is_probe=True, is_blanked=True)
    assert wires.room(0) == RATE_HZ - 2


def test_a_pulse_behind_a_probe_counts_with_it_and_so_does_its_charge() -> None:
    wires = Wires()
    pulse = Approval(ONE, OTHERS, 1_000, 100)
    wires.send(ONE, OTHERS, is_probe=True)
    assert wires.rule.probe_nc(pulse) == 100.0
    wires.now_ns += SECOND_NS // 2
    wires.send(ONE, OTHERS)
    assert wires.rule.state == "fired"
    assert wires.rule.probe_nc(pulse) == 0.0
    assert wires.room(0) == RATE_HZ - 1


def test_a_pulse_behind_a_probe_that_was_let_go_is_a_visit_of_its_own() -> None:
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=True)
    wires.let_go()
    assert wires.rule.probe_nc(Approval(ONE, OTHERS, 1_000, 100)) == 0.0
    wires.send(ONE, OTHERS)
    assert wires.room(0) == RATE_HZ - 2


@pytest.mark.parametrize("is_probe", [True, False])
@pytest.mark.parametrize(("late_ns", "counts"), [(0, 1), (1, 2)])
def test_the_reverse_is_the_second_phase_until_its_time_is_over(
    is_probe: bool, late_ns: int, counts: int
) -> None:
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=is_probe)
    wires.flip()
    wires.now_ns += int(LONGEST_US * 1_000) + FLIP_NS + late_ns
    wires.send(OTHERS, ONE)
    assert wires.rule.state == ("idle" if counts == 1 else "fired")
    assert wires.room(0) == RATE_HZ - counts


def test_what_comes_behind_a_second_phase_begins_a_visit() -> None:
    wires = Wires()
    for _ in range(2):
        wires.send(ONE, OTHERS)
        wires.flip()
        wires.send(OTHERS, ONE)
        wires.flip()
    assert wires.room(0) == RATE_HZ - 2


@pytest.mark.parametrize(("source", "ground"), [(OTHERS, 1 << 5), (OTHERS - 0b10, ONE)])
def test_after_a_flip_other_outputs_than_before_are_a_visit_of_their_own(
    source: int, ground: int
) -> None:
    wires = Wires()
    wires.send(ONE, OTHERS)
    wires.flip()
    wires.send(source, ground)
    assert wires.rule.state == "fired"
    assert wires.room(0) + wires.room(5) == 2 * RATE_HZ - 2


@pytest.mark.parametrize("between", ["nothing", "let go", "three flips"])
def test_the_reverse_without_one_flip_and_nothing_else_is_a_visit_of_its_own(between: str) -> None:
    wires = Wires()
    wires.send(ONE, OTHERS)
    if between == "let go":
        wires.let_go()
        wires.flip()
    for _ in range(3 if between == "three flips" else 0):
        wires.flip()
    wires.send(OTHERS, ONE)
    assert wires.room(0) == RATE_HZ - 2


def test_what_is_refused_changes_nothing() -> None:
    """Nothing of it was sent: what was under way is under way still."""
    wires = Wires()
    assert wires.room(3) == RATE_HZ
    wires.send(ONE, 0b110)
    with pytest.raises(GuardRefusal, match="rate"):
        wires.send(0b10, 1 << 3)
    wires.flip()
    wires.send(0b110, ONE)
    assert wires.room(0) == RATE_HZ - 1
    assert wires.room(1) == RATE_HZ


@pytest.mark.parametrize("is_probe", [False, True])
def test_a_safe_state_ends_a_visit_and_keeps_the_count(is_probe: bool) -> None:
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=is_probe)
    wires.rule.reset()
    if not is_probe:
        wires.flip()
    wires.send(*((ONE, OTHERS) if is_probe else (OTHERS, ONE)))
    assert wires.room(0) == RATE_HZ - 2


@pytest.mark.parametrize(("source", "ground"), [(1 << 5, OTHERS), (ONE, OTHERS - 0b10)])
def test_behind_a_probe_other_outputs_begin_a_visit_though_nothing_has_moved(
    source: int, ground: int
) -> None:
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=True)
    wires.send(source, ground)
    assert wires.room(0) + wires.room(5) == 2 * RATE_HZ - 2


def test_the_charge_of_a_probe_counts_to_no_blanked_one() -> None:
    wires = Wires()
    wires.send(ONE, OTHERS, is_probe=True)
    assert wires.rule.probe_nc(Approval(ONE, OTHERS, 1_000, 100)) == 100.0
    assert wires.rule.probe_nc(Approval(ONE, OTHERS, 1_000, 100, is_blanked=True)) == 0.0


def test_of_one_against_one_both_are_counted() -> None:
    wires = Wires()
    wires.send(0b1, 0b10)
    assert (wires.room(0), wires.room(1)) == (RATE_HZ - 1, RATE_HZ - 1)


def test_a_message_for_nobody_alone_is_refused() -> None:
    with pytest.raises(GuardRefusal, match="no output alone on its side") as caught:
        Wires().send(0b11, 0b1100, is_probe=True, is_blanked=True)
    assert caught.value.rule == "visit"


def test_a_flip_of_half_bridges_is_a_call_and_one_of_relays_two_words_and_both_settlings() -> None:
    """And a millisecond, and what a message takes besides its transfers."""
    machine, relays = machine_file(), shipped_board(RELAYS)
    assert longest_flip_ns(shipped_board(HALF_BRIDGES), machine) == pytest.approx(
        (1_000 + 40 + 2 * 4.4) * 1_000
    )
    assert isinstance(relays.switch, Relays)
    assert longest_flip_ns(relays, machine) == pytest.approx(
        (1_000 + 40 + 2_000 + 2 * (4 * 64 + 4) * 4.4) * 1_000
    )


# --- any sequence ---------------------------------------------------------------------------------


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
