"""Gateway and engine in one thread, on real sockets, with a living body and time that is stepped.

Owns: giving both their turns while a client waits, so that a client's minutes cost seconds. The
client is the shipped `Session` and the shipped decoders. Must not know: what is tested.
"""

from __future__ import annotations

import dataclasses
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, Unpack

import msgspec
import zmq

from engine_rig import turn
from etd.client.course import Course, Pause
from etd.client.drive import drive
from etd.client.options import FrameOptions, Kind, frame_fields
from etd.client.patterns import PatternOptions, playing_pattern
from etd.client.playing import Played, Playing
from etd.client.presented import Presented
from etd.client.presenting import WAIT_S, presenting
from etd.client.session import Ask, Flow, R, Session
from etd.engine.loop import Engine
from etd.files.calibration_folder import CalibrationFolder
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.pattern import Pattern
from etd.gateway.config import GatewayConfig
from etd.gateway.server import Gateway
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.link import Channel, Listener, NewFrame, ToEngine
from etd.protocol.messages import (
    TELEMETRY_OF_TOPIC,
    FrameReply,
    Halt,
    HelloReply,
    MarkReply,
    Scan,
)
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_body.course import STILL, Script
from etd_body.living import LivingBody
from etd_hal.backend import Backend
from etd_hal.compose import codec_of
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.trace import Trace
from etd_hal.linesetup import line_setup, spi_setup
from followed_trace import FollowedTrace
from read_in_place import ReadInPlace, read_in_place
from stepped_stopper import SteppedStopper

#: The gateway has a turn this often, when nobody waits for it.
_GATEWAY_NS = 4_000_000
#: Nothing stands and nobody asks: time passes in steps, far within what the gateway may be silent.
_STRIDE_NS = 20_000_000
_PATIENCE = 20_000
#: The wall's time when the clock was zero.
WALL_NS = 1_790_000_000_000_000_000
#: Its looks are few, so that minutes cost seconds: no message is overdue here.
_STOPPER_NS = 20_000_000


