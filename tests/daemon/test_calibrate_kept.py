"""One command at a time has what is saved of a calibration."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import pytest

from etd.calibrate.fitting import load_fit
from etd.calibrate.progress import save_progress
from etd.cli.calibrate_kept import alone
from etd.protocol.errors import FileError
from fit_scenes import StateSkin, begun


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "etd"


def named(name: str, board: str | None = None) -> argparse.Namespace:
    return argparse.Namespace(name=name, board=board)


def test_a_second_command_is_refused_until_the_first_has_ended(state: Path) -> None:
    with alone(named("main"), "P01"):
        refused = rf"P01.lock: process {os.getpid()} calibrates P01 .* end it"
        with pytest.raises(FileError, match=refused), alone(named("main"), "P01"):
            pass
    with alone(named("main"), "P01"):
        pass
    assert [path.name for path in (state / "main" / "calibrating").iterdir()] == ["P01.lock"]


def test_another_person_another_daemon_and_a_fake_do_not_wait() -> None:
    with (
        alone(named("main"), "P01"),
        alone(named("main"), "P02"),
        alone(named("other"), "P01"),
        alone(named("main", "fake"), "P01"),
    ):
        pass


def test_what_is_no_lock_is_not_opened(state: Path) -> None:
    with alone(named("main"), "P01"):
        pass
    lock = state / "main" / "calibrating" / "P01.lock"
    lock.unlink()
    lock.mkdir()
    with pytest.raises(FileError, match=r"P01\.lock"), alone(named("main"), "P01"):
        pass


def test_a_fit_is_continued_on_the_daemon_that_it_was_begun_on(tmp_path: Path) -> None:
    path, here = tmp_path / "fit.json", begun(StateSkin(0.8, 1), 1)
    here.made_on = "one (fake), daemon here"
    save_progress(path, here)
    assert load_fit(path, here).made_on == here.made_on
    there = begun(StateSkin(0.8, 1), 1)
    there.made_on = "one (fake), daemon there"
    with pytest.raises(FileError, match=r"is of one .fake., daemon here, this board is .* there"):
        load_fit(path, there)
