"""How wide pulses are, in virtual time: what the kernel makes of what the calibration promised.

Computing takes no time here, so what is measured is the kernel's own delays and the bits, within a
microsecond in every run. (Stamps are cut to whole ones: how many of a thousand pulses fall to
either side of one differs from run to run.) Tracing costs time: it is on before the calibration.
So would counting the lines that run: a quarter of a microsecond a word, which is why check.py has
this file run apart.
"""

from __future__ import annotations

import os
from collections import Counter

import pytest

import kernel_trace
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.switch_shadow import Approval
from guest_board import report

CURRENT_UA = 300
PULSES = int(os.environ.get("ETD_PULSES", "200"))
#: By so much reading the clock moves it in this guest.
CLOCK_STEP_US = 0.256
#: So that no electrode gets more pulses a second than the board allows.
REST_NS = 6_000_000


def widths_us() -> list[int]:
    """Of every message with current: from the rise after its word to the rise after its zero."""
    found = []
    for message in kernel_trace.messages(kernel_trace.events()):
        words = [event.tx for event in message if event.name == "spi_transfer_start" and event.tx]
        rises = [
            event.t_us for event in message if event.name == "spi_set_cs" and not event.is_active
        ]
        assert len(words) == len(rises)
        if words[0] != bytes(2):
            found.append(rises[-1] - rises[0])
    return found


@pytest.mark.parametrize("width_us", [20, 50, 100, 150, 200])
def test_a_pulse_is_as_wide_as_asked_within_a_microsecond(
    board: Board, ports: Backend, width_us: int
) -> None:
    board.calibrate()
    board.supply_on()
    board.guard.permit(CURRENT_UA)
    selection = board.selection(7, None)
    pulse = board.pulse(CURRENT_UA, width_us)
    source, ground = selection.source(True), selection.ground(True)
    approval = Approval(source, ground, CURRENT_UA, width_us)
    kernel_trace.begin()
    for _ in range(PULSES):
        board.prepare(selection, whole=False)
        board.connect(selection, True)
        board.send(pulse, approval)
        board.discharge()
        ports.clock.sleep_until_ns(ports.clock.now_ns() + REST_NS)
    found = widths_us()
    assert board.safe_off() == ()
    counted = ", ".join(
        f"{count} x {electrode}" for electrode, count in sorted(Counter(found).items())
    )
    report(f"asked {width_us} us, planned {pulse.shape.width_us:.2f} us, traced {counted}")
    assert len(found) == PULSES
    assert all(abs(electrode - width_us) <= 1 for electrode in found), Counter(found)
    # Both stamps are cut to whole microseconds; their mean is not, and the plan is never above.
    # But the clock of the calibration goes in steps here.
    assert width_us - 1 <= sum(found) / len(found) <= width_us + CLOCK_STEP_US
