"""What a real kernel says of a core, and that what is switched off there is read as off.

Debian's kernel has a fair server for each core; its runtime is in debugfs, which is mounted here
for as long as the check takes. It cannot be switched off before the throttle is.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from etd_hal.linux.scan_core import scan_core
from guest_board import FIRST_PROCESSOR, report

DEBUG = Path("/sys/kernel/debug")
(CORE,) = FIRST_PROCESSOR
FAIR_SERVER = DEBUG / f"sched/fair_server/cpu{CORE}/runtime"
THROTTLE = Path("/proc/sys/kernel/sched_rt_runtime_us")


@pytest.fixture
def debugfs() -> Iterator[None]:
    subprocess.run(["mount", "-t", "debugfs", "debugfs", str(DEBUG)], check=True)
    yield
    subprocess.run(["umount", str(DEBUG)], check=True)


def test_the_fair_server_is_followed_where_it_can_be_read(debugfs: None) -> None:
    usual = FAIR_SERVER.read_text()
    report(f"{os.uname().release}: the fair server of core {CORE} runs {usual.strip()} ns")
    assert int(usual) > 0
    assert scan_core().has_fair_server is True
    throttle = THROTTLE.read_text()
    try:
        THROTTLE.write_text("-1")
        FAIR_SERVER.write_text("0")
        assert scan_core().has_fair_server is False
    finally:
        FAIR_SERVER.write_text(usual)
        THROTTLE.write_text(throttle)
    assert scan_core().has_fair_server is True


def test_the_throttle_is_followed() -> None:
    usual = THROTTLE.read_text()
    assert scan_core().has_throttle is True
    try:
        THROTTLE.write_text("-1")
        assert scan_core().has_throttle is False
    finally:
        THROTTLE.write_text(usual)


def test_without_debugfs_a_fair_server_is_not_known_and_no_core_is_left_alone() -> None:
    found = scan_core()
    assert (found.core, found.is_isolated, found.has_fair_server) == (CORE, False, None)
    assert not found.is_left_alone
