"""Target: bytes to whole steps of an engine on the fake board.

Owns: what bytes do to an engine and its world. The judge is the body (`body_judge.py`). Must not
know: how the engine decides, what must hold.

Faults of wires and chips are in it as far as they can change no current; what the others let
through is measured by `make campaign`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any

import msgspec

import engine_rig
from body_judge import Judge
from campaign.account import AccountedBody
from charge_witness import Witness, even_skin
from engine_rig import LEASE
from engine_scenes import balancing, opened_to
from etd.files.configuration import fake_config
from etd.protocol.frame import Frame
from etd.protocol.link import (
    ArmBoard,
    AskAccount,
    Channel,
    ClearHalt,
    CloseLease,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    NewFrame,
    OpenLease,
    RecordPulses,
    SayFelt,
    SetMark,
    StopNow,
    ToGateway,
)
from etd.protocol.messages import Limits
from etd_body.electrode import skin
from etd_hal.bench import StopName
from etd_hal.fake import faults
from fuzz.choices import Choices
from fuzz.message_targets import to_engine_seeds
from fuzz.target import Target

ELECTRODES = 8
_BOARDS = ("kajimoto-hv507", "reference-hv507", "feetthrough-relay")
#: The one with all guards.
_GUARDED = 1
_MOST_ACTS = 40
_MOST_NS = 2_000_000_000
_STOPS: tuple[StopName, ...] = ("emergency_stop", "wearer_stop")
#: None: the site's, which may have both phases fired.
_POLARITIES = ("anodic", "cathodic", "biphasic", "biphasic_cathodic_first", None)
#: The same boards at a site that balances what leaves more than this, which is hardly anything.
_BALANCED_NC = 300
_FAULTS: tuple[faults.Fault, ...] = (
    faults.SpiError(at_transfer=0),
    faults.SpiShort(),
    faults.RailOff(0.5),
    faults.RailOff(1.3),
    faults.AdcStuck(0),
    faults.AdcStuck(4095),
    faults.AdcNoise(sigma=20.0),
    faults.MisoStuck(1),
    faults.MonitorStuck(rail_v=300.0),
    faults.HeartbeatIgnored(),
)


class _World:
    """An engine, its board and its gateway, for one input."""

    def __init__(self, board: str, *, balances: bool) -> None:
        loaded = fake_config(board=board, electrodes=ELECTRODES)
        loaded = balancing(loaded, _BALANCED_NC) if balances else loaded
        body = even_skin(loaded.board, ELECTRODES)
        witness, accounted = Witness(body), AccountedBody(body)
        self.rig = engine_rig.make(
            loaded=loaded, body=accounted, wrap=witness.wrap, is_traced=False
        )
        self.judge = Judge(self.rig, witness, accounted)
        self._seq = 0

    def send(self, kind: Callable[..., Any], **fields: Any) -> None:
        message = kind(ref=self.rig.next_ref(), **fields)
        self.judge.heard(msgspec.msgpack.encode(message))
        self.rig.commands.send(message)

    def send_bytes(self, channel: Channel[ToGateway], data: bytes) -> None:
        """In one datagram. The other end may have hung up."""
        if data and channel.is_open:
            try:
                os.write(channel.fileno(), data)
            except OSError:
                channel.close()

    def frame(self, choices: Choices) -> None:
        currents = (0, 0, 100, 400, 1_000, 3_000, 10_000)
        fields: dict[str, Any] = {
            "current_ua": tuple(choices.pick(currents) for _ in range(ELECTRODES)),
            "width_us": choices.number(20, 200),
            "polarity": choices.pick(_POLARITIES),
            "rate_hz": choices.number(1, 2_000) / 10,
            "ttl_ms": choices.number(1, 1_000),
            "allow_slower": True,
            "strict": choices.is_so(),
            "on_trigger": choices.number(0, 7) == 7,
            "preview": choices.number(0, 7) == 7,
            "account": choices.is_so(),
        }
        if choices.is_so():
            fields["pulses"] = choices.number(1, 5)
        self._seq += 1
        frame = Frame(lease=LEASE, seq=self._seq, **fields)
        # Whether there is room for it or not.
        self.rig.frames.send(NewFrame(ref=self.rig.next_ref(), frame=frame))

    def fault(self, choices: Choices) -> None:
        try:
            self.rig.fake.world.put_in(choices.pick(_FAULTS))
        except ValueError:
            return  # this board has nothing there
        self.judge.is_whole = False

    def press(self, choices: Choices, is_open: bool) -> None:
        stop = choices.pick(_STOPS)
        if getattr(self.rig.engine.components.loaded.board.guards, stop) != "absent":
            world = self.rig.fake.world
            (world.press if is_open else world.release)(stop)

    def run(self, duration_ms: int) -> None:
        """In turns of a millisecond, or of a scan, each judged."""
        until_ns = self.rig.clock.now_ns() + duration_ms * 1_000_000
        while self.rig.clock.now_ns() < until_ns:
            self.rig.run_ms(1)
            self.judge.look()

    def gateway_comes(self) -> None:
        if not self.rig.engine.has_gateway:
            self.rig.attach_next_gateway()
        self.rig.is_gateway_alive = True


def _open(world: _World, choices: Choices) -> None:
    limits = Limits(
        max_current_ua=choices.pick((1_000, 300, 1_000, 10_000)), width_us=choices.number(20, 200)
    )
    world.send(OpenLease, lease=LEASE, client="fuzz", limits=limits)


def _command(world: _World, choices: Choices) -> None:
    kind: Any = choices.pick((CloseLease, KeepLease, DisarmBoard, MeasureContact, AskAccount))
    more = {"seq": choices.number(0, 5)} if kind is AskAccount else {}
    world.send(kind, lease=LEASE, **more)


def _say(world: _World, choices: Choices) -> None:
    world.send(SayFelt, answer="too_strong", electrodes=choices.pick((None, (0,), (99,))))
    world.send(SetMark, lease=LEASE, tag=choices.number(0, 9))
    world.send(RecordPulses, is_on=choices.is_so())


def _skin(world: _World, choices: Choices) -> None:
    electrode, kohm = choices.number(0, ELECTRODES - 1), choices.number(0, 255)
    world.judge.is_even = False
    if kohm == 0:
        world.rig.fake.world.lift(electrode)
    else:
        world.rig.fake.world.touch(electrode, skin(kohm * 1_000.0))


def _raw(world: _World, choices: Choices) -> None:
    channel = world.rig.commands if choices.is_so() else world.rig.frames
    data = choices.taken(choices.number(0, 1_023))
    world.judge.heard(data)
    world.send_bytes(channel, data)


_ACTS: tuple[Callable[[_World, Choices], None], ...] = (
    lambda world, choices: world.run(choices.number(1, 200)),
    lambda world, choices: world.frame(choices),
    _raw,
    _open,
    lambda world, _: world.send(ArmBoard),
    _command,
    lambda world, _: world.send(StopNow, client="fuzz"),
    lambda world, _: world.send(ClearHalt),
    lambda world, choices: world.press(choices, is_open=True),
    lambda world, choices: world.press(choices, is_open=False),
    _skin,
    lambda world, choices: world.fault(choices),
    lambda world, _: world.rig.fake.world.mend(),
    lambda world, choices: world.rig.clock.spend(choices.number(0, 1_000) * 1_000_000),
    lambda world, _: world.rig.commands.close(),
    lambda world, _: world.gateway_comes(),
    lambda world, _: setattr(world.rig, "is_gateway_alive", False),
    _say,
    # As if so much had been felt: the rise from nothing takes longer than an input lasts.
    lambda world, _: opened_to(world.rig, 3_000),
)


def _play(data: bytes) -> None:
    choices = Choices(data)
    number = choices.number(0, 2 * len(_BOARDS) - 1)
    world = _World(_BOARDS[number % len(_BOARDS)], balances=number >= len(_BOARDS))
    end_ns = world.rig.clock.now_ns() + _MOST_NS
    try:
        for _ in range(_MOST_ACTS):
            if choices.is_over or world.rig.clock.now_ns() > end_ns:
                break
            choices.pick(_ACTS)(world, choices)
            world.run(2)
        world.judge.look()
    finally:
        problems = world.rig.close()
    world.judge.end(problems)


def _act(number: int, *chosen: int) -> bytes:
    """Of `_ACTS`, and what it chooses."""
    return bytes([number, *chosen])


_REACHED = 18
_WAIT, _FRAME, _OPEN, _ARM, _STOP, _CLEAR, _PRESS, _RELEASE = 0, 1, 3, 4, 6, 7, 8, 9
#: Until the supply is up and all electrodes are looked at, by board.
_WAITS_TO_ARM = (0, 3, 4)
_FAULT, _MEND, _STALL, _END, _COMES, _HANGS = 11, 12, 13, 14, 15, 16


def _armed(board: int) -> bytes:
    stop = _act(_PRESS, 1) + _act(_RELEASE, 1) if board % len(_BOARDS) == _GUARDED else b""
    wait = _act(_WAIT, 99) + _act(_WAIT, 169) * _WAITS_TO_ARM[board % len(_BOARDS)]
    return bytes([board]) + _act(_OPEN, 2, 80) + stop + _act(_ARM) + wait


def _frame(polarity: int = 0, lit: int = 5) -> bytes:
    """Two electrodes, more than the limit by default, 100 us, 50 Hz, half a second."""
    return _act(_FRAME, 0, lit, 0, 0, lit, 0, 0, 0, 80, polarity, 243, 1, 244, 1, 0, 0, 0, 1, 0)


def _seeds() -> Iterator[bytes]:
    for board in range(2 * len(_BOARDS)):
        begun = _armed(board)
        for polarity in range(len(_POLARITIES)):
            yield (
                begun + _frame(polarity) + _act(_WAIT, 199) + _frame(polarity, 3) + _act(_WAIT, 99)
            )
            yield begun + _act(_REACHED) + _frame(polarity) + _act(_WAIT, 99)
        yield begun + _frame() + _act(_STOP) + _act(_CLEAR) + _act(_ARM) + _act(_WAIT, 50)
        yield begun + _frame() + _act(_END) + _act(_WAIT, 20) + _act(_COMES) + _act(_ARM)
        yield begun + _frame() + _act(_HANGS) + _act(_WAIT, 199) * 2
        yield begun + _act(5, 3) + _act(_WAIT, 99) + _act(5, 2) + _frame() + _act(17, 0, 5, 1)
        for fault in range(len(_FAULTS)) if board == _GUARDED else ():
            yield begun + _frame() + _act(_FAULT, fault) + _act(_WAIT, 99) + _act(_MEND)
        yield begun + _frame() + _act(_STALL, 44, 1) + _act(_WAIT, 20) + _act(10, 0, 0) + _frame()
        yield begun + _frame() + _act(_PRESS, 0) + _act(_WAIT, 9) + _act(_RELEASE, 0) + _act(_CLEAR)
    for message in to_engine_seeds():
        length = len(message).to_bytes(2, "little")
        if len(message) < 1_000:
            is_command = b"NewFrame" not in message
            yield _armed(0) + _act(2, is_command) + length + message + _act(_WAIT, 20)


TARGETS = (
    Target(
        "engine",
        "whole steps of an engine on the fake board: messages, faults, stops, stalls, skin",
        _play,
        _seeds,
        (
            *(f"daemon/etd/engine/{name}.py" for name in ("commands", "frame_queue", "poller")),
            *("daemon/etd/engine/gateway_link.py", "daemon/etd/protocol/*.py"),
        ),
        most_bytes=1_024,
        most_s=60.0,
        shares=4,
        guiding=(
            *(f"etd.engine.{name}" for name in ("accounts", "commands", "feeling", "frame_queue")),
            *("etd.engine.power_up", "etd.engine.supervisor"),
            *("etd.planning.plan", "etd.planning.scan_rate", "etd.safety.state"),
        ),
    ),
)
