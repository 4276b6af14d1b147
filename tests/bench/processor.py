"""What the engine itself costs the processor for a pulse, on ports that cost nothing.

Owns: ports that answer at once on a clock that only they move, and the time between pulses by a
real clock. Must not know: what the figures are compared with.
"""

from __future__ import annotations

import platform
import socket
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from bench.modelled import CURRENT_UA, ELECTRODES, WIDTH_US, loaded_with, messages_of
from engine_rig import turn
from etd.client import clock as real_clock
from etd.engine.loop import Engine
from etd.protocol.frame import Frame
from etd.protocol.link import Alive, ArmBoard, Channel, NewFrame, OpenLease, ToEngine, ToGateway
from etd.protocol.messages import Limits
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile
from etd_hal.compose import codec_of
from etd_hal.cutlatch import LOOKED_NS, NOTED, POWER
from etd_hal.ports import Changes, Clock, Edge, Message, Wait
from etd_hal.unwired import NoMarker

#: A Pi 4 core beside one of the machines that run tests: assumed, from published benchmarks.
PI4_FACTOR = 4.0
REST_US = 200
_WORD_NS, _DELAY_NS, _MESSAGE_NS = 16_000, 300, 10_000
#: What a touched electrode of a fingertip answers: about 10 V at 400 uA.
ADC_CODES_PER_DAC_CODE = 112 / 163
#: The check of the latch is a third of a probe, 100 uA, with nothing connected; nothing else is
#: below this code.
_LOWEST_LOADED_CODE = 60
#: Probes first need room as well.
RATE_HZ = 20.0
#: Above those of the opening.
FIRST_SEQ = 10_000
#: Half a second: contacts are firm then.
WARM_UP = 20


Ends = tuple[Channel[ToGateway], Channel[ToGateway]]
#: What comes back with the outputs live, and with them blanked.
Answers = tuple[tuple[bytes, ...], tuple[bytes, ...]]


@dataclass(frozen=True)
class ProcessorFigures:
    """Of one pulse, everything included that the loop does for it."""

    machine: str
    median_us: float
    p99_us: float
    pulses: int

    def late_us_on_a_pi4(self, rest_us: int) -> float:
        """What the median of a pulse takes there beyond a rest; the rest itself is idle anyhow."""
        return max(0.0, self.median_us * PI4_FACTOR - rest_us)


