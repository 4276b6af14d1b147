"""A process that holds the board's outputs instead of the program, to be killed by the self-test.

Owns: its life time: it never outlives its parent, nor a few seconds. Must not know: the test.

It dies as the engine would: the kernel closes its files, and then pulls and the heartbeat's gate
determine the board's state. It inherits no line, because they are released before.
"""

from __future__ import annotations

import os
import select
import signal
from collections.abc import Callable
from dataclasses import replace

from etd_hal.boardfile import BoardFile
from etd_hal.errors import BusError
from etd_hal.linux.clock import LinuxClock
from etd_hal.linux.gpio import LinuxGpio, find_chip, levels_as_they_are
from etd_hal.linux.opening import open_lines
from etd_hal.linux.realtime import ordinary, perish_with
from etd_hal.ports import Changes, Edge, LineSetup

_LONGEST_NS = 10_000_000_000
_UP_WITHIN_MS = 5_000
_BEATS_PER_WINDOW = 5
_IDLE_NS = 20_000_000
_WHAT = "a process that holds the lines"


class LentGpio:
    """The Gpio port, whose lines can be given up for a while."""

    def __init__(self, gpio: LinuxGpio, open_again: Callable[[], LinuxGpio]) -> None:
        self._gpio = gpio
        self._open_again = open_again
        self.is_lent = False

    def set(self, changes: Changes) -> None:
        self._gpio.set(changes)

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        return self._gpio.edges()

    @property
    def output_fd(self) -> int:
        """Of the lines as they are held now."""
        return self._gpio.output_fd

    def values_of(self, changes: Changes) -> bytes:
        return self._gpio.values_of(changes)

    def close(self) -> None:
        self._gpio.close()

    def give_up(self) -> None:
        self._gpio.close()
        self.is_lent = True

    def take_back(self) -> None:
        """At the levels of a request. Raises: BusError."""
        self._gpio = self._open_again()
        self.is_lent = False


class LinuxKillTestProcess:
    """See `bench.KillTestProcess`."""

    def __init__(self, board: BoardFile, setup: LineSetup, lent: LentGpio) -> None:
        self._board = board
        self._outputs = replace(setup, inputs=())
        self._lent = lent
        #: Of the process, while there is one.
        self.pid: int | None = None
        self._clock = LinuxClock()

    def take_over(self) -> None:
        """Raises: BusError (it does not come up)."""
        self._lent.give_up()
        told, telling = os.pipe()
        parent = os.getpid()
        self.pid = os.fork()
        if self.pid == 0:
            _hold_until_killed(self._board, self._outputs, telling, parent)
        os.close(telling)
        try:
            is_up = select.select([told], [], [], _UP_WITHIN_MS / 1_000)[0] and os.read(told, 1)
        finally:
            os.close(told)
        if not is_up:
            raise BusError("gone", _WHAT, "beginning", "it ended, or does not come up")

    def kill(self) -> float:
        """When it has been waited for, the kernel has closed all that it held."""
        begun_ns = self._clock.now_ns()
        self._end()
        return (self._clock.now_ns() - begun_ns) / 1e6

    def levels(self) -> dict[int, int]:
        """Raises: BusError."""
        chip = find_chip(self._board.gpio_chip_labels)
        return levels_as_they_are(chip, self._outputs)

    def step_back(self) -> None:
        """Raises: BusError."""
        self._end()
        if self._lent.is_lent:
            self._lent.take_back()

    def _end(self) -> None:
        if self.pid is not None:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
            self.pid = None


def _hold_until_killed(board: BoardFile, outputs: LineSetup, telling: int, parent: int) -> None:
    """In the process itself; it never returns."""
    try:
        perish_with(parent)
        ordinary()
        for ending in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(ending, signal.SIG_DFL)
        gpio = open_lines(board, outputs)
        enable = board.guards.hv_enable
        if enable != "absent":
            gpio.set(((enable.line, enable.on),))
        os.write(telling, b"1")
        _beat(board, gpio)
    finally:
        os._exit(1)


def _beat(board: BoardFile, gpio: LinuxGpio) -> None:
    heartbeat = board.guards.heartbeat
    clock = LinuxClock()
    ends_ns, level = clock.now_ns() + _LONGEST_NS, 0
    while clock.now_ns() < ends_ns:
        if heartbeat == "absent":
            clock.doze_until_ns(clock.now_ns() + _IDLE_NS)
            continue
        level = 1 - level
        gpio.set(((heartbeat.line, level),))
        clock.doze_until_ns(clock.now_ns() + heartbeat.window_ms * 1_000_000 // _BEATS_PER_WINDOW)
