"""What is wrong behind a chain's register, or in a source above some current, on the fake."""

from __future__ import annotations

from math import exp

import pytest

from board_hand import MS, PAUSE, Hand, pulse
from etd_body.electrode import OPEN_CONTACT, load
from etd_body.interface import Side
from etd_body.minimal import MinimalBody
from etd_hal.board import Board
from etd_hal.boardfile import load_machine
from etd_hal.fake.faults import (
    AlsoSwitches,
    Fault,
    GainAbove,
    OutputSeries,
    OutputsSwapped,
    Saturation,
    SetpointAtPowerUp,
    SourceShort,
    SwitchOutput,
)
from stepped_board import BOARDS, SteppedBoard, shipped_board, stepped_board


def selected(rig: SteppedBoard, output: int, polarity: int = 1) -> set[int]:
    """Who stands on the other side than all the rest."""
    Hand(rig).select(output, polarity)
    alone = Side.SOURCE if polarity else Side.GROUND
    return {electrode for electrode, side in enumerate(rig.fake.sides) if side == alone}


@pytest.mark.parametrize("polarity", [1, 0])
@pytest.mark.parametrize(
    ("faults", "output", "found"),
    [
        ([AlsoSwitches(5, 6)], 5, {5, 6}),
        ([AlsoSwitches(5, 6)], 6, {6}),
        ([OutputsSwapped(5, 9)], 5, {9}),
        ([OutputsSwapped(5, 9)], 9, {5}),
        ([OutputsSwapped(5, 9)], 6, {6}),
        ([OutputsSwapped(5, 9), AlsoSwitches(5, 6)], 5, {9, 6}),
    ],
)
def test_half_bridges_connect_what_they_are_wired_to(
    faults: list[Fault], output: int, polarity: int, found: set[int]
) -> None:
    assert selected(stepped_board(faults=faults), output, polarity) == found


@pytest.mark.parametrize(("polarity", "found"), [(1, {5}), (0, {5, 6})])
def test_half_bridges_may_take_another_one_along_in_one_polarity_alone(
    polarity: int, found: set[int]
) -> None:
    rig = stepped_board(faults=[AlsoSwitches(5, 6, "cathodic")])
    assert selected(rig, 5, polarity) == found
    other = stepped_board(faults=[AlsoSwitches(5, 6, "anodic")])
    assert selected(other, 5, 1 - polarity) == found


def test_an_output_that_stays_is_the_chains_and_not_the_electrodes() -> None:
    rig = stepped_board(faults=[OutputsSwapped(5, 9), SwitchOutput(9, "source")])
    assert selected(rig, 3) == {3, 5}


def relays(*faults: Fault) -> tuple[SteppedBoard, Board]:
    rig = stepped_board("feetthrough-relay", faults=faults)
    machine = load_machine(BOARDS.parent / "machines" / "pi4.toml")
    return rig, Board(
        rig.board, machine, rig.backend.codec, rig.backend.spi, rig.backend.gpio, rig.clock
    )


def connected(rig: SteppedBoard, board: Board, output: int) -> set[int]:
    """Who is on the source, when the relays have moved."""
    selection = board.selection(output, None)
    board.prepare(selection, whole=True)
    board.connect(selection, is_anodic=True)
    rig.clock.spend(10_000_000)
    rig.backend.gpio.edges()
    return {electrode for electrode, side in enumerate(rig.fake.sides) if side == Side.SOURCE}


def test_relays_that_close_together_put_the_source_on_ground() -> None:
    """The other one's relay to ground is closed, as that of all returns."""
    rig, board = relays(AlsoSwitches(5, 6))
    assert connected(rig, board, 6) == {6}
    assert rig.fake.violations == []
    rig.fake.world.put_in(SwitchOutput(0, "open"))
    assert connected(rig, board, 5) == {5, 6}


def test_relays_connect_what_they_are_wired_to_from_when_they_are_swapped() -> None:
    rig, board = relays()
    assert connected(rig, board, 5) == {5}
    rig.fake.world.put_in(OutputsSwapped(5, 9))
    assert connected(rig, board, 6) == {6}
    assert connected(rig, board, 5) == {9}


def test_half_a_switch_is_in_series_with_what_is_put_on_its_electrode_next() -> None:
    body = MinimalBody((OPEN_CONTACT,) * 3, leak_ohm=66_000, compliance_v=300)
    rig = stepped_board(electrodes=(4, 5, 6), body=body, faults=[OutputSeries(5, 15_000)])
    for electrode in range(3):
        rig.fake.world.touch(electrode, load(10_000))
    assert [rig.body.contact(electrode).resistance_ohm for electrode in range(3)] == [
        10_000,
        25_000,
        10_000,
    ]
    rig.fake.world.lift(1)
    assert body.contact(1).kind == "open"


