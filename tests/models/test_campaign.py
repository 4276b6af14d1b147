"""The fault campaign: its judge, and a bounded part of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from campaign import scenes
from campaign.account import AccountedBody
from campaign.case import Outcome
from campaign.forked import whole
from campaign.kinds import kinds_of
from campaign.operations import Operations
from campaign.results import figures, is_silent, kept
from campaign.run import faults_found
from charge_witness import even_skin
from etd_body.interface import Side

RUN = Path(__file__).resolve().parents[1] / "campaign" / "run.py"
US = 1_000


def sides(alone: int, side: Side) -> tuple[Side, ...]:
    other = Side.GROUND if side is Side.SOURCE else Side.SOURCE
    return tuple(side if electrode == alone else other for electrode in range(scenes.ELECTRODES))


@pytest.mark.parametrize("side", [Side.SOURCE, Side.GROUND])
def test_the_account_tells_who_was_alone_and_for_how_long(side: Side) -> None:
    board = scenes.config("kajimoto-hv507").board
    body = AccountedBody(even_skin(board, scenes.ELECTRODES))
    for begun_us in (0, 500):
        body.drive(begun_us * US, 1_000.0, sides(3, side))
        body.drive((begun_us + 100) * US, 0.0, sides(3, side))
    body.drive(1_000 * US, 1_000.0, sides(5, side))
    found = body.account(1_050 * US)
    # The board's leak takes its part of 1 mA for 100 us.
    assert 70_000 < found.longest_alone_pc < 100_000
    assert found.alone_pc[3] == pytest.approx(2 * found.longest_alone_pc)
    assert found.alone_pc[5] == pytest.approx(found.longest_alone_pc / 2)
    assert found.shared_pc[0] == pytest.approx(2.5 * found.longest_shared_pc)
    assert found.longest_shared_pc == pytest.approx(found.longest_alone_pc / 7)


@pytest.mark.parametrize("board", scenes.BOARDS)
def test_without_a_fault_each_lit_electrode_gets_its_pulses(board: str) -> None:
    allowed, ports = whole(board)
    lit = [electrode for electrode, wanted_ua in enumerate(scenes.WANTED_UA) if wanted_ua]
    silent = [electrode for electrode in range(scenes.ELECTRODES) if electrode not in lit]
    # Two pulses a frame; four frames, one of them of two phases; and probes.
    most_pc = 2 * 5 * scenes.PULSE_PC
    assert all(0.7 * most_pc < allowed.alone_pc[electrode] < 1.4 * most_pc for electrode in lit)
    assert all(allowed.alone_pc[electrode] < 0.4 * most_pc for electrode in silent)
    assert allowed.longest_alone_pc < scenes.PULSE_PC
    assert {"spi", "set"} <= set(ports)


def test_what_an_operation_is_told_happens_to_it() -> None:
    operations = Operations()
    rig, _ = scenes.rig_of("kajimoto-hv507", operations)
    operations.before = lambda number, port: "io" if port == "spi" else None
    scenes.play(rig)
    assert rig.state == "HALTED"
    rig.fake.world.mend()
    operations.before = lambda *_: None
    rig.close()


def test_every_board_has_kinds_of_its_guards() -> None:
    names = {board: {kind.fault_class for kind in kinds_of(scenes.config(board).board)}
             for board in scenes.BOARDS}  # fmt: skip
    assert names["reference-hv507"] - names["kajimoto-hv507"] == {
        "the supply cannot be switched off",
        "the rail's sensor lies",
        "the heartbeat is ignored",
    }


def told(**changed: Any) -> Outcome:
    facts: dict[str, Any] = {
        "board": "reference-hv507",
        "kind": "a gain: twice",
        "fault_class": "a gain",
        "operation": 7,
        "port": "spi",
        "seen": "nothing",
        "halted_after_ms": None,
        "beyond_alone_pc": 0.0,
        "beyond_shared_pc": 0.0,
    }
    return Outcome(**{**facts, **changed})


def test_what_does_not_hold_is_said() -> None:
    assert faults_found([told(), told(beyond_alone_pc=2.4e6)]) == []
    for broken in (
        told(beyond_alone_pc=2.6e6),
        told(beyond_shared_pc=2.6e6),
        told(seen="crashed: TypeError()"),
    ):
        (sentence,) = faults_found([told(), broken])
        assert "operation 7" in sentence
    without_guards = told(board="kajimoto-hv507", beyond_alone_pc=2.6e6)
    assert faults_found([without_guards]) == []


def test_a_class_has_its_worst_and_what_nothing_was_said_of() -> None:
    (found,) = figures(
        [
            told(),
            told(beyond_alone_pc=50_000.0),
            told(seen="halted", halted_after_ms=2.0, beyond_shared_pc=9_000.0),
            told(seen="halted", halted_after_ms=8.0),
        ]
    )
    assert (found.cases, found.halted, found.harmless, found.silent) == (4, 2, 1, 1)
    assert (found.halted_most_ms, found.most_alone_uc, found.most_shared_uc) == (8.0, 0.05, 0.009)
    assert is_silent(told(beyond_shared_pc=5_000.0))
    assert not is_silent(told(seen="refused", beyond_shared_pc=5_000.0))


def test_a_bounded_part_of_it_holds_and_goes_on_where_it_was_cut(tmp_path: Path) -> None:
    command = [sys.executable, str(RUN), "--bounded", "--pairs", "40", "--folder", str(tmp_path)]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    by_class = {one["fault_class"]: one for one in json.loads(done.stdout)}
    for never_silent in ("a call fails, nothing done", "a message is cut off", "the DAC is stuck"):
        assert by_class[never_silent]["halted"] > 0
        assert by_class[never_silent]["silent"] == 0
    # What is known to be no pulse's to tell must be seen by the judge.
    assert by_class["a gain"]["most_alone_uc"] > 0.1
    assert by_class["two at once"]["cases"] == 40 * len(scenes.BOARDS)

    (one, *_), before = sorted(tmp_path.glob("*/*.jsonl")), {}
    before[one] = kept(one)
    one.write_bytes(b"".join(one.read_bytes().splitlines(keepends=True)[:-3]))
    subprocess.run([*command, "--json"], capture_output=True, check=True)
    again = {(each.kind, each.operation): each for each in kept(one)}
    assert again == {(each.kind, each.operation): each for each in before[one]}