class SteppedDaemon:
    """See the module. `clock` is the client's too."""

    def __init__(
        self,
        array: str,
        body_seed: int = 1,
        script: Script = STILL,
        stabilize: Settings = NO_STABILIZERS,
        *,
        is_traced: bool = False,
        body: type[LivingBody] = LivingBody,
    ) -> None:
        self.loaded = loaded = _loaded(array, stabilize)
        self._temporary = tempfile.TemporaryDirectory(prefix="etd-")
        self.folder = Path(self._temporary.name)
        self.clock = SteppedClock()
        positions_mm = list(zip(loaded.array.x_mm, loaded.array.y_mm, strict=True))
        source, sink = loaded.board.source, io.BytesIO()
        self.body = body(
            positions_mm,
            leak_ohm=source.leak_ohm,
            compliance_v=source.compliance_v,
            seed=body_seed,
            script=script,
        )
        self.fake = FakeBoard(
            loaded.board,
            self.clock,
            self.body,
            electrodes=loaded.array.outputs(),
            trace=Trace(sink) if is_traced else None,
        )
        #: What was written to the wires.
        self.followed = FollowedTrace(sink)
        ports = self.fake.request(line_setup(loaded.board), spi_setup(loaded.board))
        backend = Backend(
            "fake",
            ports.spi,
            ports.gpio,
            ports.i2c,
            self.clock,
            ports.marker,
            ports.close,
            host_clock=self.clock,
            codec=codec_of(loaded.board.source),
            modelled=lambda: self.fake.ask_body(self.body.take_felt),
        )
        self.calibrations = self.folder / "state" / "calibrations"
        self.engine = Engine(loaded, backend, calibrations=ReadInPlace(self.calibrations))
        SteppedStopper(self.engine, self.clock, _STOPPER_NS)
        self.engine.supervisor.begin()
        self._listener = Listener(self.folder)
        self._engine_ends: tuple[Channel[ToEngine] | Channel[NewFrame], ...] = ()
        config = GatewayConfig(
            name="stepped", runtime_folder=self.folder, state_dir=self.folder / "state"
        )
        self.gateway = Gateway(config, self.clock, self._read_clocks, reader=read_in_place(config))
        self._gateway_ns = 0
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.control = self._socket(zmq.DEALER, "control.sock")
        self.reports = self._socket(zmq.SUB, "telemetry.sock")
        self.reports.setsockopt(zmq.SUBSCRIBE, b"")

    def __enter__(self) -> Self:
        for _ in range(_PATIENCE):
            self.step(1)
            if self.reports.poll(0) and b'"engine":"there"' in self.reports.recv_multipart()[-1]:
                return self
        raise AssertionError("gateway and engine did not meet")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        problems = (*self.engine.supervisor.end(), *self.fake.violations)
        self._context.destroy(linger=0)
        self.gateway.close()
        for channel in self._engine_ends:
            channel.close()
        self._listener.close()
        self._temporary.cleanup()
        assert problems == ()
        assert self.fake.dac_code == 0

    def _read_clocks(self) -> tuple[int, int, int]:
        now_ns = self.clock.now_ns()
        return now_ns, WALL_NS + now_ns, 0

    def step(self, wait_ms: int = 0) -> None:
        """A turn of the engine, and one of the gateway where one is due or waited for."""
        if wait_ms or self.clock.now_ns() - self._gateway_ns >= _GATEWAY_NS:
            self._gateway_ns = self.clock.now_ns()
            self.gateway.step(wait_ms)
        if not self.engine.has_gateway:
            channels = self._listener.accept()
            if channels is not None:
                self._engine_ends = channels
                self.engine.attach(*channels)
        turn(self.engine)

    def now_ns(self) -> int:
        return self.clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """The client sleeps. In strides where nothing stands, which is what makes it fast."""
        while self.clock.now_ns() < deadline_ns:
            if self.engine.components.active.schedule is None:
                stride_ns = self.clock.now_ns() + _STRIDE_NS
                # By the engine's clock, which counts it as rest.
                self.engine.components.clock.sleep_until_ns(min(deadline_ns, stride_ns))
                self.gateway.step(0)
            self.step()

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.sleep_until_ns(deadline_ns)

    def _socket(self, kind: int, name: str) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        socket.connect(f"ipc://{self.folder / name}")
        return socket


def _loaded(array: str, stabilize: Settings) -> LoadedConfig:
    loaded = fake_config(array=array)
    site = msgspec.structs.replace(loaded.body_site, stabilize=stabilize)
    return dataclasses.replace(loaded, body_site=site)


