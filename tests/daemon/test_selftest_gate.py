"""The engine and the last self-test: arming is refused by the name of the check."""

from __future__ import annotations

import pytest

from engine_rig import make
from etd.link import ArmBoard
from etd.places import selftest_file


def test_arming_is_refused_with_the_sentence_of_the_report() -> None:
    rig = make(untested="the self-test of today did not pass: rail: heartbeat (fail)")
    rig.open()
    answer = rig.ask(ArmBoard)
    assert (answer.error, rig.state) == ("arm_failed", "SAFE")
    assert answer.reason is not None
    assert "rail: heartbeat (fail)" in answer.reason
    assert not any(record.get("line") == 25 and record.get("value") for record in rig.records)
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
    monkeypatch.setattr("etd.places.SYSTEM_STATE", installed)
    monkeypatch.setenv("XDG_STATE_HOME", str(home))
    user = home / "etd" / "main"
    assert selftest_file("main", "linux", "b-1") == installed / "main.selftest.json"
    assert selftest_file("main", "fake", "b-1") == user / "selftest-fake-b-1.json"
    monkeypatch.setattr("etd.places.SYSTEM_STATE", installed / "nowhere")
    assert selftest_file("main", "linux", "b-1") == user / "selftest-linux.json"
