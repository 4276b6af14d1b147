"""A stall of the test itself is no proof of a guard: the supply that it costs is not credited."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from board_rig import changed
from etd.files.configuration import fake_config
from etd.selftest.fixture import Fixture
from etd.selftest.report import Check, Report
from etd.selftest.run import run
from etd_hal.bench import StopName
from etd_hal.boardfile import BoardFile, Heartbeat
from etd_hal.fake.faults import (
    EnableStuck,
    Fault,
    HeartbeatByLevel,
    HeartbeatIgnored,
    HeartbeatRearms,
    HeartbeatSlow,
    RailOff,
    SpiStall,
    StopCutsNothing,
)
from etd_hal.fake.operator import FakeOperator
from selftest_rig import DATE, LOAD_OHM, SelftestRig, bad, selftest_rig
from stepped_board import shipped_board

MS = 1_000_000
RELAY = "feetthrough-relay"
CUTS_NOTHING = [StopCutsNothing("emergency_stop"), StopCutsNothing("wearer_stop")]


def run_stalled(rig: SelftestRig, after: str, stall_ms: int) -> Report:
    """Printing the check of this name takes so long."""

    def on_check(check: Check) -> None:
        if check.name == after:
            rig.clock.spend(stall_ms * MS)

    return run(Fixture(rig.loaded, rig.bench, rig.operator, rig.options), DATE, on_check=on_check)


def measured(report: Report, name: str) -> str:
    return [check.measured for check in report.checks if check.name == name][-1]


def beating_relays(**guards: Any) -> BoardFile:
    return changed(
        shipped_board(RELAY), "guards", heartbeat=Heartbeat(line=27, window_ms=20), **guards
    )


@pytest.mark.parametrize(
    ("faults", "after", "stall_ms", "failed"),
    [
        ([EnableStuck()], "rise", 40, "hv_enable"),
        ([], "rise", 40, "hv_enable"),
        ([HeartbeatIgnored()], "rise_again", 40, "heartbeat"),
        ([], "rise_again", 40, "heartbeat"),
        ([HeartbeatSlow(150)], "rise_again", 200, "heartbeat"),
        ([HeartbeatRearms()], "rise_again", 4_000, "heartbeat"),
        ([HeartbeatByLevel(1)], "rise_between_heartbeats", 40, "heartbeat"),
        ([], "rise_between_heartbeats", 40, "heartbeat"),
        ([], "rise_after_heartbeat", 40, "emergency_stop_gate"),
        (CUTS_NOTHING, "rise_after_heartbeat", 40, "emergency_stop_gate"),
    ],
)
def test_a_stall_of_the_test_is_no_proof_of_a_guard(
    faults: list[Fault], after: str, stall_ms: int, failed: str
) -> None:
    report = run_stalled(selftest_rig(faults=faults), after, stall_ms)
    assert bad(report)[:1] == [("rail", failed)]
    assert "the test missed a heartbeat for " in measured(report, failed)


@pytest.mark.parametrize(
    ("faults", "after", "failed"),
    [
        ([EnableStuck()], "rise", "hv_enable"),
        ([HeartbeatIgnored()], "rise_again", "heartbeat"),
        ([], "rise_again", "heartbeat"),
    ],
)
def test_nor_is_it_where_nobody_watches_the_rail(
    faults: list[Fault], after: str, failed: str
) -> None:
    report = run_stalled(selftest_rig(RELAY, file=beating_relays(), faults=faults), after, 40)
    assert bad(report)[:1] == [("rail", failed)]
    assert "the test missed a heartbeat for " in measured(report, failed)


def test_an_enable_that_switches_nothing_is_not_covered_by_a_heartbeat_that_ends() -> None:
    report = selftest_rig(RELAY, file=beating_relays(), faults=[EnableStuck()]).run()
    assert bad(report) == [("rail", "hv_enable")]


class SlowHand(FakeOperator):
    """The request to hold a stop takes long to be printed."""

    spends_ns = 0

    def hold(self, stop: StopName) -> None:
        self.clock.spend(self.spends_ns)
        super().hold(stop)

    clock: Any


def slow_handed(rig: SelftestRig, stall_ms: int) -> SelftestRig:
    hand = SlowHand(rig.fake.world, rig.clock)
    hand.clock, hand.spends_ns = rig.clock, stall_ms * MS
    assert isinstance(rig.operator, FakeOperator)
    rig.operator.clip(47_000, 1, 2)
    hand.clip(47_000, 1, 2)
    rig.operator = hand
    return rig


@pytest.mark.parametrize("stall_ms", [30, 3_000])
@pytest.mark.parametrize("board", ["reference-hv507", RELAY])
def test_a_stop_that_cuts_nothing_is_not_covered_by_a_stall_while_asking(
    board: str, stall_ms: int
) -> None:
    file = fake_config(board).board if board != RELAY else beating_relays(emergency_stop=17)
    rig = slow_handed(selftest_rig(board, file=file, faults=CUTS_NOTHING), stall_ms)
    report = rig.run()
    assert bad(report)[:1] == [("rail", "emergency_stop_gate")]
    assert "the test missed a heartbeat for " in measured(report, "emergency_stop_gate")


@pytest.mark.parametrize("stall_ms", [0, 5])
def test_asking_for_less_than_the_window_is_no_stall(stall_ms: int) -> None:
    assert bad(slow_handed(selftest_rig(), stall_ms).run()) == []


@pytest.mark.parametrize("board", ["reference-hv507", RELAY])
def test_a_supply_that_was_gone_before_the_stop_opened_proves_nothing(board: str) -> None:
    """Without a heartbeat: by whatever else it went."""
    file = fake_config(board).board
    guards = msgspec.structs.replace(
        file.guards, heartbeat="absent", emergency_stop=17, wearer_stop="absent"
    )
    rig = selftest_rig(board, file=msgspec.structs.replace(file, guards=guards))

    class Late(FakeOperator):
        def hold(self, stop: StopName) -> None:
            rig.fake.world.put_in(RailOff(0.0))
            rig.clock.spend(4_000 * MS)
            super().hold(stop)

    rig.operator = Late(rig.fake.world, rig.clock)
    rig.operator.clip(LOAD_OHM, 1, 2)
    report = rig.run()
    assert bad(report)[:1] == [("rail", "emergency_stop_gate")]
    assert measured(report, "emergency_stop_gate").startswith(
        "the supply fell before the stop opened"
    )


@pytest.mark.parametrize(
    ("board", "stall_us", "result"),
    [
        ("reference-hv507", 290, "pass"),
        ("kajimoto-hv507", 180, "pass"),
        ("kajimoto-hv507", 190, "fail"),
        ("kajimoto-hv507", 290, "fail"),
    ],
)
def test_a_pulse_that_would_be_too_much_for_a_person_for_as_long_is_no_pass(
    board: str, stall_us: int, result: str
) -> None:
    """8 mA for 187 us more than planned, after 500 nC, are 2 000 nC; a one-shot ends it before."""
    alone = selftest_rig(board, second_ohm=None)
    report = alone.run()
    assert measured(report, "longest_message") == "over the plan: probes 0 us, into the load 0 us"
    rig = selftest_rig(board, second_ohm=None)
    stall = SpiStall(stall_us, at_message=1)
    rig.watch.before_pulse = {alone.watch.pulses: lambda: rig.fake.world.put_in(stall)}
    found = [check for check in rig.run().checks if check.name == "longest_message"]
    said = f"over the plan: probes 0 us, into the load {stall_us} us"
    assert [(check.result, check.measured) for check in found] == [(result, said)]
