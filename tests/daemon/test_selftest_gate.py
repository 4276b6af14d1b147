"""The engine and the last self-test: arming is refused by the name of the check."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from engine_rig import make
from etd.files.configuration import fake_config
from etd.files.paths import selftest_file
from etd.protocol.link import ArmBoard
from etd.selftest.arming_gate import SelftestGate
from etd.selftest.report import save
from etd.selftest.subject import Subject, subject_of
from selftest_rig import selftest_rig

pytestmark = pytest.mark.slow

BOARD = "reference-hv507"


FAILED = "the self-test of today did not pass: rail: heartbeat (fail)"


def test_arming_is_refused_with_the_sentence_of_the_report() -> None:
    rig = make(untested=lambda: FAILED)
    rig.open()
    answer = rig.ask(ArmBoard)
    assert (answer.error, rig.state) == ("arm_failed", "SAFE")
    assert answer.reason is not None
    assert "rail: heartbeat (fail)" in answer.reason
    assert not any(record.get("line") == 25 and record.get("value") for record in rig.records)
    assert rig.close() == ()


def test_the_status_tells_that_arming_is_refused_and_why() -> None:
    rig = make(untested=lambda: FAILED)
    assert rig.engine.supervisor.state_report(0).arming_refused == FAILED
    assert rig.close() == ()


def test_the_status_tells_of_guards_that_nobody_has_accepted() -> None:
    loaded = fake_config("kajimoto-hv507")
    config = msgspec.structs.replace(loaded.config, accept_absent_guards=("rail_monitor",))
    rig = make(loaded=replace(loaded, config=config))
    refused = rig.engine.supervisor.state_report(0).arming_refused
    assert refused is not None
    assert "heartbeat, one_shot: accept each by name" in refused
    assert rig.close() == ()


def test_a_report_that_comes_later_counts_without_a_restart(tmp_path: Path) -> None:
    passed = selftest_rig(BOARD).run()
    failed = msgspec.structs.replace(passed, passed=False)
    path = tmp_path / "r.json"
    save(failed, path)
    rig = make(BOARD, untested=SelftestGate(path, passed.subject))
    rig.open()
    rig.try_wearer_stop()
    assert rig.ask(ArmBoard).error == "arm_failed"
    save(passed, path)
    rig.run_ms(1_100)
    assert rig.reports[-1].state is not None
    assert rig.reports[-1].state.arming_refused is None
    save(failed, path)
    rig.open()
    # Another lease, perhaps for another person.
    rig.try_wearer_stop()
    assert rig.ask(ArmBoard).error == "arm_failed"
    save(passed, path)
    assert rig.ask(ArmBoard).error is None
    assert rig.close() == ()


def test_a_report_that_is_the_same_is_not_read_again_and_one_that_goes_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []

    def why(path: Path, _: Subject) -> str | None:
        read.append(path)
        return None if path.exists() else "none"

    monkeypatch.setattr("etd.selftest.arming_gate.arming_refusal", why)
    path = tmp_path / "r.json"
    path.write_text("{}")
    gate = SelftestGate(path, subject_of(fake_config(BOARD), "linux", ""))
    assert [gate(), gate()] == [None, None]
    assert len(read) == 1
    path.unlink()
    assert [gate(), gate()] == ["none", "none"]
    assert len(read) == 2


def test_nothing_is_read_while_current_can_flow() -> None:
    asked: list[int] = []

    def untested() -> str | None:
        asked.append(1)
        return None

    rig = make(untested=untested)
    rig.open()
    rig.arm()
    before = len(asked)
    rig.hold(1_500, current_ua=(500,) * 64, width_us=100, rate_hz=10)
    assert rig.state == "ARMED"
    assert len(asked) == before
    assert rig.close() == ()


def test_without_anything_in_the_way_it_arms() -> None:
    rig = make()
    rig.open()
    rig.arm()
    assert rig.state == "ARMED"
    assert rig.close() == ()


def test_the_report_of_an_installed_board_lies_where_its_engine_may_read_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    installed, home = tmp_path_factory.mktemp("var"), tmp_path_factory.mktemp("home")
    monkeypatch.setattr("etd.files.paths.SYSTEM_STATE", installed)
    monkeypatch.setenv("XDG_STATE_HOME", str(home))
    user = home / "etd" / "main"
    assert selftest_file("main", "linux", "b-1") == installed / "main.selftest.json"
    assert selftest_file("main", "fake", "b-1") == user / "selftest-fake-b-1.json"
    monkeypatch.setattr("etd.files.paths.SYSTEM_STATE", installed / "nowhere")
    assert selftest_file("main", "linux", "b-1") == user / "selftest-linux.json"
