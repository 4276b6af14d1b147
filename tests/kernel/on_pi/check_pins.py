"""What the Pi's lines do when their program lets go of them, and what the self-test says of it.

Runs on the emulated Pi, once for each way in which its kernel can be told: Debian's lets pins
become inputs, that of Raspberry Pi OS leaves them driven unless strict_gpiod is set.
"""

from __future__ import annotations

import json
import os

import pytest

import pi_board
from etd_hal.compose import open_linux
from etd_hal.linesetup import line_setup
from etd_hal.linux.gpio import find_chip, keeps_driving
from pi_board import BOARD, BOARD_PATH, LINES, MACHINE, MACHINE_PATH, TREE

KEEPS = os.environ["ETD_KEEPS_OUTPUTS"] == "1"
LATER_STAGES = ("register", "timing", "rail", "array", "table", "probe", "switches", "source")
Checks = dict[tuple[str, str], str]


def expected_pins(**raised: int) -> dict[str, tuple[str, int]]:
    """Outputs at the levels of a request, but those that are named; or inputs, which read 0."""
    levels = {pi_board.NAMES[line]: level for line, level in line_setup(BOARD).outputs} | raised
    return {name: ("gpio_out", level) for name, level in levels.items()}


def functions(pins: dict[str, tuple[str, int]]) -> set[str]:
    return {function for function, _ in pins.values()}


@pytest.fixture(scope="module")
def checks(tmp_path_factory: pytest.TempPathFactory) -> Checks:
    """How each check of `etd selftest` went, by stage and name."""
    config = (TREE / "config/etd.toml").read_text()
    config = config.replace('"kajimoto-hv507"', f'"{BOARD_PATH}"').replace('"pi4"', '"pi3"')
    path = tmp_path_factory.mktemp("selftest") / "etd.toml"
    path.write_text(config)
    told = pi_board.etd("selftest", "--config", str(path), "--no-operator", "--json", status=1)
    return {
        (load["stage"], load["name"]): load["result"]
        for load in json.loads(told)["report"]["checks"]
    }


def test_the_kernel_was_started_as_this_run_says() -> None:
    assert (pi_board.KEEPS_OUTPUTS.read_text().strip() == "Y") is KEEPS


def test_lines_that_are_let_go_of_stay_driven_or_become_inputs() -> None:
    opened = open_linux(BOARD, MACHINE)
    opened.gpio.set(((LINES["DATA"], 1),))
    held = pi_board.pins()
    opened.close()
    assert held == expected_pins(DATA=1)
    if KEEPS:
        assert pi_board.pins() == held
    else:
        assert functions(pi_board.pins()) == {"gpio_in"}


def test_the_driver_knows_which_of_the_two_it_is() -> None:
    assert keeps_driving(find_chip(BOARD.gpio_chip_labels), line_setup(BOARD)) is KEEPS


def test_safe_leaves_nothing_on_that_was_left_on() -> None:
    opened = open_linux(BOARD, MACHINE)
    opened.gpio.set(((LINES["DATA"], 1), (LINES["LE"], 1), (LINES["BL"], 1)))
    opened.close()
    pi_board.etd("safe", "--board", str(BOARD_PATH), "--machine", str(MACHINE_PATH))
    if KEEPS:
        assert pi_board.pins() == expected_pins()
    else:
        assert functions(pi_board.pins()) == {"gpio_in"}


def test_the_selftest_passes_the_machine_but_for_what_only_a_pis_firmware_tells(
    checks: Checks,
) -> None:
    machine = {name: result for (stage, name), result in checks.items() if stage == "machine"}
    assert machine == {
        "libraries": "pass",
        "model": "pass",
        "realtime": "pass",
        "scan_core": "pass",
        "free_memory": "pass",
        "clock": "pass",
        "date": "pass",
        "pins_after_exit": "fail" if KEEPS else "pass",
        "cpu_clock": "absent",
        "temperature": "skip",
        "throttling": "skip",
        "supply_voltage": "skip",
    }


def test_the_selftest_finds_the_buses_and_stops_at_the_open_stop_loops(checks: Checks) -> None:
    buses = {name: result for (stage, name), result in checks.items() if stage == "buses"}
    if KEEPS:
        assert buses == {"all": "skip"}
        return
    passes = ("spi_echo", "idle_node", "safe_state", "lines")
    # The thermometer in the place of the rail's ADC does not say whose result it holds.
    fails = ("rail_monitor", "emergency_stop", "wearer_stop")
    assert buses == dict.fromkeys(passes, "pass") | dict.fromkeys(fails, "fail")


@pytest.mark.parametrize("stage", LATER_STAGES)
def test_the_selftest_does_nothing_that_needs_what_failed(checks: Checks, stage: str) -> None:
    assert checks[stage, "all"] == "skip"


def test_the_selftest_ends_in_the_safe_state(checks: Checks) -> None:
    assert checks["end", "safe_state"] == "pass"
