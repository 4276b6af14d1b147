"""The usual script: every bit set by its own call, the whole chain for every pulse, and
`time.sleep` for width and rest. It runs on the same fake, so that the ratio is of like with like.

Owns: that script, written as people write it. Must not know: the engine.
"""

from __future__ import annotations

from dataclasses import dataclass

from bench.modelled import ELECTRODES, WIDTH_US, loaded_with
from etd_hal.boardfile import HalfBridgeLines
from etd_hal.fake.board import FakeBoard, FakePorts
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.fingertip import fingertip_body
from etd_hal.linesetup import line_setup, spi_setup
from etd_hal.ports import Message, Transfer

#: What `time.sleep` takes over the time asked for, on the median, for an ordinary thread on a Pi
#: (60 to 100 us are to be expected; in a virtual machine 72 to 78 us were measured).
OVERSLEEP_US = 70
#: What one call of gpiod is assumed to cost on a Pi 4: 10 us for one line, 15 us for several.
GPIOD_CALL_US = 10.0
#: What the fake charges for a raw call.
RAW_CALL_US = 4.4
_CODE = 164
_HIGH, _LOW = 1, 0


@dataclass(frozen=True)
class ScriptFigures:
    """One pass over all electrodes."""

    scan_us: float
    calls_per_pulse: float


class UsualScript:
    """See the module. `call_us`: what one GPIO call costs."""

    def __init__(self, rest_us: int, call_us: float = RAW_CALL_US) -> None:
        board = loaded_with(rest_us).board
        lines = board.switch.lines
        assert isinstance(lines, HalfBridgeLines)
        self._lines = lines
        self._rest_us = rest_us
        self._extra_ns = int((call_us - RAW_CALL_US) * 1_000)
        self._clock = SteppedClock()
        body = fingertip_body(board, ELECTRODES)
        self._fake = FakeBoard(board, self._clock, body, electrodes=range(ELECTRODES))
        self._ports: FakePorts = self._fake.request(line_setup(board), spi_setup(board))
        self._calls = 0

    def scan(self) -> ScriptFigures:
        begun_ns, self._calls = self._clock.now_ns(), 0
        for electrode in range(ELECTRODES):
            self._select(electrode)
            self._pulse()
        took_us = (self._clock.now_ns() - begun_ns) / 1_000
        return ScriptFigures(took_us, self._calls / ELECTRODES)

    def _select(self, electrode: int) -> None:
        """Three calls a bit; the first bit in ends up farthest away."""
        lines = self._lines
        for bit in range(ELECTRODES - 1, -1, -1):
            self._set(lines.DATA, _HIGH if bit == electrode else _LOW)
            self._set(lines.CLK, _HIGH)
            self._set(lines.CLK, _LOW)
        self._set(lines.LE, _HIGH)
        self._set(lines.LE, _LOW)

    def _pulse(self) -> None:
        self._set(self._lines.BL, _HIGH)
        self._write(_CODE)
        self._sleep(WIDTH_US)
        self._write(0)
        self._set(self._lines.BL, _LOW)
        self._sleep(self._rest_us)

    def _set(self, line: int, value: int) -> None:
        self._calls += 1
        self._ports.gpio.set(((line, value),))
        self._clock.spend(self._extra_ns)

    def _write(self, code: int) -> None:
        self._calls += 1
        self._ports.spi.transfer(Message((Transfer((code << 2).to_bytes(2, "big")),)))

    def _sleep(self, duration_us: int) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + (duration_us + OVERSLEEP_US) * 1_000)