class FreeClock:
    """Time that ports and sleeps move, and nothing else."""

    def __init__(self) -> None:
        self.t_ns = 1_000_000_000

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.t_ns = max(self.t_ns, deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.sleep_until_ns(deadline_ns)

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        if not wait(0.0):
            self.sleep_until_ns(deadline_ns)


class FreeSpi:
    """Answers at once; notes the real time of every pulse."""

    def __init__(self, clock: FreeClock, gpio: FreeGpio) -> None:
        self._clock = clock
        self._gpio = gpio
        self.begun_ns: list[int] = []
        #: By message, as the engine prepares few.
        self._answers: dict[Message, tuple[int, Answers, bool]] = {}

    def prepare(self, message: Message) -> None:
        pass

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        known = self._answers.get(message)
        if known is None:
            known = message_ns(message), answers(message), not is_unloaded(message)
            self._answers[message] = known
        duration_ns, answer, of_skin = known
        is_blanked = self._gpio.is_blanked
        if of_skin and not is_blanked:
            self.begun_ns.append(real_clock.now_ns())
        self._clock.t_ns += duration_ns
        return answer[is_blanked]


def codes_of(message: Message) -> list[int]:
    """The DAC code of each word."""
    return [
        int.from_bytes(transfer.tx, "big") >> 2 for transfer in message.transfers if transfer.tx
    ]


def is_unloaded(message: Message) -> bool:
    """Whether it is a check of the latch, which is as short as a probe. A pulse of the soft start
    is as weak, and longer.
    """
    held_us = sum(transfer.delay_us for transfer in message.transfers)
    return 0 < max(codes_of(message)) < _LOWEST_LOADED_CODE and held_us < WIDTH_US // 2


@cache
def unloaded_ratio() -> float:
    """ADC codes for a DAC code where the leak alone takes the current."""
    source = loaded_with(REST_US).board.source
    return source.current_of(1) * source.leak_ohm / source.node_uv_per_code


def answers(message: Message) -> Answers:
    """A touched electrode holds the node in proportion to the current, and so does the leak."""
    codes = codes_of(message)
    leak = unloaded_ratio()
    live = leak if is_unloaded(message) else ADC_CODES_PER_DAC_CODE
    return _held(codes, live), _held(codes, leak)


def _held(codes: Sequence[int], ratio: float) -> tuple[bytes, ...]:
    sample = (int(max(codes) * ratio) << 2).to_bytes(2, "big")
    return (b"\0\0", *(sample,) * (len(codes) - 1))


def message_ns(message: Message) -> int:
    """How long a message lasts, by round figures of a Raspberry Pi 4."""
    words = sum(1 for transfer in message.transfers if transfer.tx)
    pauses = len(message.transfers) - words
    held_ns = sum(transfer.delay_us for transfer in message.transfers) * 1_000
    return _MESSAGE_NS + (words - 1) * _WORD_NS + pauses * _DELAY_NS + held_ns


class Blanking:
    """Whether the outputs are blanked, by the calls that set lines."""

    def __init__(self, board: BoardFile) -> None:
        line = board.used_lines()["BL"]
        self._blanking, self._live = (line, 0), (line, 1)
        self.is_blanked = True

    def follow(self, changes: Changes) -> None:
        if self._live in changes:
            self.is_blanked = False
        elif self._blanking in changes:
            self.is_blanked = True


class FreeGpio(Blanking):
    """Takes no time."""

    def __init__(self) -> None:
        super().__init__(loaded_with(REST_US).board)
        self._levels: dict[int, int] = {}

    def set(self, changes: Changes) -> None:
        self._levels.update(changes)
        self.follow(changes)

    def get(self, line: int) -> int:
        return self._levels.get(line, 1)

    def edges(self) -> tuple[Edge, ...]:
        return ()


def measure(scans: int, stabilize: Settings = NO_STABILIZERS) -> ProcessorFigures:
    """Pulses of `scans` scans of 64 electrodes, the first of them left out to warm up."""
    clock = FreeClock()
    gpio = FreeGpio()
    spi = FreeSpi(clock, gpio)
    engine, gateway, ends = armed(clock, spi, gpio, stabilize)
    spi.begun_ns.clear()
    periods_us: list[float] = []
    messages = messages_of(stabilize)
    for seq in range(FIRST_SEQ, FIRST_SEQ + WARM_UP + scans):
        spi.begun_ns.clear()
        play_one(engine, gateway, seq)
        if seq >= FIRST_SEQ + WARM_UP:
            assert len(spi.begun_ns) == ELECTRODES * messages
            between = pairwise(spi.begun_ns[::messages])
            periods_us += [(after - before) / 1_000 for before, after in between]
        clock.t_ns += int(1e9 / RATE_HZ)
    engine.supervisor.end()
    for channel in ends:
        channel.close()
    periods_us.sort()
    name = f"{platform.node()} ({platform.machine()}, Python {platform.python_version()})"
    p99_us = periods_us[int(0.99 * (len(periods_us) - 1))]
    return ProcessorFigures(name, statistics.median(periods_us), p99_us, len(periods_us))


def play_one(engine: Engine, gateway: Ends, seq: int) -> None:
    """A frame of one scan."""
    gateway[1].send(NewFrame(ref=0, frame=_frame(seq)))
    gateway[0].send(Alive())
    check_stopper(engine)
    step, active = engine.step, engine.components.active
    while active.schedule is None:
        step()
    while active.schedule is not None:
        step()
    _drain(gateway[0])


def _frame(seq: int) -> Frame:
    return Frame(
        lease="bench",
        seq=seq,
        current_ua=(CURRENT_UA,) * ELECTRODES,
        width_us=WIDTH_US,
        rate_hz=RATE_HZ,
        pulses=1,
        ttl_ms=1_000,
    )


def armed(
    clock: FreeClock,
    spi: FreeSpi,
    gpio: FreeGpio,
    stabilize: Settings,
    host_clock: Clock | None = None,
) -> tuple[Engine, Ends, tuple[Channel[ToEngine] | Channel[NewFrame] | Channel[ToGateway], ...]]:
    loaded = loaded_with(REST_US, stabilize=stabilize)
    backend = Backend(
        "fake",
        *(spi, gpio, None, clock, NoMarker(), lambda: None),
        host_clock=host_clock or clock,
        codec=codec_of(loaded.board.source),
    )
    engine = Engine(loaded, backend)
    engine.supervisor.begin()
    first, second = (socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2))
    commands: Channel[ToEngine] = Channel(first[0], ToEngine)
    frames: Channel[NewFrame] = Channel(second[0], NewFrame)
    engine.attach(commands, frames)
    gateway: Ends = (Channel(first[1], ToGateway), Channel(second[1], ToGateway))
    limits = Limits(max_current_ua=3_000, width_us=200)
    gateway[0].send(OpenLease(ref=1, lease="bench", client="bench", limits=limits))
    gateway[0].send(ArmBoard(ref=2))
    while engine.supervisor.states.state != "ARMED":
        _turn(engine)
        _drain(gateway[0])
    _open_up(engine, gateway)
    return engine, gateway, (commands, frames, *gateway)


def _open_up(engine: Engine, gateway: Ends) -> None:
    """Hold frames until the opening lets the current through."""
    seq = 0
    while engine.components.soft_start.ceiling_ua < CURRENT_UA:
        gateway[0].send(Alive())
        gateway[1].send(NewFrame(ref=0, frame=_frame(seq)))
        for _ in range(20):
            _turn(engine)
            _drain(gateway[0])
        seq += 1
    gateway[0].send(Alive())


def _turn(engine: Engine) -> None:
    """With a look of the stopper, whose thread is not part of the figures."""
    check_stopper(engine)
    turn(engine)


def check_stopper(engine: Engine) -> None:
    """As the stopper leaves it."""
    words = engine.components.board.cut.words
    words[LOOKED_NS] = engine.components.backend.clock.now_ns()
    words[NOTED] = words[POWER]


def _drain(channel: Channel[ToGateway]) -> None:
    while channel.receive() is not None:
        pass
