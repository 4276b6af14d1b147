"""The truth table of half-bridges: what BL and POL do beyond their pins, by a load to ground."""

from __future__ import annotations

from typing import Any

import pytest

from etd.files.resources import find, names
from etd.selftest.report import Check, Report
from etd_hal.boardfile import HalfBridges, load_board
from etd_hal.fake.faults import (
    Bridge,
    Fault,
    LineCut,
    LineInverted,
    LinesSwapped,
    OutputsSwapped,
    StuckBehind,
    SwitchOutput,
)
from selftest_rig import LOAD_OHM, SelftestRig, bad, by_name, selftest_rig

HALF_BRIDGES = [
    name
    for name in names("boards")
    if isinstance(load_board(find("boards", name)).switch, HalfBridges)
]
SECOND = 1_000_000_000

FAULTS: list[tuple[Fault, str]] = [
    (LinesSwapped("BL", "POL"), "BL and POL are swapped"),
    (LineInverted("POL"), "POL is inverted"),
    (LineInverted("BL"), "BL is inverted"),
    (StuckBehind("POL", 0), "POL is stuck at 0"),
    (StuckBehind("POL", 1), "POL is stuck at 1"),
    (StuckBehind("BL", 0), "BL is stuck at 0"),
    (StuckBehind("BL", 1), "BL is stuck at 1"),
]


def table_of(report: Report) -> Check:
    return by_name(report)["truth_table"]


@pytest.mark.parametrize(("fault", "said"), FAULTS, ids=[said for _, said in FAULTS])
@pytest.mark.parametrize("board", HALF_BRIDGES)
def test_each_fault_of_bl_and_pol_fails_by_a_sentence_that_says_which(
    board: str, fault: Fault, said: str
) -> None:
    rig = selftest_rig(board, faults=[fault])
    report = rig.run()
    failed = [check for check in report.checks if check.result == "fail"]
    assert [(check.stage, check.name) for check in failed if check.stage != "end"] == [
        ("table", "truth_table")
    ]
    assert table_of(report).measured.startswith(f"{said} beyond the pin")
    assert all(other not in table_of(report).measured for _, other in FAULTS if other != said)
    assert rig.most_charge_nc <= report.bound.charge_nc


@pytest.mark.parametrize("board", HALF_BRIDGES)
def test_a_board_in_order_passes_and_has_its_load_back_afterwards(board: str) -> None:
    rig = selftest_rig(board, second_ohm=None)
    report = rig.run()
    assert bad(report) == []
    assert (table_of(report).result, table_of(report).stage) == ("pass", "table")


def test_a_pol_wire_that_is_cut_is_where_its_pull_holds_it() -> None:
    report = selftest_rig(faults=[LineCut("POL")]).run()
    assert bad(report) == [("table", "truth_table")]
    assert "POL is stuck at 1" in table_of(report).measured


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ([SwitchOutput(1, "open")], "the load draws no current"),
        ([OutputsSwapped(1, 2)], "electrode 2 answers where electrode 1 should"),
        ([Bridge(1, 2)], "the load is still between electrodes 1 and 2"),
        (
            [LineInverted("POL"), LineInverted("BL")],
            "commanded BL 0 POL 1, the outputs are as with BL 1 POL 0;"
            " BL 1 POL 0 as with BL 0 POL 1; BL 1 POL 1 as with BL 0 POL 0",
        ),
    ],
)
def test_what_is_no_single_fault_of_the_two_lines_is_described(
    faults: list[Fault], said: str
) -> None:
    report = selftest_rig(faults=faults).run()
    assert ("table", "truth_table") in bad(report)
    assert said in table_of(report).measured


def test_without_a_load_or_a_hand_it_is_a_skip_and_relays_have_no_such_table() -> None:
    no_load = table_of(selftest_rig(load_ohm=None).run())
    assert (no_load.result, no_load.measured) == ("skip", "no dummy load")
    no_hand = table_of(selftest_rig(has_operator=False, second_ohm=None).run())
    assert (no_hand.result, no_hand.measured) == ("skip", "no operator to move the load")
    assert table_of(selftest_rig("feetthrough-relay", load_ohm=None).run()).result == "absent"


class Hand:
    """Does what is asked, the move to ground after so many seconds, and perhaps never back."""

    def __init__(self, rig: SelftestRig, after_s: float, *, comes_back: bool = True) -> None:
        self._rig, self._hand, self._after_s = rig, rig.operator, after_s
        self._comes_back = comes_back
        self._is_grounded = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hand, name)

    def ground(self, load_ohm: int, electrode: int) -> None:
        assert self._hand is not None
        hand = self._hand
        at_ns = self._rig.clock.now_ns() + int(self._after_s * SECOND)
        self._rig.clock.at(at_ns, lambda: hand.ground(load_ohm, electrode))
        self._is_grounded = True

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        assert self._hand is not None
        if self._comes_back or not self._is_grounded:
            self._hand.clip(load_ohm, first, second)


@pytest.mark.parametrize(("after_s", "is_good"), [(5.0, True), (29.0, True), (40.0, False)])
def test_a_hand_may_take_its_time_and_a_load_that_did_not_move_is_named(
    after_s: float, is_good: bool
) -> None:
    rig = selftest_rig(second_ohm=None)
    rig.operator = Hand(rig, after_s)
    report = rig.run()
    assert (table_of(report).result == "pass") is is_good
    assert is_good or "the load is still between electrodes 1 and 2" in table_of(report).measured


@pytest.mark.parametrize(("fault", "said"), FAULTS, ids=[said for _, said in FAULTS])
def test_a_fault_is_told_when_the_load_has_come_and_not_before(fault: Fault, said: str) -> None:
    """Between two electrodes the load reads alike with some of the faults."""
    rig = selftest_rig(faults=[fault])
    rig.operator = Hand(rig, 9.0)
    begun_ns = rig.clock.now_ns()
    assert said in table_of(rig.run()).measured
    assert rig.clock.now_ns() - begun_ns > 9 * SECOND


def test_a_load_that_does_not_come_back_ends_the_stage() -> None:
    rig = selftest_rig()
    rig.operator = Hand(rig, 0.5, comes_back=False)
    report = rig.run()
    assert bad(report) == [("table", "load_back")]
    assert (
        f"{LOAD_OHM} ohm between electrodes 1 and 2 again" in by_name(report)["load_back"].expected
    )


def test_nothing_is_commanded_that_puts_all_outputs_on_the_source() -> None:
    rig = selftest_rig(second_ohm=None)
    rig.run()
    assert rig.fake.violations == []
