"""The report: kept whole, read again, and what it means for arming."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd.files.configuration import fake_config
from etd.protocol.errors import FileError
from etd.selftest.report import (
    MOST_BYTES,
    Check,
    Report,
    arming_refusal,
    load,
    save,
    to_json,
)
from etd.selftest.subject import Subject, subject_of
from selftest_rig import ARRAY, selftest_rig

BOARD = "reference-hv507"


@pytest.fixture(scope="module")
def passed() -> Report:
    return selftest_rig(BOARD).run()


def spoiled(report: Report, **changes: Any) -> Report:
    """With one check of the report as `changes` say."""
    last = msgspec.structs.replace(report.checks[-1], **changes)
    checks = (*report.checks[:-1], last)
    good = all(check.is_good for check in checks)
    return msgspec.structs.replace(report, checks=checks, passed=good)


def now(backend: Any = "linux", **changes: Any) -> Subject:
    """What is to be armed."""
    subject = subject_of(fake_config(BOARD, ARRAY), backend, "")
    return msgspec.structs.replace(subject, **changes)


def of_hardware(report: Report, **changes: Any) -> Report:
    return msgspec.structs.replace(report, subject=now(), **changes)


def test_a_report_is_read_as_it_was_written(passed: Report, tmp_path: Path) -> None:
    path = tmp_path / "state" / "main.selftest.json"
    save(passed, path)
    assert load(path) == passed
    assert path.read_bytes() == to_json(passed)
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_the_engines_user_can_read_what_the_operator_wrote(passed: Report, tmp_path: Path) -> None:
    save(passed, tmp_path / "r.json")
    assert (tmp_path / "r.json").stat().st_mode & 0o777 == 0o644


def test_a_report_that_cannot_be_kept_says_what_to_do(passed: Report, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(FileError, match="this is no folder"):
        save(passed, tmp_path / "file" / "r.json")


def test_a_pass_lets_a_real_board_be_armed(passed: Report, tmp_path: Path) -> None:
    save(of_hardware(passed), tmp_path / "r.json")
    assert arming_refusal(tmp_path / "r.json", now()) is None


def test_an_absent_guard_is_no_failure(passed: Report, tmp_path: Path) -> None:
    save(spoiled(passed, result="absent"), tmp_path / "r.json")
    assert arming_refusal(tmp_path / "r.json", now("fake")) is None


@pytest.mark.parametrize("result", ["fail", "skip"])
@pytest.mark.parametrize("backend", ["linux", "fake"])
def test_a_failure_or_a_skip_forbids_arming_by_name(
    passed: Report, tmp_path: Path, result: str, backend: Any
) -> None:
    report = spoiled(passed, result=result, name="heartbeat", measured="still 300 V")
    save(msgspec.structs.replace(report, subject=now(backend)), tmp_path / "r.json")
    reason = arming_refusal(tmp_path / "r.json", now(backend))
    assert reason is not None
    assert f"end: heartbeat ({result}) still 300 V" in reason
    assert "etd selftest" in reason


def test_a_failure_is_named_before_a_skip(passed: Report) -> None:
    checks = (
        Check(stage="buses", name="emergency_stop", result="skip"),
        Check(stage="rail", name="heartbeat", result="fail"),
    )
    report = msgspec.structs.replace(passed, checks=checks, passed=False)
    assert report.first_bad == checks[1]


def test_a_real_board_without_a_report_is_not_armed_and_a_fake_is(tmp_path: Path) -> None:
    reason = arming_refusal(tmp_path / "r.json", now())
    assert reason is not None
    assert "run etd selftest" in reason
    assert arming_refusal(tmp_path / "r.json", now("fake")) is None


def test_a_report_that_says_passed_without_a_check_that_says_so_does_not_count(
    passed: Report, tmp_path: Path
) -> None:
    save(of_hardware(passed, passed=False), tmp_path / "r.json")
    reason = arming_refusal(tmp_path / "r.json", now())
    assert reason is not None
    assert "cut short" in reason


def test_a_report_without_any_check_lets_nothing_be_armed(passed: Report, tmp_path: Path) -> None:
    save(of_hardware(passed, checks=(), passed=True), tmp_path / "r.json")
    reason = arming_refusal(tmp_path / "r.json", now())
    assert reason is not None
    assert "cut short" in reason


OTHERS: list[tuple[str, dict[str, Any]]] = [
    ("board file", {"board_digest": "0"}),
    ("machine file", {"machine_digest": "0"}),
    ("machine", {"machine_identity": "4711"}),
    ("array", {"outputs": (0, 1, 200)}),
    ("strength", {"strongest_ua": 9_000, "body_site": "forearm"}),
    ("version", {"program": "etd 0.1.1"}),
]


@pytest.mark.parametrize(("what", "changes"), OTHERS, ids=lambda entry: str(entry))
def test_a_pass_of_something_else_is_no_pass_of_a_board(
    passed: Report, tmp_path: Path, what: str, changes: dict[str, Any]
) -> None:
    save(of_hardware(passed), tmp_path / "r.json")
    reason = arming_refusal(tmp_path / "r.json", now(**changes))
    assert reason is not None
    assert f"was of another {what} " in reason
    assert "stop the daemon and run etd selftest" in reason


@pytest.mark.parametrize(("what", "changes"), OTHERS, ids=lambda entry: str(entry))
def test_a_failure_of_something_else_keeps_no_fake_from_being_armed(
    passed: Report, tmp_path: Path, what: str, changes: dict[str, Any]
) -> None:
    save(spoiled(passed, result="fail"), tmp_path / "r.json")
    assert arming_refusal(tmp_path / "r.json", now("fake")) is not None, what
    assert arming_refusal(tmp_path / "r.json", now("fake", **changes)) is None, what


def test_fewer_electrodes_and_a_weaker_site_are_covered(passed: Report, tmp_path: Path) -> None:
    save(of_hardware(passed), tmp_path / "r.json")
    fewer = now(array="pad-8", outputs=tuple(range(8)), body_site="tongue", strongest_ua=2_000)
    assert arming_refusal(tmp_path / "r.json", fewer) is None


def test_what_a_board_file_says_makes_the_board_and_not_its_name() -> None:
    loaded = fake_config(BOARD)
    source = msgspec.structs.replace(loaded.board.source, full_scale_ua=9_000)
    changed = replace(loaded, board=msgspec.structs.replace(loaded.board, source=source))
    other, this = subject_of(changed, "fake", ""), subject_of(loaded, "fake", "")
    assert other.board_digest != this.board_digest
    assert other.configuration != this.configuration
    assert this.configuration.startswith(f"{BOARD}-")


def test_a_fake_that_did_not_pass_says_how_it_passes(passed: Report, tmp_path: Path) -> None:
    save(spoiled(passed, result="fail"), tmp_path / "r.json")
    reason = arming_refusal(tmp_path / "r.json", now("fake"))
    assert reason is not None
    assert f"--board fake:{BOARD} --array {now().array} --dummy-load 47000 --second-load" in reason
    assert f"or remove {tmp_path / 'r.json'}" in reason


def test_the_fakes_pass_is_no_pass_of_a_board(passed: Report, tmp_path: Path) -> None:
    save(passed, tmp_path / "r.json")
    assert arming_refusal(tmp_path / "r.json", now()) is not None


@pytest.mark.parametrize("backend", ["linux", "fake"])
def test_a_report_that_cannot_be_read_forbids_arming(tmp_path: Path, backend: Any) -> None:
    (tmp_path / "r.json").write_text('{"passed": true}')
    reason = arming_refusal(tmp_path / "r.json", now(backend))
    assert reason is not None
    assert "not a self-test report" in reason


def test_a_pipe_in_its_place_forbids_arming_without_being_waited_for(tmp_path: Path) -> None:
    """The engine's own thread reads it."""
    path = tmp_path / "r.json"
    os.mkfifo(path)
    reason = arming_refusal(path, now("fake"))
    assert reason is not None
    assert "it is a pipe, a device or a socket; remove it, and run etd selftest" in reason


def test_of_a_file_that_is_no_report_no_more_is_read_than_a_report_may_have(
    passed: Report, tmp_path: Path
) -> None:
    path = tmp_path / "r.json"
    whole = to_json(of_hardware(passed))
    assert len(whole) * 8 < MOST_BYTES
    path.write_bytes(whole.ljust(MOST_BYTES))
    assert arming_refusal(path, now()) is None
    path.write_bytes(whole.ljust(MOST_BYTES + 1))
    assert f"it has more than {MOST_BYTES} bytes" in str(arming_refusal(path, now()))
