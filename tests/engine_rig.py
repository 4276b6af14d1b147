"""An engine on the stepped fake, driven over its own link by a scripted gateway.

Time passes only as the engine spends it. Everything that the engine does crosses the fake's
wires, and the trace of it is at hand.
"""

from __future__ import annotations

import io
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from etd.engine.loop import Engine
from etd.engine.opening import CalibrationReader, GivenCalibrations
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.calibration import Calibration
from etd.protocol.frame import Frame
from etd.protocol.link import (
    Alive,
    Answer,
    ArmBoard,
    Channel,
    Command,
    NewFrame,
    OpenLease,
    Report,
    ToEngine,
    ToGateway,
)
from etd.protocol.messages import Limits
from etd.protocol.opening import WantedCalibration
from etd.sensing.sensors import SensorCycle
from etd.stabilize.pipeline import Stabilizer
from etd_hal.backend import Backend
from etd_hal.compose import codec_of
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import BoardClock, LiveClock, SteppedClock
from etd_hal.fake.faults import Fault
from etd_hal.fake.fingertip import fingertip_body
from etd_hal.fake.machines import PI4, MachineModel
from etd_hal.fake.processor import Processor
from etd_hal.fake.trace import Trace
from etd_hal.fake.world import Touchable
from etd_hal.linesetup import line_setup, spi_setup
from etd_hal.supply_note import SupplyNote
from followed_trace import FollowedTrace
from stepped_stopper import SteppedStopper

LEASE = "a-lease"
_ALIVE_NS = 50_000_000

EngineEnds = tuple[Channel[ToEngine], Channel[NewFrame]]


