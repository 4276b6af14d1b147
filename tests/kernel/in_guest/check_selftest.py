"""`etd selftest` over the real character devices: what is wrong is named.

That a sound board passes is the beginning of the whole scene (check_scene.py). The board hangs on
nothing but a resistor; the lines are let go of as with `strict_gpiod`.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon_scene import write_config
from etd.selftest.report import Report
from etd_hal.fake import wire
from etd_hal.fake.faults import DacGain, Fault, LineCut, OutputsSwapped, RailOff, SwitchOutput
from guest_board import (
    BOARD,
    BOARD_PATH,
    MACHINE_PATH,
    Chips,
    running_chips,
    set_parameter,
)
from operator_scene import selftest


@pytest.fixture
def folder() -> Iterator[Path]:
    # A Unix socket's path has at most 107 bytes: not in pytest's folder.
    with tempfile.TemporaryDirectory(prefix="rig") as found:
        yield Path(found)


@pytest.fixture
def bench(folder: Path) -> Iterator[Chips]:
    set_parameter("strict_gpiod", 1)
    write_config(folder / "etd.toml", str(BOARD_PATH), MACHINE_PATH, BOARD.absent_guards, "pad-8")
    with running_chips(folder, "--on-bench") as chips:
        yield chips
        state = chips.state()
    set_parameter("strict_gpiod", 0)
    assert state.dac_code == 0
    assert state.violations == ()


def outcome(folder: Path, bench: Chips) -> tuple[int, Report]:
    return selftest(folder / "etd.toml", bench, folder / "report.json")


def failed(of: Report) -> list[tuple[str, str]]:
    return [(check.stage, check.name) for check in of.checks if check.result == "fail"]


#: What is found late takes long in this guest: how many of them is chosen outside.
FAULTS = [
    pytest.param(LineCut("DATA"), "register", "readback", id="DATA cut"),
    pytest.param(RailOff(0.8), "rail", "rise", id="low rail"),
    pytest.param(DacGain(1.3), "array", "ramp", id="too strong a source"),
    pytest.param(SwitchOutput(6, "open"), "switches", "every_switch", id="dead switch"),
    pytest.param(OutputsSwapped(3, 6), "switches", "every_switch", id="swapped wires"),
]
POL, HV_ENABLE = BOARD.used_lines()["POL"], BOARD.used_lines()["HV"]
TRIED = FAULTS[: int(os.environ.get("ETD_FAULTS", "5"))]


@pytest.mark.parametrize(("fault", "stage", "name"), TRIED)
def test_a_fault_of_the_board_is_named(
    folder: Path, bench: Chips, fault: Fault, stage: str, name: str
) -> None:
    bench.knock(wire.PutIn(fault))
    status, found = outcome(folder, bench)
    assert status == 1
    assert failed(found)[:1] == [(stage, name)]


def test_a_pull_that_is_missing_is_named_after_a_kill(folder: Path, bench: Chips) -> None:
    """The process that holds the lines is killed for real; HV ENABLE then goes up by itself."""
    set_parameter("pulled_up", 1 << POL | 1 << HV_ENABLE)
    try:
        status, found = outcome(folder, bench)
    finally:
        set_parameter("pulled_up", 1 << POL)
    assert status == 1
    assert failed(found) == [("rail", "killed_lines")]


def test_what_is_wrong_with_the_machine_is_named(folder: Path, bench: Chips) -> None:
    wrong = {"throttled": 0b0101, "temperature_mc": 84_000, "strict_gpiod": 0}
    try:
        for name, value in wrong.items():
            set_parameter(name, value)
        status, found = outcome(folder, bench)
    finally:
        set_parameter("throttled", 0)
        set_parameter("temperature_mc", 45_000)
    assert status == 1
    assert failed(found) == [
        ("machine", name)
        for name in ("pins_after_exit", "temperature", "throttling", "supply_voltage")
    ]


def test_an_i2c_bus_that_nobody_answers_on_is_named(folder: Path, bench: Chips) -> None:
    set_parameter("i2c_errno", 121)
    try:
        status, found = outcome(folder, bench)
    finally:
        set_parameter("i2c_errno", 0)
    assert status == 1
    assert failed(found)[:1] == [("buses", "rail_monitor")]
