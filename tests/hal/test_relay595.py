"""Relays on the wire: break before make, and never both of one electrode."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_rig import BoardRig, changed
from etd_body.interface import Side
from etd_hal.boardfile import Relays
from etd_hal.chips.relay595 import RelaySwitch
from etd_hal.errors import BoardFault, BusError, CannotSelect
from etd_hal.fake.faults import LostClock
from plain_records import told
from stepped_board import shipped_board, stepped_board

Boards = Callable[..., BoardRig]
NAME = "feetthrough-relay"
#: Allowance for the time between a call's edge and its return.
CALL_NS = 4_400


def switch(on_bit: int = 0) -> tuple[RelaySwitch, Relays]:
    stepped = stepped_board(NAME)
    file = stepped.board.switch
    assert isinstance(file, Relays)
    turned = msgspec.structs.replace(file, on_bit=on_bit, return_bit=1 - on_bit)
    return RelaySwitch(stepped.backend.gpio, stepped.clock, turned, None), turned


def copied_words(rig: BoardRig, count: int = 0) -> list[tuple[int, int]]:
    """(time, word) of each copy to the outputs, decoded from DATA, CLK and LE alone."""
    names, levels, register, copied = rig.names(), dict.fromkeys(("DATA", "CLK", "LE"), 0), 0, []
    for record in rig.records():
        name = names.get(record.get("line", -1), "")
        if record["bus"] != "gpio" or name not in levels:
            continue
        rises = record["value"] and not levels[name]
        levels[name] = record["value"]
        if name == "CLK" and rises:
            register = (register << 1 | levels["DATA"]) & (1 << 64) - 1
        elif name == "LE" and rises:
            copied.append((record["t_ns"], register))
    return copied[count:]


@pytest.mark.parametrize(
    ("on_bit", "on_source", "on_ground", "word"),
    [
        (0, 0b001, 0b010, 0b00_10_01),
        (1, 0b001, 0b010, 0b00_01_10),
        (0, 0b100, 0b011, 0b01_10_10),
        (0, 0, 0, 0),
    ],
)
def test_an_electrode_has_one_bit_to_the_source_and_one_to_ground(
    on_bit: int, on_source: int, on_ground: int, word: int
) -> None:
    assert switch(on_bit)[0].word(on_source, on_ground) == word


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_no_word_closes_both_relays_of_an_electrode(on_source: int, on_ground: int) -> None:
    driver, _ = switch()
    if on_source & on_ground:
        with pytest.raises(ValueError, match="source and ground at once"):
            driver.word(on_source, on_ground)
    else:
        word = driver.word(on_source, on_ground)
        assert word & word >> 1 & 0x5555_5555_5555_5555 == 0
        assert word.bit_count() == on_source.bit_count() + on_ground.bit_count()


@pytest.mark.parametrize("phases", [(True,), (False,), (True, False), (False, True)])
def test_every_closing_comes_after_all_have_been_open_for_long_enough(
    boards: Boards, phases: tuple[bool, ...]
) -> None:
    rig = boards(NAME)
    for output in (0, 1, 31, 1):
        rig.visit(output, *phases)
    rig.board.release()
    copies = copied_words(rig)
    assert copies[-1][1] == 0
    closings = [index for index, (_, word) in enumerate(copies) if word]
    assert len(closings) == 4 * len(phases)
    for index in closings:
        assert copies[index - 1][1] == 0
        assert copies[index][0] - copies[index - 1][0] >= 1_000 * 1_000


def test_current_flows_only_when_the_relays_have_closed(boards: Boards) -> None:
    rig = boards(NAME)
    for output in (4, 9):
        rig.visit(output)
        closed_ns = copied_words(rig)[-1][0]
        assert rig.body()[-1]["from_ns"] - closed_ns >= 1_000 * 1_000


@pytest.mark.parametrize(("is_anodic", "alone", "others"), [
    (True, Side.SOURCE, Side.GROUND), (False, Side.GROUND, Side.SOURCE),
])  # fmt: skip
def test_a_ring_leaves_the_rest_open(
    boards: Boards, is_anodic: bool, alone: Side, others: Side
) -> None:
    rig = boards(NAME)
    rig.visit(9, is_anodic, returns=(8, 10, 1, 17))
    sides = rig.sides
    assert sides[9] == alone
    assert {sides[electrode] for electrode in (8, 10, 1, 17)} == {others}
    assert sides.count(Side.OPEN) == 32 - 5
    rig.board.release()
    assert set(rig.sides) == {Side.OPEN}


def test_without_a_choice_all_others_return(boards: Boards) -> None:
    rig = boards(NAME)
    rig.visit(9)
    assert rig.sides.count(Side.GROUND) == 31


def test_a_biphasic_pulse_goes_through_all_open(boards: Boards) -> None:
    rig = boards(NAME)
    before = len(copied_words(rig))
    rig.visit(2, True, False, returns=(3, 4))
    there, back = 0b10_10_01 << 4, 0b01_01_10 << 4
    assert [word for _, word in copied_words(rig, before)] == [there, 0, back]
    assert [entry["asked_ua"] > 0 for entry in rig.body()] == [True, False]


def test_the_same_selection_again_goes_through_all_open(boards: Boards) -> None:
    """With all open a current at code 0 is told from the charge of the skin."""
    rig = boards(NAME)
    rig.visit(2, returns=(3,))
    before = len(copied_words(rig))
    rig.visit(2, returns=(3,))
    there = 0b10_01 << 4
    assert [word for _, word in copied_words(rig, before)] == [0, there]
    assert len(rig.body()) == 2


def test_a_whole_prepare_rewrites_even_the_same_selection(boards: Boards) -> None:
    rig = boards(NAME)
    rig.visit(2, returns=(3,))
    before = len(rig.records())
    rig.visit(2, returns=(3,), whole=True)
    assert len(rig.times("CLK", 1, before)) >= 64
    assert len(rig.body()) == 2


def test_a_whole_prepare_rewrites_open_relays_too(boards: Boards) -> None:
    rig = boards(NAME)
    rig.visit(2, returns=(3,))
    rig.board.release()
    before = len(rig.records())
    rig.visit(2, returns=(3,), whole=True)
    assert len(rig.times("CLK", 1, before)) >= 64


def test_what_power_up_left_in_the_register_is_opened_before_the_supply(boards: Boards) -> None:
    rig = boards(NAME, begun=False)
    assert set(rig.sides) != {Side.OPEN}
    assert rig.board.safe_off() == ()
    assert set(rig.sides) == {Side.OPEN}
    assert rig.times("HV", 1) == []


def test_a_lost_clock_is_found_where_the_last_stage_is_read_back(boards: Boards) -> None:
    rig = boards(board=changed(shipped_board(NAME), "guards", readback=18))
    rig.visit(0, returns=(1,), whole=True)
    rig.board.release()
    rig.board.prepare(rig.board.selection(2, (3,)), whole=False)
    rig.fake.world.put_in(LostClock(at_edge=6))
    rig.board.connect(rig.board.selection(2, (3,)), True)
    with pytest.raises(BoardFault, match="readback"):
        rig.visit(2, returns=(3,), whole=True)
    assert rig.board.safe_off() == ()


def calls_at_the_copies(boards: Boards) -> list[int]:
    """The calls of a second visit that move LE, and their neighbours, counted from its start."""
    rig = boards(NAME)
    rig.visit(2, returns=(3,))
    before = rig.gpio.calls
    rig.visit(5, returns=(3,))
    sent, le = rig.gpio.sent[before:], rig.file.switch.lines.LE
    moving = [index for index, changes in enumerate(sent) if dict(changes).keys() == {le}]
    near = {index + offset for index in moving for offset in (-2, -1, 0, 1)}
    return sorted(near & set(range(len(sent))))


def test_after_any_failed_call_at_a_copy_safe_off_still_opens_the_relays(boards: Boards) -> None:
    calls = calls_at_the_copies(boards)
    assert len(calls) > 6
    for call in calls:
        rig = boards(NAME)
        rig.visit(2, returns=(3,))
        rig.gpio.fails = frozenset({rig.gpio.calls + call})
        with pytest.raises(BusError):
            rig.visit(5, returns=(3,))
        assert rig.board.safe_off() == ()
        assert set(rig.sides) == {Side.OPEN}


def test_after_a_failed_copy_the_selection_before_it_does_not_count_as_closed(
    boards: Boards,
) -> None:
    first_copy = calls_at_the_copies(boards)[2]
    rig = boards(NAME)
    rig.visit(2, returns=(3,))
    rig.gpio.fails = frozenset({rig.gpio.calls + first_copy})
    with pytest.raises(BusError):
        rig.visit(5, returns=(3,))
    before = len(copied_words(rig))
    rig.board.switch.connect(rig.board.selection(2, (3,)), True)
    assert [word for _, word in copied_words(rig, before)] == [0, 0b10_01 << 4]


def test_an_electrode_among_its_own_returns_cannot_be_selected(boards: Boards) -> None:
    with pytest.raises(CannotSelect, match="among its own returns") as caught:
        boards(NAME).board.selection(4, (3, 4))
    assert caught.value.output == 4


def test_a_return_named_twice_is_that_return(boards: Boards) -> None:
    board = boards(NAME).board
    assert told(board.selection(4, (2, 2))) == told(board.selection(4, (2,)))


@pytest.mark.parametrize("returns", [(32,), (3, -1)])
def test_a_return_that_is_not_there_cannot_be_selected(
    boards: Boards, returns: tuple[int, ...]
) -> None:
    with pytest.raises(CannotSelect, match="the board has 32") as caught:
        boards(NAME).board.selection(4, returns)
    assert caught.value.output == returns[-1]


def test_an_electrode_without_any_return_cannot_be_selected(boards: Boards) -> None:
    with pytest.raises(CannotSelect, match="it has no return"):
        boards(NAME).board.selection(4, ())
