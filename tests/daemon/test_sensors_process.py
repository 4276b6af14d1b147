"""The process beside the scan, for real: it reads what the kernel says of the scan's core."""

from __future__ import annotations

import os

import msgspec
import pytest

from etd.files.configuration import fake_config
from etd.sensing.readings import Readings
from etd.sensing.scan_core import ScanCoreReading
from etd.sensing.sensors import slots_of
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.scan_core import scan_core
from etd_hal.linux.side_process import SideProcess

CLOCK = LinuxClock()
MS = 1_000_000
PATIENCE_NS = 60_000 * MS


def test_it_tells_of_the_core_of_the_thread_that_has_started_it_and_not_of_its_own() -> None:
    before = os.sched_getaffinity(0)
    if len(before) < 2:
        pytest.skip("this machine has one core only")
    core = max(before)
    loaded = fake_config("reference-hv507")
    readings = Readings(slots_of(loaded.array))
    of_scan = ScanCoreReading(readings, CLOCK)
    memory, files = readings.memory.fd, msgspec.json.encode((loaded.board, loaded.array))
    arguments = (None, core, "etd.sensing.process", (memory, files))
    process = SideProcess("sensors", "etd_hal.linux.sensor_process", arguments, (memory,))
    try:
        assert process.refusals == ()
        # As the engine does: only now it asks for its core.
        os.sched_setaffinity(0, {core})
        until_ns = CLOCK.now_ns() + PATIENCE_NS
        while of_scan.told(CLOCK.now_ns()) != str(scan_core()):
            assert CLOCK.now_ns() < until_ns, of_scan.told(CLOCK.now_ns())
            CLOCK.doze_until_ns(CLOCK.now_ns() + 5 * MS)
        assert f"core {core}, " in of_scan.told(CLOCK.now_ns())
        assert of_scan.is_left_alone(CLOCK.now_ns()) is scan_core().is_left_alone
    finally:
        os.sched_setaffinity(0, before)
        process.end()
    # Nobody reads any more.
    CLOCK.doze_until_ns(CLOCK.now_ns() + 600 * MS)
    assert not of_scan.is_left_alone(CLOCK.now_ns())
    assert "was not read" in of_scan.told(CLOCK.now_ns())
