"""A stop in a self-test: held open it takes the supply away, and pressed it ends the test."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from etd.files.configuration import fake_config
from etd.selftest.report import Report
from etd_hal.bench import StopName
from etd_hal.boardfile import BoardFile
from etd_hal.fake.faults import (
    DacGain,
    StopCutsNothing,
)
from etd_hal.fake.operator import FakeOperator
from selftest_rig import LOAD_OHM, SelftestRig, bad, selftest_rig

BOARDS = ("reference-hv507", "kajimoto-hv507", "feetthrough-relay", "etactilekit-hv513")


def gates(report: Report) -> list[tuple[str, str]]:
    return [
        (check.name, check.result)
        for check in report.checks
        if check.name.endswith(("stop_gate", "stop_off"))
    ]


def with_stops(board: str, cuts: bool) -> BoardFile:
    """A board that has both stops, with a second contact or without."""
    file = fake_config(board).board
    guards = msgspec.structs.replace(
        file.guards, emergency_stop=17, wearer_stop=16, stop_cuts_supply=cuts
    )
    return msgspec.structs.replace(file, guards=guards)


def with_hand(kind: type[FakeOperator]) -> SelftestRig:
    """A board whose operator is of this kind."""
    rig = selftest_rig()
    rig.operator = kind(rig.fake.world, rig.clock)
    rig.operator.clip(LOAD_OHM, 1, 2)
    return rig


@pytest.mark.parametrize("board", BOARDS)
def test_a_stop_that_is_held_is_seen_to_take_the_supply_away(board: str) -> None:
    """By the monitor, or by the node where nobody watches the rail."""
    report = selftest_rig(board, file=with_stops(board, cuts=True)).run()
    assert bad(report) == []
    assert gates(report) == [("emergency_stop_gate", "pass"), ("wearer_stop_gate", "pass")]


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("stop", ["emergency_stop", "wearer_stop"])
def test_a_stop_that_cuts_nothing_is_named_on_every_board(board: str, stop: Any) -> None:
    rig = selftest_rig(board, file=with_stops(board, cuts=True), faults=[StopCutsNothing(stop)])
    assert bad(rig.run())[:1] == [("rail", f"{stop}_gate")]


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("factor", [3.0, 5.0, 24.0])
def test_looking_at_a_stop_by_the_node_keeps_within_the_bound_on_skin(
    board: str, factor: float
) -> None:
    rig = selftest_rig(
        board, file=with_stops(board, cuts=True), faults=[DacGain(factor)], on_skin=True
    )
    report = rig.run()
    assert not report.passed
    assert rig.most_charge_nc <= report.bound.charge_nc


def test_where_the_file_says_that_stops_cut_nothing_the_program_is_seen_to_do_it() -> None:
    report = selftest_rig(file=with_stops("reference-hv507", cuts=False)).run()
    assert bad(report) == []
    assert gates(report) == [
        ("emergency_stop_gate", "absent"),
        ("emergency_stop_off", "pass"),
        ("wearer_stop_gate", "absent"),
        ("wearer_stop_off", "pass"),
    ]


def test_a_stop_that_is_let_go_of_too_early_is_told() -> None:
    class Impatient(FakeOperator):
        def hold(self, stop: StopName) -> None:
            self.press(stop)

    rig = with_hand(Impatient)
    found = [check for check in rig.run().checks if check.result == "fail"]
    assert [check.name for check in found] == ["emergency_stop_gate"]
    assert found[0].measured.startswith("closed again after ")


def test_a_stop_that_stays_open_after_it_was_held_is_named() -> None:
    class Stuck(FakeOperator):
        def let_go(self, stop: StopName) -> None:
            pass

    rig = with_hand(Stuck)
    assert bad(rig.run()) == [("rail", "emergency_stop")]


def test_an_emergency_stop_during_the_test_ends_it() -> None:
    rig = selftest_rig()
    rig.clock.at(rig.clock.now_ns() + 7_000_000_000, lambda: rig.fake.world.press("emergency_stop"))
    report = rig.run()
    assert [name for _, name in bad(report)] == ["emergency_stop"]
    assert rig.fake.dac_code == 0


def test_a_stop_that_is_pressed_in_a_wait_ends_the_supply_at_once() -> None:
    """In the five seconds of hands off; by a line that cuts nothing by itself."""
    cuts_nothing = StopCutsNothing("emergency_stop")
    rig = selftest_rig(file=with_stops("reference-hv507", cuts=False), faults=[cuts_nothing])
    pressed_ns: list[int] = []

    class Pressing(FakeOperator):
        def stand_back(self) -> None:
            pressed_ns.append(rig.clock.now_ns() + 1_000_000_000)
            rig.fake.world.press("emergency_stop", pressed_ns[0])

    rig.operator = Pressing(rig.fake.world, rig.clock)
    rig.operator.clip(LOAD_OHM, 1, 2)
    assert bad(rig.run())[:1] == [("source", "emergency_stop")]
    assert 0 < rig.clock.now_ns() - pressed_ns[0] < 20_000_000
