"""`kill -9` of the engine at random moments of a scan, on the kernel's own SPI core.

Nobody answers here: everything reads zero (`alone`), so that the engine keeps its pace. What is
judged is the kernel's trace alone.
"""

from __future__ import annotations

import os
import random
import signal
import statistics

import pytest

import kernel_trace
import trace_decoder
import trace_rules
from daemon_scene import Daemon
from etd.client import Display
from etd_hal.fake.trace import header
from etd_hal.linux.clock import LinuxClock
from guest_board import BARE_BOARD as BOARD
from guest_board import SEED, above_the_engine, report

#: For how long it takes; check_service_kills.py has many.
KILLS = max(1, int(os.environ.get("ETD_KILLS", "60")) // 30)
CLOCK = LinuxClock()
#: Words are read where their transfer is over: less to read, on a slow processor.
TRACED = tuple(event for event in kernel_trace.EVENTS if event != "spi/spi_transfer_start")
#: Stamps are cut to whole microseconds.
REST_US = BOARD.rest_us - 1
#: A scan takes a tenth of a second here: asked for oftener than that, one follows upon the other,
#: and no moment lies between two. At 5 Hz one kill in twelve would find nothing to interrupt.
RATE_HZ = 40
#: The longest that two messages of such scans lie apart is some 30 ms, and 70 ms where a report and
#: the weights of the returns, four times a second, fall between two scans.
QUIET_US = 100_000
POL, BL = (BOARD.used_lines()[name] for name in ("POL", "BL"))


def scan_until_killed(daemon: Daemon, after_ns: int) -> int:
    """Show a frame, and kill the engine `after_ns` later; when it was due.

    For the first two tenths of a second the opening lets nothing through.
    """
    currents_ua = [1_000] * BOARD.switch.outputs
    with Display(address=daemon.address, max_current_ua=1_000, width_us=100) as display:
        display.arm()
        display.show_current(currents_ua, ttl_ms=1_000, rate_hz=RATE_HZ, allow_slower=True)
        with above_the_engine():
            CLOCK.sleep_until_ns(CLOCK.now_ns() + after_ns)
            return daemon.end_engine(signal.SIGKILL)


@pytest.mark.timeout(100 + 20 * KILLS)
def test_every_message_that_began_ends_in_zero_however_the_engine_is_killed(
    lone_daemon: Daemon,
) -> None:
    daemon = lone_daemon
    kernel_trace.begin(TRACED)
    chance = random.Random(SEED)
    quiet_ms: list[float] = []
    cut_ms: list[float] = []
    moving_ms: list[float] = []
    safe_ms: list[float] = []
    for _ in range(KILLS):
        killed_us = scan_until_killed(daemon, chance.randrange(450_000_000, 950_000_000)) / 1_000
        gone_us = CLOCK.now_ns() / 1_000
        safe = daemon.make_safe()
        assert safe.returncode == 0, safe.stderr
        events = kernel_trace.events()
        cut, made_safe = by_others(events, killed_us)
        left = [event for event in events if event.t_us <= gone_us and event not in cut]
        last_us = end_of_last_message_us(left)
        assert [event.rest for event in cut] == [f"{POL} 1", f"{BL} 0"], "the stopper cuts"
        assert_left_safe(made_safe)
        assert killed_us - last_us < QUIET_US, "the engine was not scanning when it was killed"
        quiet_ms.append(max(0.0, last_us - killed_us) / 1_000)
        cut_ms.append((cut[-1].t_us - killed_us) / 1_000)
        moving_ms.append((made_safe[0].t_us - killed_us) / 1_000)
        safe_ms.append((made_safe[-1].t_us - killed_us) / 1_000)
        kernel_trace.begin(TRACED)
        # The last one is followed by none.
        if len(safe_ms) < KILLS:
            daemon.start_engine()
            daemon.wait_until(engine="there", state="HALTED")
            daemon.clear_crash()
    report(f"{KILLS} kills in a scan (seed {SEED}); every message ended in zero")
    report(f"from the kill to the end of the last message: {spread(quiet_ms)}")
    report(f"from the kill to outputs that the stopper has cut: {spread(cut_ms)}")
    report(f"from the kill to the first line that `etd safe` sets: {spread(moving_ms)}")
    report(f"from the kill to the end of what `etd safe` does: {spread(safe_ms)}")


def by_others(
    events: list[kernel_trace.Event], killed_us: float
) -> tuple[list[kernel_trace.Event], list[kernel_trace.Event]]:
    """What the stopper did after the kill, and what `etd safe` did after that."""
    engine = {event.pid for event in events if event.t_us <= killed_us}
    later = [event for event in events if event.pid not in engine]
    cut = [event for event in later if event.pid == later[0].pid]
    return cut, later[len(cut) :]


def end_of_last_message_us(events: list[kernel_trace.Event]) -> int:
    """Every message that began must have ended, in zero, with chip select inactive."""
    last_us = 0
    for message in kernel_trace.messages(events):
        words = [event.tx for event in message if event.tx]
        assert words[-1] == bytes(2), "a message ended with current on"
        assert not [event for event in message if event.name == "spi_set_cs"][-1].is_active
        last_us = message[-1].t_us
    return last_us


def spread(values_ms: list[float]) -> str:
    return f"p50 {statistics.median(values_ms):.1f}, max {max(values_ms):.1f} ms"


def assert_left_safe(events: list[kernel_trace.Event]) -> None:
    """What `etd safe` did makes it so, after the stopper's cut."""
    assert events[0].name == "rig_line", "the first thing is the lines"
    facts = trace_decoder.parse(header(BOARD, range(BOARD.switch.outputs)))[0]
    assert trace_rules.violations(kernel_trace.records(events, facts), REST_US) == []
    levels = kernel_trace.levels(events)
    lines = BOARD.used_lines()
    assert (levels[lines["POL"]], levels[lines["BL"]]) == (1, 0)
