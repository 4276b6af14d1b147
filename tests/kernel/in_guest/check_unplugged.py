"""A bus that goes away within a scan of a whole daemon."""

from __future__ import annotations

import signal
from typing import Literal

import pytest

import kernel_trace
from daemon_scene import arm, running_daemon
from etd.client import Display
from etd_hal.linux.clock import LinuxClock
from guest_board import BOARD, BOARD_PATH, MACHINE_PATH, Chips, report, unplugged

CLOCK = LinuxClock()
LINES = BOARD.used_lines()


@pytest.mark.timeout(300)
@pytest.mark.parametrize("bus", ["rig-spi", "rig-gpio"])
def test_a_bus_that_is_unplugged_within_a_scan_halts_the_engine_and_leaves_the_skin_silent(
    chips: Chips, bus: Literal["rig-spi", "rig-gpio"]
) -> None:
    with running_daemon(str(BOARD_PATH), MACHINE_PATH, BOARD.absent_guards) as daemon:
        daemon.start_engine()
        daemon.wait_until(engine="there", state="SAFE")
        with Display(address=daemon.address, max_current_ua=1_000, width_us=100) as display:
            arm(display, chips)
            display.show_current([500] * 64, ttl_ms=1_000, rate_hz=5, allow_slower=True)
            CLOCK.sleep_until_ns(CLOCK.now_ns() + 400_000_000)
            assert with_current(kernel_trace.events()), "the scan has not begun"
            with unplugged(bus):
                gone_us = CLOCK.now_ns() // 1_000
                halted = daemon.wait_until(state="HALTED")
                CLOCK.sleep_until_ns(CLOCK.now_ns() + 300_000_000)
                events = kernel_trace.events()
        assert halted.halt is not None
        report(f"{bus} unplugged within a scan: halted by {halted.halt.source}")
        assert [t_us for t_us in with_current(events) if t_us > gone_us] == []
        assert chips.state().dac_code == 0
        if bus == "rig-spi":
            levels = kernel_trace.levels(events)
            assert (levels[LINES["POL"]], levels[LINES["BL"]], levels[LINES["HV"]]) == (1, 0, 0)
        daemon.end_engine(signal.SIGTERM)


def with_current(events: list[kernel_trace.Event]) -> list[int]:
    """When each transfer ended that told the source to make a current, in us."""
    stops = (event for event in events if event.name == "spi_transfer_stop")
    return [event.t_us for event in stops if event.tx and event.tx != bytes(2)]