@dataclass
class EngineRig:
    """See the module; `make` builds one."""

    engine: Engine
    fake: FakeBoard
    clock: SteppedClock
    sink: io.BytesIO
    commands: Channel[ToGateway]
    frames: Channel[ToGateway]
    _engine_ends: EngineEnds
    #: What the engine finds when a lease is opened by name.
    given: dict[str, Calibration]
    answers: dict[int, Answer] = field(default_factory=dict)
    reports: list[Report] = field(default_factory=list)
    others: list[object] = field(default_factory=list)
    is_gateway_alive: bool = True
    #: False: what the engine says stays in the queue.
    is_listening: bool = True
    #: False: the sensor thread hangs on its bus.
    is_sensing: bool = True
    #: Called before each turn with the time, for what the world does meanwhile.
    meanwhile: Callable[[int], None] = lambda _: None
    #: What the stopper keeps.
    supply_note: SupplyNote | None = None
    _ref: int = 0
    _seq: int = 0
    _alive_ns: int = 0

    def __post_init__(self) -> None:
        self.stopper = SteppedStopper(self.engine, self.clock, note=self.supply_note)
        self._turns = SensorCycle(self.engine.components.rail, self.engine.components.pressure)
        self.followed = FollowedTrace(self.sink)

    def step(self) -> None:
        now_ns = self.clock.now_ns()
        self.meanwhile(now_ns)
        if self.is_gateway_alive and now_ns - self._alive_ns >= _ALIVE_NS // 2:
            self._alive_ns = now_ns
            self.commands.send(Alive())
        self._sense()
        turn(self.engine)
        if self.is_listening:
            self.listen()

    def _sense(self) -> None:
        """What the sensor thread does, in between."""
        if self.is_sensing:
            self.engine.components.scan_core.read()
        if self.is_sensing and (
            self.engine.components.rail.is_there or self.engine.components.pressure.count
        ):
            self._turns.step()

    def listen(self) -> None:
        """Take note of all that the engine has said."""
        while (message := self.commands.receive()) is not None:
            if isinstance(message, Answer):
                self.answers[message.ref] = message
            elif isinstance(message, Report):
                self.reports.append(message)
            else:
                self.others.append(message)

    def stand_still_ms(self, duration_ms: int) -> None:
        """The whole machine does: neither engine nor stopper has the processor."""
        self.stopper.is_looking = False
        self.clock.spend(duration_ms * 1_000_000)
        self.stopper.is_looking = True

    def run_ms(self, duration_ms: float) -> None:
        """Turns until so much time has passed."""
        until_ns = self.clock.now_ns() + int(duration_ms * 1e6)
        while self.clock.now_ns() < until_ns:
            self.step()

    @property
    def last_ref(self) -> int:
        """Of the last command or frame sent."""
        return self._ref

    def next_ref(self) -> int:
        self._ref += 1
        return self._ref

    def ask(self, kind: Callable[..., Command], patience_ms: int = 3_000, **fields: Any) -> Answer:
        """Send a command and wait for its answer."""
        ref = self.next_ref()
        assert self.commands.send(kind(ref=ref, **fields))
        return self.wait_for(ref, patience_ms)

    def wait_for(self, ref: int, patience_ms: int = 3_000) -> Answer:
        until_ns = self.clock.now_ns() + patience_ms * 1_000_000
        while ref not in self.answers:
            assert self.clock.now_ns() < until_ns, "no answer"
            self.step()
        return self.answers.pop(ref)

    def open(self, max_current_ua: int = 3_000, width_us: int = 200) -> None:
        answer = self.ask(
            OpenLease,
            lease=LEASE,
            client="test",
            limits=Limits(max_current_ua=max_current_ua, width_us=width_us),
        )
        assert answer.error is None, answer.reason

    def wanted(self, *calibrations: Calibration) -> tuple[WantedCalibration, ...]:
        """Their names, by which the engine finds them from now on."""
        named = {f"c{number}": made for number, made in enumerate(calibrations)}
        self.given.update(named)
        return tuple(WantedCalibration(name=name) for name in named)

    def open_with(self, *calibrations: Calibration) -> Answer:
        """A lease with these."""
        wanted = self.wanted(*calibrations)
        return self.ask(OpenLease, lease=LEASE, client="test", calibrations=wanted)

    def try_wearer_stop(self) -> None:
        """Press and release, as before the first arming."""
        self.fake.world.press("wearer_stop")
        self.run_ms(5)
        self.fake.world.release("wearer_stop")
        self.run_ms(5)

    def arm(self) -> None:
        if self.engine.components.loaded.board.guards.wearer_stop != "absent":
            self.try_wearer_stop()
        answer = self.ask(ArmBoard)
        assert answer.error is None, answer.reason

    def send(self, **fields: Any) -> int:
        """A frame with a fresh seq; returns its ref."""
        self._seq += 1
        ref = self.next_ref()
        frame = Frame(**{"lease": LEASE, "seq": self._seq, **fields})
        assert self.frames.send(NewFrame(ref=ref, frame=frame))
        return ref

    def show(self, **fields: Any) -> Answer:
        """A frame, and its answer."""
        return self.wait_for(self.send(**fields))

    def hold(self, duration_ms: float, **fields: Any) -> None:
        """The same frame again and again, for so long."""
        until_ns = self.clock.now_ns() + int(duration_ms * 1e6)
        while self.clock.now_ns() < until_ns:
            answer = self.show(**fields)
            assert answer.error is None, answer.reason
            self.run_ms(min(60.0, (until_ns - self.clock.now_ns()) / 1e6))

    def attach_next_gateway(
        self, frames_of: Callable[[socket.socket], Channel[NewFrame]] | None = None
    ) -> None:
        """After the engine has lost the one before. `frames_of` makes its end of the frames."""
        assert not self.engine.has_gateway
        self.close_link()
        self.commands, self.frames, self._engine_ends = _attach_gateway(self.engine, frames_of)

    def close_link(self) -> None:
        """As the end of the engine's process does, and of the gateway's."""
        for channel in (self.commands, self.frames, *self._engine_ends):
            channel.close()

    def close(self) -> tuple[str, ...]:
        """The engine's end, and the fake's; what did not work, and what must never be done."""
        problems = (*self.engine.supervisor.end(), *self.fake.violations)
        self.close_link()
        return problems

    @property
    def records(self) -> list[dict[str, Any]]:
        """The trace so far, its header left out."""
        return self.followed.records()[1:]

    def trace(self) -> list[dict[str, Any]]:
        """The whole trace so far, its header first."""
        return list(self.followed.records())

    def body(self) -> list[dict[str, Any]]:
        """The trace's body records so far."""
        return [record for record in self.records if record.get("bus") == "body"]

    @property
    def last_seq(self) -> int:
        """Of the last frame sent."""
        return self._seq

    @property
    def state(self) -> str:
        return self.engine.supervisor.states.state


