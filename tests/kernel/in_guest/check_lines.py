"""GPIO lines, as the chip's own calls show them: which line, which level, in which order."""

from __future__ import annotations

import pytest

import kernel_trace
import trace_decoder
import trace_rules
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.compose import open_linux
from etd_hal.errors import HardwareMissing
from etd_hal.linesetup import line_setup
from guest_board import BOARD, MACHINE, Chips, trace_header

LINES = BOARD.used_lines()
NAMES = {line: name for name, line in LINES.items()}


def line_calls() -> list[tuple[str, int]]:
    """(name, level) of each call of the chip's set(), in order."""
    found = []
    for event in kernel_trace.events():
        if event.name == "rig_line":
            line, level = map(int, event.rest.split())
            found.append((NAMES[line], level))
    return found


def test_initial_levels_are_set_one_after_another_in_the_order_of_the_request(
    ports: Backend,
) -> None:
    wanted = [(NAMES[line], level) for line, level in line_setup(BOARD).outputs]
    assert line_calls() == 2 * wanted, "they are let go of once, to see what becomes of them"
    assert wanted[:3] == [("POL", 1), ("BL", 0), ("HV", 0)]


def test_lines_of_one_call_change_in_ascending_order_whatever_order_is_given(
    ports: Backend,
) -> None:
    kernel_trace.begin()
    ports.gpio.set(((LINES["CLK"], 1), (LINES["LE"], 0), (LINES["DATA"], 1)))
    assert line_calls() == [("DATA", 1), ("LE", 0), ("CLK", 1)]
    ports.gpio.set(((LINES["CLK"], 0), (LINES["DATA"], 0)))


@pytest.mark.parametrize("output", [0, 1, 31, 63])
def test_a_selection_puts_one_output_on_the_source_and_all_others_on_ground(
    board: Board, output: int
) -> None:
    selection = board.selection(output, None)
    board.prepare(selection, whole=True)
    board.connect(selection, True)
    wires = trace_decoder.Wires(trace_decoder.Facts.of(trace_header()))
    for record in kernel_trace.records(kernel_trace.events(), trace_header())[1:]:
        if record["bus"] == "gpio":
            wires.change(record["t_ns"], record["line"], record["value"])
    everybody = frozenset(range(64))
    assert wires.sides() == (frozenset({output}), everybody - {output})
    assert board.safe_off() == ()


def test_on_the_way_into_inverse_polarity_and_out_nothing_is_ever_all_high(
    board: Board,
) -> None:
    """Two calls in, because in one the lines' numbers would decide, and POL comes before BL."""
    selection = board.selection(5, None)
    kernel_trace.begin()
    assert board.safe_off() == ()
    board.supply_on()
    board.prepare(selection, whole=True)
    board.connect(selection, False)
    board.discharge()
    assert board.safe_off() == ()
    records = kernel_trace.records(kernel_trace.events(), trace_header())
    assert trace_rules.violations(records, BOARD.rest_us) == []


def test_the_next_in_chain_order_takes_a_single_clock_line_by_line(board: Board) -> None:
    first, second = board.selection(5, None), board.selection(6, None)
    board.prepare(first, whole=True)
    board.connect(first, True)
    board.discharge()
    kernel_trace.begin()
    board.prepare(second)
    board.connect(second, True)
    calls = line_calls()
    assert calls.count(("CLK", 1)) == 1
    assert ("DATA", 1) not in calls
    changes = [call for call in calls if call[0] in ("POL", "BL")]
    assert changes[-1] == ("BL", 1)
    assert calls.index(("CLK", 1)) < calls.index(("BL", 1))
    assert board.safe_off() == ()


def test_lines_that_are_held_are_busy_for_a_second_daemon(ports: Backend) -> None:
    kernel_trace.begin()
    with pytest.raises(HardwareMissing) as raised:
        open_linux(BOARD, MACHINE)
    (problem,) = raised.value.problems
    assert "busy" in problem
    assert "POL (4) is held by 'etd'" in problem
    assert line_calls() == [], "a refused request moved a line"


def test_what_becomes_of_lines_that_are_let_go_of_is_told_at_the_start(ports: Backend) -> None:
    (told,) = [fact for fact in ports.facts if fact.startswith("lines: ")]
    assert "the outputs stayed as they were" in told


def test_lines_keep_their_levels_when_they_are_let_go_of(chips: Chips) -> None:
    opened = open_linux(BOARD, MACHINE)
    opened.gpio.set(((LINES["DATA"], 1),))
    opened.close()
    kernel_trace.begin()
    assert line_calls() == []
    again = open_linux(BOARD, MACHINE)
    assert line_calls()[0] == ("POL", 1)
    assert again.gpio.get(LINES["DATA"]) == 0
    again.close()
