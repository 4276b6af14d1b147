"""The engine that is measured: the real one, on ports that lead to no wire.

Owns: the board, the array and the frames that every machine is measured with, so that results can
be compared. Must not know: what is measured.
"""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import replace
from typing import Self

import msgspec

from etd.engine.loop import Engine
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.errors import BoardFault
from etd.protocol.frame import Frame
from etd.protocol.link import (
    Alive,
    Answer,
    ArmBoard,
    Channel,
    NewFrame,
    OpenLease,
    ToEngine,
    ToGateway,
)
from etd.protocol.messages import Limits
from etd.stabilize.law_settings import ContactSettings, LinearLawSettings, PressureSettings
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_hal.backend import Backend
from etd_hal.boardfile import MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.cutlatch import LOOKED_NS, NOTED, POWER
from etd_hal.ports import Clock
from etd_hal.unwired import Mark, MarkedClock, NoMarker, SpendingClock, UnwiredGpio, UnwiredSpi
from etd_hal.wakeups import WakeUps

#: The board that most kits are, with all of its outputs on one array.
BOARD, ELECTRODES = "kajimoto-hv507", 64
CURRENT_UA, WIDTH_US, REST_US = 400, 100, 200
#: A second: contacts are firm then.
_WARM_UP, _WARM_UP_HZ = 20, 20.0
_LEASE, _FRAME = "bench", 3
#: As wide as a stabilizer may make it, and every machine allows that.
_WIDEST_US = 150
_BEGUN_WITHIN_NS = 1_000_000_000
#: As often as a gateway says that it is there.
_ALIVE_NS = 50_000_000

#: One law of each kind, as they are shipped; of those by resistance the costliest.
_LAWS = Settings(
    order=("pressure", "linear_law", "contact"),
    pressure=PressureSettings(),
    linear_law=LinearLawSettings(),
    contact=ContactSettings(),
)
#: What is measured, by name: how each pulse is asked for.
KINDS = {
    "plain": NO_STABILIZERS,
    "with stabilizers": _LAWS,
    "with a probe first": msgspec.structs.replace(_LAWS, probe_first=True),
}


def loaded_with(machine: MachineFile, stabilize: Settings) -> LoadedConfig:
    """The measured configuration on this machine."""
    loaded = fake_config(BOARD, electrodes=ELECTRODES)
    site = msgspec.structs.replace(loaded.body_site, stabilize=stabilize)
    board = msgspec.structs.replace(loaded.board, rest_us=REST_US)
    return replace(loaded, board=board, body_site=site, machine=machine)


class Subject:
    """An armed engine and its gateway's end of the link. It is ended by leaving the block."""

    def __init__(
        self,
        machine: MachineFile,
        kind: str,
        codec: Codec,
        clock: SpendingClock,
        mark: Callable[[Mark, int], None],
        host_clock: Clock,
        wakeups: WakeUps | None = None,
    ) -> None:
        """`kind` is one of KINDS; `host_clock` is read as each poll begins. `wakeups`: of a real
        clock behind `clock`.
        """
        loaded = loaded_with(machine, KINDS[kind])
        self._clock = marked = MarkedClock(clock, mark)
        gpio = UnwiredGpio(marked, loaded.board, machine, mark)
        spi = UnwiredSpi(marked, loaded.board, machine, codec, gpio, mark)
        backend = Backend(
            "fake",
            *(spi, gpio, None, marked, NoMarker(), lambda: None),
            host_clock=host_clock,
            codec=codec,
            wakeups=wakeups or WakeUps(),
        )
        self.engine = Engine(loaded, backend)
        self._seq = 0
        self._alive_ns = 0
        commands, frames = (
            socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)
        )
        to_engine: Channel[ToEngine] = Channel(commands[0], ToEngine)
        to_frames: Channel[NewFrame] = Channel(frames[0], NewFrame)
        self._engine_ends = (to_engine, to_frames)
        self._commands: Channel[ToGateway] = Channel(commands[1], ToGateway)
        self._frames: Channel[ToGateway] = Channel(frames[1], ToGateway)

    def __enter__(self) -> Self:
        """Raises: BoardFault, as `play`."""
        try:
            self._arm()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _arm(self) -> None:
        engine = self.engine
        engine.supervisor.begin()
        engine.attach(*self._engine_ends)
        limits = Limits(max_current_ua=3_000, width_us=_WIDEST_US)
        self._commands.send(OpenLease(ref=1, lease=_LEASE, client="etd bench", limits=limits))
        self._commands.send(ArmBoard(ref=2))
        while engine.supervisor.states.state != "ARMED":
            self._step()
            if engine.supervisor.states.state == "HALTED":
                raise self._ended()
        while engine.components.soft_start.ceiling_ua < CURRENT_UA:
            self.play(_WARM_UP_HZ)
        for _ in range(_WARM_UP):
            self.play(_WARM_UP_HZ)

    def _end(self) -> None:
        self.engine.supervisor.end()
        for channel in (*self._engine_ends, self._commands, self._frames):
            channel.close()

    def play(self, rate_hz: float) -> None:
        """One scan of all electrodes, and the time until the next is due. Raises: BoardFault, where
        the engine has halted or its lease has lapsed.
        """
        engine, begun_ns = self.engine, self._clock.now_ns()
        self._seq += 1
        frame = Frame(
            lease=_LEASE,
            seq=self._seq,
            current_ua=(CURRENT_UA,) * ELECTRODES,
            width_us=WIDTH_US,
            rate_hz=rate_hz,
            pulses=1,
            ttl_ms=1_000,
            allow_slower=True,
        )
        self._frames.send(NewFrame(ref=_FRAME, frame=frame))
        while engine.components.active.schedule is None:
            self._step_armed()
            if self._clock.now_ns() - begun_ns > _BEGUN_WITHIN_NS:
                raise BoardFault("the loop", "no scan within a second", "one at once")
        while engine.components.active.schedule is not None:
            self._step_armed()
        next_ns = begun_ns + int(1e9 / rate_hz)
        while self._clock.now_ns() < next_ns:
            self._step_armed()

    def _step_armed(self) -> None:
        now_ns = self._clock.now_ns()
        if now_ns >= self._alive_ns + _ALIVE_NS:
            self._alive_ns = now_ns
            self._commands.send(Alive())
        self._step()
        if self.engine.supervisor.states.state != "ARMED":
            raise self._ended()

    def _ended(self) -> BoardFault:
        states = self.engine.supervisor.states
        halt = states.halt
        # Only a frame that is not renewed, and a gateway that is silent, disarm without a halt.
        why = (
            "its lease lapsed, as this program was held up"
            if halt is None
            else f"{halt.cause}: {halt.detail}"
        )
        return BoardFault("the loop", why, "an engine that stays armed: measure again")

    def _step(self) -> None:
        engine = self.engine
        # No stopper runs: what it does beside a pulse is not measured.
        words = engine.components.board.cut.words
        words[LOOKED_NS] = engine.components.backend.clock.now_ns()
        words[NOTED] = words[POWER]
        engine.step()
        while (message := self._commands.receive()) is not None:
            if isinstance(message, Answer) and message.error is not None:
                if message.error == "no_lease":
                    raise self._ended()
                raise BoardFault("the loop", message.reason, "all that is asked for")
