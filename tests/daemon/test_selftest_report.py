"""The report: kept whole, read again, and what it means for arming."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from engine_parts import board_file
from etd.errors import FileError
from etd.selftest_report import Check, Report, digest_of, load, save, to_json, why_not_armed
from etd_hal.boardfile import BoardFile
from selftest_rig import selftest_rig

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


def board() -> BoardFile:
    return board_file(BOARD)


def test_a_report_is_read_as_it_was_written(passed: Report, tmp_path: Path) -> None:
    path = tmp_path / "state" / "main.selftest.json"
    save(passed, path)
    assert load(path) == passed
    assert path.read_bytes() == to_json(passed)
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_the_engines_user_can_read_what_the_operator_wrote(passed: Report, tmp_path: Path) -> None:
    save(passed, tmp_path / "r.json")
    assert (tmp_path / "r.json").stat().st_mode & 0o777 == 0o644


def test_a_report_that_cannot_be_kept_says_what_to_do(passed: Report, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(FileError, match="cannot be kept"):
        save(passed, tmp_path / "file" / "r.json")


def test_a_pass_lets_a_real_board_be_armed(passed: Report, tmp_path: Path) -> None:
    save(msgspec.structs.replace(passed, backend="linux"), tmp_path / "r.json")
    assert why_not_armed(tmp_path / "r.json", board(), "linux") is None


def test_an_absent_guard_is_no_failure(passed: Report, tmp_path: Path) -> None:
    save(spoiled(passed, result="absent"), tmp_path / "r.json")
    assert why_not_armed(tmp_path / "r.json", board(), "fake") is None


@pytest.mark.parametrize("result", ["fail", "skip"])
@pytest.mark.parametrize("backend", ["linux", "fake"])
def test_a_failure_or_a_skip_forbids_arming_by_name(
    passed: Report, tmp_path: Path, result: str, backend: Any
) -> None:
    report = spoiled(passed, result=result, name="heartbeat", measured="still 300 V")
    save(msgspec.structs.replace(report, backend=backend), tmp_path / "r.json")
    reason = why_not_armed(tmp_path / "r.json", board(), backend)
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
    reason = why_not_armed(tmp_path / "r.json", board(), "linux")
    assert reason is not None
    assert "run etd selftest" in reason
    assert why_not_armed(tmp_path / "r.json", board(), "fake") is None


def test_a_report_that_says_passed_without_a_check_that_says_so_does_not_count(
    passed: Report, tmp_path: Path
) -> None:
    save(msgspec.structs.replace(passed, passed=False, backend="linux"), tmp_path / "r.json")
    reason = why_not_armed(tmp_path / "r.json", board(), "linux")
    assert reason is not None
    assert "cut short" in reason


def test_another_board_file_is_another_board(passed: Report, tmp_path: Path) -> None:
    save(msgspec.structs.replace(passed, backend="linux"), tmp_path / "r.json")
    source = msgspec.structs.replace(board().source, full_scale_ua=9_000)
    changed = msgspec.structs.replace(board(), source=source)
    assert digest_of(changed) != digest_of(board())
    reason = why_not_armed(tmp_path / "r.json", changed, "linux")
    assert reason is not None
    assert "again" in reason


def test_the_fakes_pass_is_no_pass_of_a_board(passed: Report, tmp_path: Path) -> None:
    save(passed, tmp_path / "r.json")
    assert why_not_armed(tmp_path / "r.json", board(), "linux") is not None


@pytest.mark.parametrize("backend", ["linux", "fake"])
def test_a_report_that_cannot_be_read_forbids_arming(tmp_path: Path, backend: Any) -> None:
    (tmp_path / "r.json").write_text('{"passed": true}')
    reason = why_not_armed(tmp_path / "r.json", board(), backend)
    assert reason is not None
    assert "not a report" in reason
