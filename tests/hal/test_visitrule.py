"""The rule of visits: its states one by one."""

from __future__ import annotations

import pytest

from board_rig import machine_file
from etd_hal.boardfile import Relays
from etd_hal.errors import GuardRefusal
from etd_hal.switch_shadow import Approval
from etd_hal.visitrule import VisitState, longest_flip_ns
from stepped_board import shipped_board
from visit_wires import FLIP_NS, HALF_BRIDGES, LONGEST_US, RATE_HZ, RELAYS, SECOND_NS, Wires

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
    with pytest.raises(GuardRefusal, match="4 pulses in a second, allowed is 3") as caught:
        wires.send(ONE, OTHERS)
    assert caught.value.rule == "rate"
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
