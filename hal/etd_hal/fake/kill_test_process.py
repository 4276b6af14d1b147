"""The fake's process that is killed: beats that come by themselves, and then do not.

Owns: what a kernel does with the lines of a process that is gone. Must not know: who asks.

It is no process: the fake's time steps, and no other process would follow it.
"""

from __future__ import annotations

from etd_hal.boardfile import BoardFile
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.ports import Gpio, LineSetup

_BEATS_PER_WINDOW = 5
#: From SIGKILL until the kernel has closed all that it held.
_DIES_NS = 3_000_000


class FakeKillTestProcess:
    """See `bench.KillTestProcess`."""

    def __init__(
        self, fake: FakeBoard, board: BoardFile, gpio: Gpio, setup: LineSetup, clock: SteppedClock
    ) -> None:
        self._fake = fake
        self._board = board
        self._gpio = gpio
        self._setup = setup
        self._clock = clock
        #: It holds the lines and beats.
        self.is_alive = False
        self._level = 0

    def take_over(self) -> None:
        self.is_alive = True
        enable = self._board.guards.hv_enable
        if enable != "absent":
            self._gpio.set(((enable.line, enable.on),))
        self._beat()

    def kill(self) -> float:
        self.is_alive = False
        self._clock.spend(_DIES_NS)
        if not self._fake.world.host.keeps_pins():
            self._fake.let_float()
        return _DIES_NS / 1e6

    def levels(self) -> dict[int, int]:
        return {line: self._gpio.get(line) for line, _ in self._setup.outputs}

    def step_back(self) -> None:
        self.is_alive = False
        for change in self._setup.outputs:
            self._gpio.set((change,))

    def _beat(self) -> None:
        heartbeat = self._board.guards.heartbeat
        if heartbeat == "absent" or not self.is_alive:
            return
        self._level = 1 - self._level
        self._gpio.set(((heartbeat.line, self._level),))
        again_ns = self._clock.now_ns() + heartbeat.window_ms * 1_000_000 // _BEATS_PER_WINDOW
        self._clock.at(again_ns, self._beat)
