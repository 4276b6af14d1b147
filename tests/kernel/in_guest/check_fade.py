"""A soft start and a fade over real buses: laying a message out is no part of its time.

Every pulse of both is a message that was never sent before. Where computing takes time, as on this
processor, that would look like a drift of all messages, and they would be calibrated again and
again.
"""

from __future__ import annotations

import pytest

from daemon_scene import Daemon
from etd.client import Display, clock
from etd_hal.linux.clock import LinuxClock
from guest_board import BARE_BOARD, report

CLOCK = LinuxClock()
WIDTH_US = 100
MOST_UA = 1_000
#: A scan takes a tenth of a second here: each frame is shown, and asked for oftener than that.
RATE_HZ = 40
FRAMES = 10
A_FRAME_NS = 150_000_000


@pytest.mark.timeout(200)
def test_a_soft_start_and_a_fade_are_never_calibrated_again(lone_daemon: Daemon) -> None:
    count = BARE_BOARD.switch.outputs
    with Display(address=lone_daemon.address, max_current_ua=MOST_UA, width_us=WIDTH_US) as display:
        display.arm()
        at_start = display.status().timing
        display.hold_current([MOST_UA] * count, seconds=0.6, rate_hz=RATE_HZ, allow_slower=True)
        for frame in range(FRAMES):
            currents_ua = [500 + 40 * frame + electrode % 40 for electrode in range(count)]
            display.show_current(currents_ua, ttl_ms=1_000, rate_hz=RATE_HZ, allow_slower=True)
            CLOCK.sleep_until_ns(clock.now_ns() + A_FRAME_NS)
        status = display.status()
    report(
        f"{FRAMES} frames of a fade: recalibrated {status.counters.get('recalibrated', 0)} times"
    )
    assert status.state == "ARMED"
    assert status.counters.get("recalibrated", 0) == 0
    assert status.timing == at_start