def turn(engine: Engine) -> None:
    """One step, and all that follow until neither a scan nor a measurement is under way."""
    engine.step()
    while not engine.is_between_scans:
        engine.step()


def make(
    board: str | None = None,
    *,
    electrodes: int | None = None,
    array: str | None = None,
    loaded: LoadedConfig | None = None,
    body: Touchable | None = None,
    is_traced: bool = True,
    faults: Sequence[Fault] = (),
    stabilizers: Sequence[Stabilizer] | None = None,
    wrap: Callable[[Backend], Backend] = lambda backend: backend,
    untested: Callable[[], str | None] = lambda: None,
    tell: Callable[[str], object] = lambda _: None,
    machine_clock: SteppedClock | None = None,
    processor: Processor | None = None,
    machine: MachineModel = PI4,
    supply_note: SupplyNote | None = None,
    reader: CalibrationReader | None = None,
) -> EngineRig:
    """An engine that has begun, with a gateway attached. `wrap` may put something before a port;
    without a `body` of the caller's the skin is a dry fingertip that only conducts. With a
    `machine_clock` the board has a clock of its own beside it, as `etd run --board fake` has. With
    a `processor` computing takes time. `reader` None: of what is in `given`.
    """
    loaded = loaded or fake_config(board=board, array=array, electrodes=electrodes)
    late_ns = None if processor is None else machine.wake_late
    clock = machine_clock or SteppedClock(processor=processor, wake_late_ns=late_ns)
    board_clock = clock if machine_clock is None else LiveClock(clock)
    sink = io.BytesIO()
    outputs = loaded.array.outputs()
    fake = FakeBoard(
        loaded.board,
        board_clock,
        body or fingertip_body(loaded.board, len(outputs)),
        electrodes=outputs,
        trace=Trace(sink if is_traced else None),
        faults=faults,
        sensors=loaded.array.pressure,
        machine=machine,
    )
    return rig_on(
        *(loaded, fake, clock, sink, wrap, stabilizers, untested, tell, supply_note, board_clock),
        reader=reader,
    )


def rig_on(
    loaded: LoadedConfig,
    fake: FakeBoard,
    clock: SteppedClock,
    sink: io.BytesIO,
    wrap: Callable[[Backend], Backend] = lambda backend: backend,
    stabilizers: Sequence[Stabilizer] | None = None,
    untested: Callable[[], str | None] = lambda: None,
    tell: Callable[[str], object] = lambda _: None,
    supply_note: SupplyNote | None = None,
    board_clock: BoardClock | None = None,
    reader: CalibrationReader | None = None,
) -> EngineRig:
    """The same on a board that is there, whose lines nothing holds."""
    ports = fake.request(line_setup(loaded.board), spi_setup(loaded.board))
    board_clock = board_clock or clock
    backend = Backend(
        "fake",
        *(ports.spi, ports.gpio, ports.i2c, board_clock, ports.marker, ports.close),
        host_clock=board_clock.host,
        codec=codec_of(loaded.board.source),
        wakeups=board_clock.wakeups,
        troubles=lambda: fake.world.host.health().troubles,
        scan_core=fake.world.host.scan_core,
    )
    given: dict[str, Calibration] = {}
    engine = Engine(
        loaded,
        wrap(backend),
        stabilizers=stabilizers,
        untested=untested,
        supply_note=supply_note,
        calibrations=reader or GivenCalibrations(given),
    )
    engine.supervisor.begin(tell)
    link = _attach_gateway(engine)
    return EngineRig(engine, fake, clock, sink, *link, given, supply_note=supply_note)


def _attach_gateway(
    engine: Engine, frames_of: Callable[[socket.socket], Channel[NewFrame]] | None = None
) -> tuple[Channel[ToGateway], Channel[ToGateway], EngineEnds]:
    """The gateway's ends of a new link, for commands and frames, and the engine's."""
    mine, theirs = (socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2))
    to_engine: Channel[ToEngine] = Channel(theirs[0], ToEngine)
    frames: Channel[NewFrame] = (
        Channel(mine[0], NewFrame) if frames_of is None else frames_of(mine[0])
    )
    engine.attach(to_engine, frames)
    return Channel(theirs[1], ToGateway), Channel(mine[1], ToGateway), (to_engine, frames)