class SteppedDisplay:
    """What a calibration needs of a display and of its telemetry."""

    def __init__(
        self,
        daemon: SteppedDaemon,
        max_current_ua: int | None = None,
        width_us: int | None = None,
        calibration: str | Sequence[str] | None = None,
    ) -> None:
        self._daemon = daemon
        self._session = Session(
            "test", max_current_ua=max_current_ua, width_us=width_us, calibration=calibration
        )

    def arm(self) -> None:
        self._run(self._session.arm(10.0))

    def greet(self) -> HelloReply:
        return self._run(self._session.greet())

    def show_current(
        self, current_ua: Sequence[int], **options: Unpack[FrameOptions]
    ) -> FrameReply:
        return self._show("current_ua", current_ua, options)

    def show_levels(self, level: Sequence[float], **options: Unpack[FrameOptions]) -> FrameReply:
        return self._show("level", level, options)

    def _show(self, kind: Kind, numbers: Sequence[float], options: FrameOptions) -> FrameReply:
        fields = frame_fields(kind, list(numbers), options)
        del fields["sent_ns"]  # of another clock than the daemon's
        return self._run(self._session.frame(fields))

    @property
    def last_seq(self) -> int:
        return self._session.numbers.newest

    def play(self, course: Course[R]) -> R:
        """As `Display` plays one; pauses take the daemon's time."""
        return drive(course, self._do, Refused)

    def _do(self, step: Flow[Any] | Pause) -> object:
        if isinstance(step, Pause):
            self._daemon.sleep_until_ns(self._daemon.now_ns() + int(step.seconds * 1e9))
            return None
        return self._run(step)

    def present(
        self, current_ua: Sequence[int], seconds: float, rate_hz: float, **options: Any
    ) -> Presented:
        return self.play(self.presenting(current_ua, seconds, rate_hz, **options))

    def presenting(
        self,
        current_ua: Sequence[int],
        seconds: float,
        rate_hz: float,
        wait_s: float = WAIT_S,
        after: int | None = None,
        **options: Any,
    ) -> Course[Presented]:
        """`after`: it goes on beside the program, as `Display.begin` has it."""
        given: FrameOptions = {"rate_hz": rate_hz}
        fields = {**frame_fields("current_ua", list(current_ua), given), **options}
        return presenting(self._session, fields, seconds, self._daemon.now_ns, after, wait_s)

    def play_pattern(self, pattern: Pattern, **options: Unpack[PatternOptions]) -> Played:
        """As `Display.play`: reports are heard in its pauses."""
        tell = options.get("tell", lambda _: None)
        on_frame = options.get("on_frame", lambda _: None)
        playing = Playing(self._session, "stepped", self._daemon.now_ns, tell, on_frame)
        course = playing_pattern(self._session, playing, pattern, options)
        return self.play(self._listening(course, playing))

    def _listening(self, course: Course[R], playing: Playing) -> Course[R]:
        try:
            step = next(course)
            while True:
                if isinstance(step, Pause):
                    done: object = self.receive(step.seconds)
                    if isinstance(done, tuple) and isinstance(done[1], Scan | Halt):
                        playing.hear(done[1])
                    step = course.send(None)
                    continue
                try:
                    done = yield step
                except Refused as refusal:
                    step = course.throw(refusal)
                else:
                    step = course.send(done)
        except StopIteration as end:
            result: R = end.value
            return result

    def set_calibration(self, name: str, calibration: Calibration) -> None:
        """As the operator's own process does."""
        CalibrationFolder(self._daemon.calibrations, None).put(name, calibration)

    def disarm(self) -> None:
        self._run(self._session.disarm())

    def keep(self) -> None:
        self._run(self._session.keep())

    def stop(self) -> None:
        self._run(self._session.stop())

    def mark(self, tag: int) -> MarkReply:
        return self._run(self._session.mark(tag))

    def note(self, text: str) -> None:
        self._run(self._session.note(text))

    def start_record(self, name: str) -> None:
        self._run(self._session.start_record(name))

    def stop_record(self) -> None:
        self._run(self._session.stop_record())

    def fetch_record(self, name: str, path: Path) -> Path:
        with path.open("wb") as file:
            self._run(self._session.fetch_record(name, file.write))
        return path

    def close(self) -> None:
        self._run(self._session.close())

    def receive(self, timeout_s: float | None = 0.0) -> tuple[object, object] | None:
        daemon = self._daemon
        until_ns = daemon.clock.now_ns() + int((timeout_s or 0.0) * 1e9)
        while not daemon.reports.poll(0):
            # A report is on its way through threads that step with nobody: wait for it in earnest.
            if (
                daemon.engine.components.active.schedule is None
                and timeout_s
                and daemon.reports.poll(1)
            ):
                break
            if daemon.clock.now_ns() >= until_ns:
                return None
            daemon.step()
        topic, data = daemon.reports.recv_multipart()
        kind: Any = TELEMETRY_OF_TOPIC[topic.decode()]  # type: ignore[index]
        return topic, msgspec.json.decode(data, type=kind)

    def _run(self, flow: Flow[R]) -> R:
        return drive(flow, self._ask, Refused)

    def _ask(self, ask: Ask) -> object:
        self._daemon.control.send(ask.data)
        return self._session.settle(ask, self._answer())

    def _answer(self) -> bytes:
        control = self._daemon.control
        for _ in range(_PATIENCE):
            self._daemon.step(1)
            if control.poll(0):
                return control.recv_multipart()[-1]
        raise AssertionError("no answer")
