"""`etd bench` as a person runs it: without a board, and with files that it must not overwrite."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from command_rig import CommandRig, command_rig
from etd.bench.result import Result
from etd.files.resources import find
from etd_hal.boardfile import load_machine

SHORT = ("bench", "--seconds", "0.5")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def config_of_any_machine(folder: Path) -> Path:
    """A fake board's, with a machine file that names no model."""
    text = find("machines", "pi4").read_text()
    models = next(line for line in text.splitlines() if line.startswith("models"))
    (folder / "any.toml").write_text(text.replace(models, "models = []"))
    config = folder / "etd.toml"
    config.write_text(
        """
backend = "fake"
board = "kajimoto-hv507"
machine = "./any.toml"
array = "grid-8x8"
body_site = "fingertip"
accept_absent_guards = []
operators = []

[engine]
core = "any"
priority = "none"
"""
    )
    return config


def test_without_a_board_it_measures_the_machine_and_writes_both_files(rig: CommandRig) -> None:
    report, machine = rig.folder / "bench.json", rig.folder / "mine.toml"
    files = ("--report", str(report), "--write-machine", str(machine))
    said = rig.run(*SHORT, "--config", str(config_of_any_machine(rig.folder)), *files)
    assert said.status == 0, said.err
    assert "with a probe first" in said.out
    assert "no configuration of a real board" in said.out
    result = msgspec.json.decode(report.read_bytes(), type=Result)
    assert result.messages is None
    assert load_machine(machine).visit_us > 1.0
    assert str(machine) in said.err
    again = rig.run(*SHORT, "--report", str(report))
    assert again.status == 2
    assert "not overwritten" in again.err


def test_as_json_it_prints_one_object_and_nothing_else(rig: CommandRig) -> None:
    said = rig.run(*SHORT, "--machine", "pi3", "--json")
    assert said.status == 0
    assert said.err == ""
    assert said.answer["machine"] == "pi3"
    assert said.answer["computing"][0]["kind"] == "plain"


@pytest.mark.parametrize(
    "options",
    [
        ("--machine", "none"),
        ("--config", "/nonexistent.toml"),
        ("--seconds", "0"),
        # Not for this machine, or one file for two things.
        ("--machine", "pi4", "--write-machine", "mine.toml"),
        ("--machine", "rig", "--write-machine", "mine", "--report", "mine"),
    ],
)
def test_what_cannot_be_measured_is_wrong_use(rig: CommandRig, options: tuple[str, ...]) -> None:
    said = rig.run("bench", *options)
    assert said.status == 2
    assert options[-1] in said.err or options[-2] in said.err
