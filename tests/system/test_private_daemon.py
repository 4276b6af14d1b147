"""A verb's own daemon on a fake board, and how long what its client sends holds there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from etd import DaemonGone, Display
from etd.cli.private_daemon import answer_within_s, private_daemon
from etd.cli.process_pair import ProcessPair
from etd.files.configuration import fake_config

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("given", "factor"), [(None, 20), (3, 3)])
def test_its_timeouts_are_as_long_as_was_asked(given: int | None, factor: int) -> None:
    with (
        private_daemon("play", fake_config(array="pad-8"), timeout_factor=given) as address,
        Display(address=address) as display,
    ):
        assert display.status().timeout_factor == factor


def test_a_daemon_that_is_slow_to_start_does_not_ask_whether_it_runs(tmp_path: Path) -> None:
    arguments = ("--folder", str(tmp_path), "--board", "fake")
    with (
        open(tmp_path / "log", "w", encoding="utf-8") as log,
        ProcessPair(arguments, tmp_path, log) as both,
        pytest.raises(DaemonGone, match=r"not ready within 0 s.*held up.*has time") as told,
    ):
        both.wait_until_ready(0.0)
    assert "is the daemon running" not in str(told.value)


def test_what_a_killed_one_left_in_the_folder_is_taken_away(tmp_path: Path) -> None:
    """Of one that still runs it is not."""
    of_ended, of_running = (
        tmp_path / "engine-4194305.ready",
        tmp_path / f"engine-{os.getppid()}.ready",
    )
    for file in (of_ended, of_running):
        file.touch()
    with (
        open(tmp_path / "log", "w", encoding="utf-8") as log,
        ProcessPair(("--folder", str(tmp_path), "--board", "fake"), tmp_path, log),
    ):
        assert not of_ended.exists()
        assert of_running.exists()


@pytest.mark.parametrize(("factor", "within_s"), [(None, 10.0), (3, 6.0), (100, 60.0)])
def test_its_client_waits_longer_for_an_answer_too(factor: int | None, within_s: float) -> None:
    assert answer_within_s(factor) == within_s