@pytest.mark.parametrize(
    ("fault", "code", "made_ua"),
    [
        (GainAbove(1_000, 2.0), 1_000, 2_442),
        (GainAbove(1_000, 2.0), 1_001, 2 * 2_444.4),
        (Saturation(4_000.0), 1_600, 3_907),
        (Saturation(4_000.0), 1_700, 4_000),
    ],
)
def test_a_source_that_is_wrong_above_some_current(fault: Fault, code: int, made_ua: float) -> None:
    """Into 10 k beside a leak of 66 k, at the end of 30 us."""
    board = shipped_board("kajimoto-hv507")
    body = MinimalBody(
        (load(5_000),) * 2,
        leak_ohm=board.source.leak_ohm,
        compliance_v=board.source.compliance_v,
    )
    rig = stepped_board(electrodes=(0, 1), body=body, faults=[fault])
    Hand(rig).select(0)
    rig.backend.spi.transfer(pulse(code, PAUSE, PAUSE, PAUSE))
    beside_ohm = 1 / (1 / 10_000 + 1 / board.source.leak_ohm)
    through_ua = made_ua * beside_ohm / 10_000
    width_us = rig.events("body")[0]["to_ns"] / 1e3 - rig.events("body")[0]["from_ns"] / 1e3
    assert body.charge_pc(0) == pytest.approx(through_ua * width_us, rel=0.002)


def shorted_source(name: str) -> SteppedBoard:
    """Two electrodes of 5 k, nothing selected yet, the supply on where it can be switched."""
    board = shipped_board(name)
    source = board.source
    body = MinimalBody(
        (load(5_000),) * 2, leak_ohm=source.leak_ohm, compliance_v=source.compliance_v
    )
    rig = stepped_board(name, electrodes=(0, 1), body=body)
    if board.guards.hv_enable != "absent":
        Hand(rig).supply_on()
    rig.fake.world.put_in(SourceShort())
    return rig


def charge_until_now_pc(rig: SteppedBoard) -> float:
    rig.fake.settle()
    rig.body.node_voltage_v(rig.clock.now_ns())
    return rig.body.charge_pc(0)


@pytest.mark.parametrize("name", ["kajimoto-hv507", "reference-hv507"])
def test_a_source_that_is_short_puts_the_rail_on_what_is_selected_whatever_the_dac_says(
    name: str,
) -> None:
    """300 V on 10 k; no word has reached the DAC."""
    rig = shorted_source(name)
    rig.clock.spend(MS)
    assert charge_until_now_pc(rig) == 0.0
    Hand(rig).select(0)
    before_pc = charge_until_now_pc(rig)
    rig.clock.spend(MS)
    assert charge_until_now_pc(rig) - before_pc == pytest.approx(30_000 * 1_000, rel=0.01)
    Hand(rig).discharge()
    through_pc = charge_until_now_pc(rig)
    rig.clock.spend(MS)
    assert charge_until_now_pc(rig) == through_pc


def test_no_one_shot_ends_the_current_of_a_source_that_is_short() -> None:
    rig = shorted_source("reference-hv507")
    Hand(rig).select(0)
    begun_ns, before_pc = rig.clock.now_ns(), charge_until_now_pc(rig)
    rig.backend.spi.transfer(pulse(100, *[PAUSE] * 60))
    lasted_us = (rig.clock.now_ns() - begun_ns) / 1e3
    assert lasted_us > 600
    assert charge_until_now_pc(rig) - before_pc == pytest.approx(30_000 * lasted_us, rel=0.01)


def test_a_source_that_is_short_empties_a_supply_that_was_switched_off() -> None:
    """272 nF at 300 V through 10 k: 82 uC less what its own leak and the string take."""
    rig = shorted_source("reference-hv507")
    hv_enable, hand = rig.board.guards.hv_enable, Hand(rig)
    assert hv_enable != "absent"
    hand.select(0)
    rig.clock.spend(MS)
    rig.backend.gpio.set(((hv_enable.line, 1 - hv_enable.on),))
    before_pc = charge_until_now_pc(rig)
    rig.clock.spend(3 * MS)
    charge_until_now_pc(rig)
    assert rig.fake.world.rail_v() == pytest.approx(300 * exp(-3 / 2.36), rel=0.12)
    rig.clock.spend(50 * MS)
    assert 66e6 < charge_until_now_pc(rig) - before_pc < 82e6


@pytest.mark.parametrize(("stored", "rail_v"), [(0, 150.0), (3_500, 300.0)])
def test_a_supply_rises_to_what_its_set_point_woke_up_with_until_one_is_written(
    stored: int, rail_v: float
) -> None:
    rig = stepped_board("reference-hv507")
    hv_enable, hand = rig.board.guards.hv_enable, Hand(rig)
    assert hv_enable != "absent"
    rig.fake.world.put_in(SetpointAtPowerUp(stored))
    rig.backend.gpio.set(((hv_enable.line, hv_enable.on),))
    hand.beat(500 * MS)
    assert rig.fake.world.rail_v() == pytest.approx(rail_v, rel=0.01)
    hand.supply_on()
    assert rig.fake.world.rail_v() == pytest.approx(300.0, rel=0.01)
