"""A thousand kills, some of them; and what their figures are judged as."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.kills import (
    ProcessKills,
    heed_silence,
    is_late,
    main,
    processes,
    spread,
    verdict,
    wrong_lives,
)
from bench.kills_operations import KilledEngines, Lives
from campaign.scenes import BOARDS
from etd.protocol.errors import DaemonGone

QUICK = ProcessKills(with_ms=[0.5] * 9 + [19.0], held_up_ms=1.0)


@pytest.mark.parametrize("has_keeper", [True, False])
@pytest.mark.parametrize("board", BOARDS)
def test_however_an_engine_is_killed_no_more_than_a_pulse_flows_and_it_is_remembered(
    tmp_path: Path, board: str, has_keeper: bool
) -> None:
    engines = KilledEngines(board, tmp_path, seed=7, has_keeper=has_keeper)
    for _ in range(12):
        engines.kill_one()
    lives = engines.lives
    assert wrong_lives({board: lives}) == []
    assert lives.kills == 12
    assert lives.powered > 0
    assert 0.5 < lives.largest_part <= 1.0, "there was current, and no more than a pulse's"


def test_a_kill_beyond_the_last_operation_is_one_at_the_end(tmp_path: Path) -> None:
    """The stopper's own calls come after it: they are nobody's to kill."""
    engines = KilledEngines(BOARDS[0], tmp_path, seed=7)
    lives = range(engines.whole - 40, engines.whole + 1)
    for killed_at in lives:
        engines.live(killed_at)
    assert wrong_lives({BOARDS[0]: engines.lives}) == []
    assert engines.lives.kills == len(lives)


def test_what_is_wrong_in_a_life_is_told(tmp_path: Path) -> None:
    """There is no folder for the note, so nothing is armed."""
    engines = KilledEngines(BOARDS[0], tmp_path / "absent", seed=7)
    engines.kill_one()
    assert any("not armed: that the supply is on" in each for each in engines.lives.wrong)


def test_real_processes_are_safe_in_time(tmp_path: Path) -> None:
    try:
        found = processes(2, lambda _: None)
    except (OSError, TimeoutError, DaemonGone) as error:
        pytest.skip(str(error))
    assert found.wrong == []
    assert len(found.with_ms) + found.halted_before == 2
    assert len(found.with_ms) <= len(found.without_ms) <= 2
    assert all(took_ms > 0.0 for took_ms in found.with_ms)


def test_a_real_engine_that_is_stopped_is_cut_off_before_it_is_killed(tmp_path: Path) -> None:
    try:
        found = processes(0, lambda _: None, silences=2)
    except (OSError, TimeoutError, DaemonGone) as error:
        pytest.skip(str(error))
    assert found.wrong == []
    assert (found.with_ms, found.without_ms) == ([], [])
    assert len(found.silent_ms) + found.halted_before == 2
    assert all(took_ms > 0.0 for took_ms in found.silent_ms)


def test_a_silence_is_judged_by_the_first_cut_after_it() -> None:
    told = {"cut_before_ns": [500, 9_000_000], "is_powered": True, "held_up_ns": 600_000}
    found = ProcessKills(window_ms=20)
    heed_silence(told, 1_000, 2_000_000, found)
    assert (found.silent_ms, found.held_up_ms, found.halted_before) == ([7.0], 0.6, 0)
    heed_silence(told | {"cut_before_ns": [1_500_000, 9_000_000]}, 1_000, 2_000_000, found)
    heed_silence(told | {"is_powered": False}, 1_000, 2_000_000, found)
    assert (found.silent_ms, found.halted_before, found.wrong) == ([7.0], 2, [])
    heed_silence(told | {"cut_before_ns": [500]}, 1_000, 2_000_000, found)
    assert found.wrong == ["an engine that was stopped with the supply on was not cut off"]


def test_late_is_a_p50_above_5_ms_or_a_most_above_20() -> None:
    assert not is_late(QUICK)
    assert is_late(ProcessKills(with_ms=[0.5] * 9 + [20.1]))
    assert is_late(ProcessKills(with_ms=[5.1] * 10))
    assert not is_late(ProcessKills(silent_ms=[25.0], window_ms=20))
    assert is_late(ProcessKills(silent_ms=[20.0] * 9 + [25.1], window_ms=20))
    assert spread([1.0, 2.0, 3.0]) == {"count": 3, "p50": 2.0, "p99": 3.0, "max": 3.0}


def test_the_verdict() -> None:
    assert verdict({}, QUICK) == 0
    late = ProcessKills(with_ms=[6.0], held_up_ms=1.0)
    assert verdict({}, late) == 1
    late.held_up_ms = 5.1
    assert verdict({}, late) == 3, "the machine was busy"
    assert verdict({}, ProcessKills(wrong=["something"])) == 1
    assert verdict({"a": Lives(wrong=["something"])}, None) == 1
    assert verdict({"a": Lives(largest_part=1.01)}, None) == 1
    assert verdict({"a": Lives(after_pc=1.0)}, None) == 1
    assert verdict({"a": Lives(largest_part=1.0)}, QUICK) == 0


def test_the_command_says_what_it_found(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--kills", "1", "--part", "operations"]) == 0
    said = capsys.readouterr().out
    assert "kajimoto-hv507, with the stopper: 1 kills in" in said
    assert main(["--kills", "1", "--part", "operations", "--json"]) == 0
    assert '"largest_part"' in capsys.readouterr().out
