"""A whole daemon over the real character devices: stop tried, armed, frames felt, stopped, safe."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

import kernel_trace
import trace_decoder
import trace_rules
from daemon_scene import Daemon, running_daemon
from etd.client import Display
from etd.errors import Refused
from etd_hal.fake import wire
from etd_hal.linux.clock import LinuxClock
from guest_board import (
    BOARD,
    BOARD_PATH,
    MACHINE_PATH,
    Chips,
    trace_header,
)

CLOCK = LinuxClock()
#: Stamps are cut to whole microseconds.
REST_US = BOARD.rest_us - 1


@pytest.fixture
def daemon(chips: Chips) -> Iterator[Daemon]:
    with running_daemon(str(BOARD_PATH), MACHINE_PATH, BOARD.absent_guards) as running:
        running.wait_until(engine="there", state="SAFE")
        yield running


def try_wearer_stop(chips: Chips) -> None:
    """Pressed and released once, before the first arming of a session."""
    for level in (0, 1):
        chips.knock(wire.Press("wearer_stop", level))
        CLOCK.sleep_until_ns(CLOCK.now_ns() + 200_000_000)


def felt() -> list[trace_decoder.Phase]:
    """What the wires did, by the kernel's trace: a decoding apart from all of ours."""
    records = kernel_trace.records(kernel_trace.events(), trace_header())
    assert trace_rules.violations(records, REST_US) == []
    return trace_decoder.decode(records)


@pytest.mark.timeout(200)
def test_a_frame_is_felt_where_and_as_strong_as_it_says_and_a_stop_ends_it(
    daemon: Daemon, chips: Chips
) -> None:
    currents_ua = [0] * 64
    currents_ua[3], currents_ua[40] = 400, 700
    with Display(address=daemon.address, max_current_ua=1_000, width_us=100) as display:
        with pytest.raises(Refused, match="wearer's stop has not been tried"):
            display.arm()
        try_wearer_stop(chips)
        if display.status().state == "HALTED":
            display.clear()
        display.arm()
        display.hold_current(currents_ua, seconds=0.6, rate_hz=5, thin=True)
        display.stop()
        assert display.status().state == "HALTED"
    daemon.end_engine(signal.SIGTERM)
    shown = [phase for phase in felt() if phase.current_ua > 310]
    assert {phase.electrode for phase in shown} == {3, 40}
    assert max(phase.current_ua for phase in shown if phase.electrode == 3) <= 400
    assert max(phase.current_ua for phase in shown if phase.electrode == 40) <= 700
    assert all(phase.is_anodic for phase in shown)
