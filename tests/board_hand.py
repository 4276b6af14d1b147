"""A hand on a board's lines: moves them as a driver would, without one.

Owns: words, pulses and selections typed a third time, so that tests of the fake need no driver.
"""

from __future__ import annotations

import itertools

from etd_hal.boardfile import HalfBridgeLines
from etd_hal.ports import Message, Transfer
from stepped_board import SteppedBoard

MS = 1_000_000
PAUSE = Transfer(delay_us=10)


def word(code: int) -> bytes:
    return (code << 2 & 0x3FFC).to_bytes(2, "big")


def pulse(code: int, *pauses: Transfer) -> Message:
    return Message((Transfer(word(code), cs_change=True), *pauses, Transfer(word(0))))


class Hand:
    """Moves a board's lines as a driver would, without one."""

    def __init__(self, rig: SteppedBoard) -> None:
        self.rig = rig
        self.gpio = rig.backend.gpio
        self.spi = rig.backend.spi
        lines = rig.board.switch.lines
        assert isinstance(lines, HalfBridgeLines)
        self.lines = lines

    def select(self, output: int, polarity: int = 1) -> None:
        lines = self.lines
        for stage in reversed(range(self.rig.board.switch.outputs)):
            self.gpio.set(((lines.DATA, int(stage == output)), (lines.CLK, 1)))
            self.gpio.set(((lines.CLK, 0),))
        self.gpio.set(((lines.LE, 1),))
        self.gpio.set(((lines.LE, 0),))
        self.gpio.set(((lines.BL, 1),))
        if not polarity:
            self.gpio.set(((lines.POL, 0),))

    def discharge(self) -> None:
        self.gpio.set(((self.lines.POL, 1),))
        self.gpio.set(((self.lines.BL, 0),))

    def supply_on(self) -> None:
        """Enable the supply, set it to nominal, and keep it beating until it is up."""
        guards, board = self.rig.board.guards, self.rig.board
        assert guards.hv_enable != "absent"
        if board.rail_setpoint != "absent":
            assert self.rig.backend.i2c is not None
            code = board.rail_setpoint.code.to_bytes(2, "big")
            self.rig.backend.i2c.transfer(board.rail_setpoint.address, code, 0)
        self.gpio.set(((guards.hv_enable.line, guards.hv_enable.on),))
        self.beat(500 * MS)

    def beat(self, duration_ns: int) -> None:
        heartbeat = self.rig.board.guards.heartbeat
        assert heartbeat != "absent"
        until_ns = self.rig.clock.now_ns() + duration_ns
        for level in itertools.cycle((1, 0)):
            self.gpio.set(((heartbeat.line, level),))
            self.rig.clock.spend(10 * MS)
            if self.rig.clock.now_ns() >= until_ns:
                return
