"""`kill -9` of the engine at random moments of a scan, on the kernel's own SPI core.

Nobody answers here: everything reads zero (`alone`), so that the engine keeps its pace. What is
judged is the kernel's trace alone.
"""

from __future__ import annotations

import os
import random
import signal
from collections.abc import Iterator

import pytest

import kernel_trace
import trace_decoder
import trace_rules
from daemon_scene import Daemon, running_daemon
from etd.client import Display
from etd_hal.boardfile import load_board
from etd_hal.fake.trace import header
from etd_hal.linux.clock import LinuxClock
from guest_board import MACHINE_PATH, TREE, set_parameter

BOARD = load_board(TREE / "config/boards/kajimoto-hv507.toml")
KILLS = int(os.environ.get("ETD_KILLS", "10"))
CLOCK = LinuxClock()
#: Stamps are cut to whole microseconds.
REST_US = BOARD.rest_us - 1


@pytest.fixture
def daemon() -> Iterator[Daemon]:
    set_parameter("alone", 1)
    kernel_trace.begin()
    try:
        with running_daemon(BOARD.name, MACHINE_PATH, BOARD.absent_guards) as running:
            running.wait_until(engine="there", state="SAFE")
            yield running
    finally:
        set_parameter("alone", 0)


def scan_until_killed(daemon: Daemon, after_ns: int) -> int:
    """Show a frame, and kill the engine `after_ns` later; when it was.

    For the first two tenths of a second the opening lets nothing through.
    """
    currents_ua = [1_000] * BOARD.switch.outputs
    with Display(address=daemon.address, max_current_ua=1_000, width_us=100) as display:
        display.arm()
        display.show_current(currents_ua, ttl_ms=1_000, rate_hz=5, thin=True)
        CLOCK.sleep_until_ns(CLOCK.now_ns() + after_ns)
        return daemon.end_engine(signal.SIGKILL)


@pytest.mark.timeout(100 + 20 * KILLS)
def test_every_message_that_began_ends_in_zero_however_the_engine_is_killed(
    daemon: Daemon,
) -> None:
    chance = random.Random(20_261_121)
    scanning = 0
    for _ in range(KILLS):
        killed_us = scan_until_killed(daemon, chance.randrange(300_000_000, 900_000_000)) / 1_000
        events = kernel_trace.events()
        last_us = 0
        for message in kernel_trace.messages(events):
            words = [event.tx for event in message if event.tx]
            assert words[-1] == bytes(2), "a message ended with current on"
            assert not [event for event in message if event.name == "spi_set_cs"][-1].is_active
            last_us = message[-1].t_us
        scanning += killed_us - last_us < 100_000
        safe = daemon.make_safe()
        assert safe.returncode == 0, safe.stderr
        assert_left_safe()
        kernel_trace.begin()
        daemon.start_engine()
        daemon.wait_until(engine="there", state="SAFE")
    assert scanning > KILLS // 2, "the engine was not scanning when it was killed"
    print(f"{KILLS} kills, {scanning} of them in a scan")


def assert_left_safe() -> None:
    """By the rules that hold for any bus trace: nothing on, nothing selected."""
    facts = trace_decoder.parse(header(BOARD, range(BOARD.switch.outputs)))[0]
    assert trace_rules.violations(kernel_trace.records(kernel_trace.events(), facts), REST_US) == []
