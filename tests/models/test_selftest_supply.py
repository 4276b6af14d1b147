"""The supply in a self-test: its heartbeat, and what is left of it after the process was killed."""

from __future__ import annotations

from typing import Literal

import msgspec
import pytest

from board_rig import changed
from etd.files.configuration import fake_config
from etd.selftest.fixture import Fixture
from etd.selftest.report import Check
from etd.selftest.run import run
from etd_hal.boardfile import Heartbeat
from etd_hal.fake.faults import (
    Fault,
    HeartbeatByLevel,
    HeartbeatIgnored,
    HeartbeatRearms,
    I2cFailure,
    RailOff,
    SpiError,
)
from selftest_rig import DATE, ChangedUnderstudy, bad, by_name, selftest_rig
from stepped_board import shipped_board


@pytest.mark.parametrize(
    ("faults", "failed"),
    [
        ([], []),
        ([HeartbeatIgnored()], [("rail", "heartbeat")]),
        ([HeartbeatByLevel(0)], [("rail", "heartbeat")]),
        ([HeartbeatByLevel(1)], [("rail", "heartbeat")]),
        ([HeartbeatRearms()], [("rail", "heartbeat_latch")]),
    ],
)
def test_a_heartbeat_is_proved_by_the_node_where_nobody_watches_the_rail(
    faults: list[Fault], failed: list[tuple[str, str]]
) -> None:
    beating = Heartbeat(line=27, window_ms=20)
    file = changed(shipped_board("feetthrough-relay"), "guards", heartbeat=beating)
    report = selftest_rig("feetthrough-relay", file=file, faults=faults).run()
    assert bad(report) == failed
    assert report.passed is not bool(failed)


@pytest.mark.parametrize("board", ["reference-hv507", "feetthrough-relay"])
@pytest.mark.parametrize("level", [0, 1])
def test_the_level_that_holds_a_gate_on_is_told(board: str, level: Literal[0, 1]) -> None:
    file = shipped_board(board)
    file = changed(file, "guards", heartbeat=Heartbeat(line=27, window_ms=20))
    report = selftest_rig(board, file=file, faults=[HeartbeatByLevel(level)]).run()
    found = [check for check in report.checks if check.result == "fail"]
    assert [check.name for check in found] == ["heartbeat"]
    assert found[0].measured.endswith(f"with the line at {level}")


class Undead(ChangedUnderstudy):
    """The process that was killed goes on beating."""

    def kill(self) -> float:
        return 3.0


def test_a_supply_that_outlives_the_program_is_named() -> None:
    """As where a gate takes something else for a beat."""
    rig = selftest_rig()
    rig.let_another_be_killed(Undead)
    failed = [name for _, name in bad(rig.run())]
    assert failed == ["killed_lines", "killed_supply"]


@pytest.mark.parametrize(("has_heartbeat", "failed"), [(True, []), (False, ["killed_lines"])])
def test_lines_that_are_let_go_of_late_are_the_heartbeats_business_if_there_is_one(
    has_heartbeat: bool, failed: list[str]
) -> None:
    class Slow(ChangedUnderstudy):
        def kill(self) -> float:
            return super().kill() + 40.0

    file = fake_config("reference-hv507").board
    if not has_heartbeat:
        file = msgspec.structs.replace(
            file, guards=msgspec.structs.replace(file.guards, heartbeat="absent")
        )
    rig = selftest_rig(file=file)
    rig.let_another_be_killed(Slow)
    assert [name for _, name in bad(rig.run())] == failed


def test_a_process_that_cannot_bring_the_rail_up_is_told() -> None:
    rig = selftest_rig()
    sags = RailOff(0.0)

    class Weak(ChangedUnderstudy):
        def take_over(self) -> None:
            super().take_over()
            rig.fake.world.put_in(sags)

        def step_back(self) -> None:
            rig.fake.world.take_out(sags)
            super().step_back()

    rig.let_another_be_killed(Weak)
    assert bad(rig.run()) == [("rail", "killed_rise")]


def test_a_board_that_is_not_safe_after_the_kill_is_told_as_what_it_is() -> None:
    rig = selftest_rig()

    class Harmful(ChangedUnderstudy):
        def step_back(self) -> None:
            super().step_back()
            rig.fake.world.put_in(SpiError())

    rig.let_another_be_killed(Harmful)
    report = rig.run()
    assert bad(report) == [("rail", "killed_safe_state")]
    assert "cut the supply by hand" in by_name(report)["killed_safe_state"].advice


def test_an_error_while_another_process_has_the_board_ends_with_the_lines_taken_back() -> None:
    rig = selftest_rig()

    class Disturbing(Undead):
        def kill(self) -> float:
            rig.fake.world.put_in(I2cFailure(0x48, "io"))
            return super().kill()

    rig.let_another_be_killed(Disturbing)
    assert bad(rig.run()) == [("rail", "bus")]
    assert not rig.is_understudy_alive
    assert rig.rail_v_after_a_while() < 30.0


def test_a_rail_that_sags_before_the_heartbeat_ends_proves_no_gate() -> None:
    rig = selftest_rig()
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)

    def on_check(check: Check) -> None:
        if check.name == "rise_again":
            rig.fake.world.put_in(RailOff(0.9))
            fixture.wait_ms(3_000)

    report = run(fixture, DATE, on_check=on_check)
    assert bad(report)[:1] == [("rail", "heartbeat")]
    assert by_name(report)["heartbeat"].measured.startswith("from 271 V, below 30.0 V")


@pytest.mark.parametrize(("has_heartbeat", "is_said"), [(True, True), (False, False)])
def test_a_window_that_nobody_can_measure_is_said_in_the_report(
    has_heartbeat: bool, is_said: bool
) -> None:
    beating = Heartbeat(line=27, window_ms=20) if has_heartbeat else "absent"
    file = changed(shipped_board("feetthrough-relay"), "guards", heartbeat=beating)
    report = selftest_rig("feetthrough-relay", file=file, load_ohm=None).run()
    assert any("window is 20 ms" in text for text in report.not_seen) is is_said


def test_a_window_that_a_monitor_measures_is_not_said_to_be_unseen() -> None:
    report = selftest_rig(load_ohm=None).run()
    assert by_name(report)["heartbeat_window"].result == "pass"
    assert not any("window" in text for text in report.not_seen)
