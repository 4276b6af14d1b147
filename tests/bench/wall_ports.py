"""Ports that take the time of a Raspberry Pi 4's on the real clock, without the interpreter's lock.

Owns: the compiled calls of `wall.c`, and ports that answer as a sound reference board on a
fingertip. Must not know: engines, what is measured.

A call is made through ctypes, which releases the lock for as long as it lasts, as a system call
does. Nothing is forgiven: what the machine takes from a message makes it longer.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
from array import array
from collections.abc import Callable
from functools import cache
from pathlib import Path

from bench.processor import Answers, Blanking, answers, message_ns
from etd_hal.boardfile import BoardFile, HalfBridges
from etd_hal.fake.i2cchips import Ads1115, I2cChip, Mcp4725
from etd_hal.fake.machines import PI4
from etd_hal.linux.clock import LinuxClock
from etd_hal.ports import Changes, Edge, Message

_SOURCE = Path(__file__).with_name("wall.c")
_FLAGS = ("-O2", "-Wall", "-Werror")


#: As in `wall.c`.
_MOST_STALLS = 100_000


def build(folder: Path) -> tuple[Path, Path]:
    """The library, and the program with hog and witness."""
    library, program = folder / "wall.so", folder / "wall"
    subprocess.run(["cc", *_FLAGS, "-shared", "-fPIC", "-o", library, _SOURCE], check=True)
    subprocess.run(["cc", *_FLAGS, "-o", program, _SOURCE], check=True)
    return library, program


class SystemCalls:
    """Calls that last, and what was spent waiting for the interpreter's lock after those that
    count it.
    """

    def __init__(self, library: Path) -> None:
        loaded = _loaded(library)
        self._loaded = loaded
        #: Without any counting, since it is timed: for so many ns.
        self.spend_busy: Callable[[int], int] = loaded.spend_busy
        #: For so many ns.
        self.spend_asleep: Callable[[int], None] = loaded.spend_asleep
        self._now_ns = LinuxClock().now_ns
        #: In ns, one entry a call.
        self.lock_waits_ns = array("q")

    def set_lines(self) -> None:
        """One call that sets GPIO lines."""
        self.spend_busy(PI4.gpio_call_ns)

    def spend_counted(self, duration_ns: int) -> None:
        ended_ns = self.spend_busy(duration_ns)
        self.lock_waits_ns.append(self._now_ns() - ended_ns)

    def stalls_ns(self) -> list[tuple[int, int]]:
        """(from, to) of each call of this process that was kept from its processor for 100 us."""
        found = (ctypes.c_long * 2 * _MOST_STALLS).in_dll(self._loaded, "stalls")
        count = ctypes.c_long.in_dll(self._loaded, "stalled").value
        return [(found[index][0], found[index][1]) for index in range(count)]


@cache
def _loaded(library: Path) -> ctypes.CDLL:
    loaded = ctypes.CDLL(str(library))
    loaded.spend_busy.argtypes = [ctypes.c_long]
    loaded.spend_busy.restype = ctypes.c_long
    loaded.spend_asleep.argtypes = [ctypes.c_long]
    loaded.spend_asleep.restype = None
    return loaded


class WallSpi:
    def __init__(self, calls: SystemCalls, gpio: WallGpio) -> None:
        self._spend_ns = calls.spend_busy
        self._gpio = gpio

    def prepare(self, message: Message) -> None:
        if self not in message.made:
            message.made[self] = message_ns(message), answers(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        made: tuple[int, Answers] = message.made[self]
        self._spend_ns(made[0])
        return made[1][self._gpio.is_blanked]


class WallGpio(Blanking):
    """Stop lines closed, the chain read back; a wearer who tries the stop on request."""

    def __init__(self, calls: SystemCalls, board: BoardFile, try_stop: Path) -> None:
        """The wearer tries the stop when the file `try_stop` is there, and takes it away."""
        assert isinstance(board.switch, HalfBridges)
        guards, lines = board.guards, board.switch.lines
        assert guards.heartbeat != "absent"
        assert guards.hv_enable != "absent"
        assert guards.readback != "absent"
        assert guards.wearer_stop != "absent"
        super().__init__(board)
        self._calls = calls
        self._clock, self._data = lines.CLK, lines.DATA
        self._readback, self._wearer = guards.readback, guards.wearer_stop
        self._heartbeat, self._supply = guards.heartbeat.line, guards.hv_enable.line
        self._stages = board.switch.outputs
        self._register = 0
        self._levels: dict[int, int] = {}
        self._now_ns = LinuxClock().now_ns
        self._try_stop = str(try_stop)
        #: When the heartbeat's line moved.
        self.beats_ns = array("q")
        #: When the supply was switched, on and off by turns.
        self._switched_ns: list[int] = []

    def set(self, changes: Changes) -> None:
        self._calls.spend_counted(PI4.gpio_call_ns)
        self.follow(changes)
        for line, level in changes:
            if line == self._clock and level and not self._levels.get(line):
                self._register = self._register << 1 | self._levels.get(self._data, 0)
                self._register &= (1 << self._stages) - 1
            elif line == self._heartbeat:
                self.beats_ns.append(self._now_ns())
            elif line == self._supply:
                self._note_supply(level)
            self._levels[line] = level

    def _note_supply(self, level: int) -> None:
        if level != len(self._switched_ns) % 2:
            self._switched_ns.append(self._now_ns())

    def get(self, line: int) -> int:
        self._calls.spend_counted(PI4.gpio_call_ns)
        if line == self._readback:
            return self._register >> (self._stages - 1)
        # Outputs are as set, and the stops closed.
        return self._levels.get(line, 1)

    def edges(self) -> tuple[Edge, ...]:
        if self._levels.get(self._supply) or not os.path.exists(self._try_stop):
            return ()
        os.unlink(self._try_stop)
        now_ns = self._now_ns()
        return Edge(self._wearer, 0, now_ns), Edge(self._wearer, 1, now_ns)

    def powered(self) -> list[tuple[int, int]]:
        """(from, to) of each time that the supply was on."""
        times = self._switched_ns
        return list(zip(times[::2], times[1::2], strict=False))


class WallI2c:
    """The rail's monitor, always at its middle voltage, and the rail's set-point."""

    def __init__(self, calls: SystemCalls, board: BoardFile) -> None:
        monitor = board.guards.rail_monitor
        assert monitor != "absent"
        assert board.rail_setpoint != "absent"
        volts = (monitor.low_v + monitor.high_v) / 2 / monitor.divider
        self._calls = calls
        self._chips: dict[int, I2cChip] = {
            monitor.address: Ads1115(lambda _t_ns, _channel: volts),
            board.rail_setpoint.address: Mcp4725(lambda _t_ns, _code: None),
        }
        self._now_ns = LinuxClock().now_ns

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        self._calls.spend_asleep(PI4.i2c_ns(len(write), read_length))
        chip, now_ns = self._chips[address], self._now_ns()
        if write:
            chip.write(now_ns, write)
        return chip.read(now_ns, read_length) if read_length else b""
