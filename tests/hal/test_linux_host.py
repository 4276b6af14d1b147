"""The machine under a real board, as its kernel and firmware tell it; laid out in a folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from board_rig import machine_file
from etd_hal.bench import Health
from etd_hal.linux.host import LinuxHost


def host(root: Path, **files: str) -> LinuxHost:
    """Files by a short name, as below."""
    places = {
        "temp": "sys/class/thermal/thermal_zone0/temp",
        "throttled": "sys/devices/platform/soc/soc:firmware/get_throttled",
        "name": "sys/class/hwmon/hwmon1/name",
        "meminfo": "proc/meminfo",
        "clocksource": "sys/devices/system/clocksource/clocksource0/current_clocksource",
        "alarm": "sys/class/hwmon/hwmon1/in0_lcrit_alarm",
    }
    for name, text in files.items():
        path = root / places[name]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return LinuxHost(machine_file(), keeps_pins=False, root=root)


def test_a_raspberry_pi_in_order(tmp_path: Path) -> None:
    found = host(tmp_path, temp="48312\n", throttled="0\n").health()
    assert found == Health(
        temperature_c=48.312,
        is_throttled=False,
        is_under_voltage=False,
        was_throttled=False,
        was_under_voltage=False,
    )


@pytest.mark.parametrize(
    ("bits", "is_throttled", "is_under_voltage"),
    [("1", False, True), ("2", True, False), ("4", True, False), ("8", True, False)],
)
def test_what_is_wrong_now_counts(
    tmp_path: Path, bits: str, is_throttled: bool, is_under_voltage: bool
) -> None:
    found = host(tmp_path, temp="48312", throttled=bits).health()
    assert (found.is_throttled, found.is_under_voltage) == (is_throttled, is_under_voltage)


@pytest.mark.parametrize(
    ("bits", "was_throttled", "was_under_voltage"),
    [
        ("10000", False, True),
        ("20000", True, False),
        ("40000", True, False),
        ("80000", True, False),
        ("f0000", True, True),
    ],
)
def test_what_was_wrong_since_boot_is_told_apart(
    tmp_path: Path, bits: str, was_throttled: bool, was_under_voltage: bool
) -> None:
    found = host(tmp_path, throttled=bits).health()
    assert (found.is_throttled, found.is_under_voltage) == (False, False)
    assert (found.was_throttled, found.was_under_voltage) == (was_throttled, was_under_voltage)


@pytest.mark.parametrize(("alarm", "is_under_voltage"), [("0\n", False), ("1\n", True)])
def test_where_the_firmware_does_not_tell_the_voltage_sensor_does(
    tmp_path: Path, alarm: str, is_under_voltage: bool
) -> None:
    found = host(tmp_path, name="rpi_volt\n", alarm=alarm).health()
    assert found == Health(None, None, is_under_voltage)


def test_what_a_kernel_does_not_tell_is_not_known(tmp_path: Path) -> None:
    assert host(tmp_path).health() == Health(None, None, None)
    assert host(tmp_path, temp="hot", throttled="what").health() == Health(None, None, None)


def test_packages_are_named_with_their_versions(tmp_path: Path) -> None:
    packages = host(tmp_path).packages()
    assert set(packages) == {"msgspec", "gpiod", "spidev", "smbus2"}
    assert packages["msgspec"]


def test_free_memory_is_what_can_be_had_without_swapping(tmp_path: Path) -> None:
    told = "MemTotal:  4000000 kB\nMemFree:  100 kB\nMemAvailable:  312000 kB\n"
    assert host(tmp_path, meminfo=told).free_memory_kb() == 312_000


def test_a_kernel_that_tells_no_memory_is_not_known(tmp_path: Path) -> None:
    assert host(tmp_path).free_memory_kb() is None


def test_clocks_are_asked_of_this_machine_and_named(tmp_path: Path) -> None:
    found = host(tmp_path, clocksource="arch_sys_counter\n").timekeeping()
    assert found.source == "arch_sys_counter"
    assert found.least_step_ns >= 0
    assert 0 < found.resolution_ns <= 10_000_000
    assert found.not_before <= found.now
    assert found.is_synchronized in (True, False)


def test_what_a_thread_has_of_real_time_is_the_kernels_own_account(tmp_path: Path) -> None:
    found = host(tmp_path).obtained()
    assert found.policy == "SCHED_OTHER"
    assert set(found.cores) == os.sched_getaffinity(0)
    assert 0 <= found.locked_kb <= found.mapped_kb
    assert found.mapped_kb > 1_000
    assert found.timer_slack_ns > 0
