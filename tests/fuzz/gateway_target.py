"""Target: bytes to a whole gateway, from clients on its sockets and from the engine behind it.

Owns: what bytes do in a gateway's world, and the judgment: it lives on, the engine gets only what
is whole and due, and a client that asks properly is answered. Must not know: how it decodes.
"""

from __future__ import annotations

import contextlib
import json
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from etd.gateway.config import GatewayConfig
from etd.gateway.server import Gateway
from etd.protocol.errors import Undecodable
from etd.protocol.frame import check_shape
from etd.protocol.link import NewFrame, OpenLease, StopNow
from etd.protocol.zmtp import Reader
from fuzz.choices import Choices
from fuzz.frame_bounds import check_frame
from fuzz.message_targets import engine_messages, request_seeds
from fuzz.target import Target
from gateway_rig import HandClock
from raw_client import connected, hello, part, poured
from read_in_place import read_in_place
from scripted_engine import ELECTRODES, ScriptedEngine, full_answer

_SOCKETS = (("control", "DEALER"), ("frames", "PUSH"), ("telemetry", "SUB"))
_MOST_CLIENTS = 6
_MOST_ACTS = 40
_TURNS = 50
_WALL_NS = 1_790_000_000_000_000_000
#: In a request, the token of the lease that was opened last.
_LEASE = b"0123456789abcdef0123456789abcdef"


class _World:
    """A gateway and what is around it, for one input."""

    def __init__(self, root: Path) -> None:
        self.folder = root / "run"
        self.folder.mkdir(mode=0o750)
        self.clock = HandClock()
        self.engine = ScriptedEngine(self.folder)
        config = GatewayConfig(name="fuzz", runtime_folder=self.folder, state_dir=root / "state")
        self.gateway = Gateway(config, self.clock, self._read_clocks, reader=read_in_place(config))
        self.clients: list[socket.socket] = []
        #: Whether the engine has a stop that it has not answered.
        self.is_stopping = False
        self._judged = 0
        self._lease = b""
        self._last_seq = -1
        self.turns(4)

    def _read_clocks(self) -> tuple[int, int, int]:
        now_ns = self.clock.now_ns()
        return now_ns, _WALL_NS + now_ns, 0

    def turns(self, count: int = 1) -> None:
        for _ in range(count):
            self.gateway.step(0)
            try:
                self.engine.step()
            except Undecodable as undecodable:
                raise AssertionError("the engine got what it cannot decode") from undecodable
            self._judge()

    def _judge(self) -> None:
        """What the engine heard since the last turn."""
        heard = self.engine.heard[self._judged :]
        self._judged = len(self.engine.heard)
        for message in heard:
            if isinstance(message, StopNow):
                self.is_stopping = self.engine.answer is not full_answer
            if isinstance(message, OpenLease):
                self._lease, self._last_seq = message.lease.encode(), -1
            elif isinstance(message, NewFrame):
                check_frame(message.frame)
                check_shape(message.frame, ELECTRODES)
                assert message.frame.lease.encode() == self._lease
                assert message.frame.seq > self._last_seq
                if not message.frame.preview:
                    self._last_seq = message.frame.seq

    def with_lease(self, data: bytes) -> bytes:
        return data.replace(_LEASE, self._lease or _LEASE)

    def connect(self, name: str) -> socket.socket | None:
        try:
            return connected(self.folder / f"{name}.sock")
        except (BlockingIOError, ConnectionRefusedError):
            return None

    def ask(self, request: dict[str, Any]) -> list[dict[str, Any]]:
        """A proper client of its own; what it is answered first."""
        client = self.connect("control")
        assert client is not None, "the gateway lets no client in"
        reader, answers = Reader(b"ROUTER", 1_000_000), list[dict[str, Any]]()
        with client:
            poured(client, hello("DEALER") + part(json.dumps(request).encode()))
            for _ in range(_TURNS):
                self.turns()
                if answers:
                    break
                with contextlib.suppress(BlockingIOError):
                    reader.feed(client.recv(1_000_000))
                while (taken := reader.take()) is not None:
                    answers += [json.loads(taken[0][-1])] if taken[0] else []
        return answers

    def close(self) -> None:
        for client in self.clients:
            client.close()
        self.gateway.close()
        self.engine.close()


def _act(world: _World, choices: Choices) -> None:
    what = choices.number(0, 11)
    if what == 0 and len(world.clients) < _MOST_CLIENTS:
        name, kind = choices.pick(_SOCKETS)
        client = world.connect(name)
        if client is not None:
            world.clients.append(client)
            if choices.is_so():
                poured(client, hello(kind))
    elif what <= 5 and world.clients:
        client, data = choices.pick(world.clients), world.with_lease(_short(choices))
        poured(client, data if what == 1 else part(data, more=what == 2))
    elif what == 6:
        _say(world, msgspec.Raw(_short(choices)))
    elif what == 7:
        world.engine.answer = choices.pick((full_answer, lambda _: None))
    elif what == 8:
        world.clock.t_ns += choices.number(0, 60_000) * 1_000_000
    elif what == 9:
        world.engine.hang_up()
    elif what == 10 and world.clients:
        world.clients.pop().close()
    world.turns()


def _short(choices: Choices) -> bytes:
    return choices.taken(choices.number(0, 511))


def _say(world: _World, message: Any) -> None:
    if world.engine.is_connected:
        world.engine.say(message)


def _play(data: bytes) -> None:
    choices = Choices(data)
    with tempfile.TemporaryDirectory(prefix="etd-fuzz-") as root:
        world = _World(Path(root))
        try:
            for _ in range(_MOST_ACTS):
                if choices.is_over:
                    break
                _act(world, choices)
            _judge_end(world)
        finally:
            world.close()


def _judge_end(world: _World) -> None:
    """It serves the next client, and a stop gets through at once."""
    (status,) = world.ask({"op": "status", "id": "last"})
    assert status["ok"], status
    assert status["id"] == "last"
    if status["status"]["engine"] == "there":
        before = _stops(world)
        world.ask({"op": "stop"})
        # One that is under way may take the next one in.
        assert _stops(world) - before in ((0, 1) if world.is_stopping else (1,))


def _stops(world: _World) -> int:
    return sum(isinstance(message, StopNow) for message in world.engine.heard)


def _seeds() -> Iterator[bytes]:
    connect = [bytes([0, number, 1]) for number in range(len(_SOCKETS))]
    for request in request_seeds():
        if len(request) < 512:
            yield connect[0] + _piece(3, request)
            yield connect[0] + _opened() + _piece(3, request) + bytes([8, 100, 0])
    frame = b'{"op":"frame","lease":"%s","seq":1,"level":[]}' % _LEASE
    for level in (b"[0,0.5,1,0]", b"[0,0.5,1]"):
        data = frame.replace(b"[]", level)
        yield connect[0] + _opened() + _piece(3, data)
        yield connect[0] + connect[1] + _opened() + bytes([3, 1]) + _piece(3, data)[2:]
    yield connect[2] + _piece(3, b"\x01state") + bytes([9])
    yield connect[0] + bytes([7, 1]) + _piece(3, b'"op":"stop"}')
    for message in engine_messages():
        if len(message) < 512:
            yield (
                connect[0] + _recorded() + bytes([6]) + len(message).to_bytes(2, "little") + message
            )


def _piece(what: int, data: bytes) -> bytes:
    """To the first client."""
    return bytes([what, 0]) + len(data).to_bytes(2, "little") + data


def _opened() -> bytes:
    limits = b'{"max_current_ua":900,"width_us":50}'
    return _piece(3, b'{"op":"open","client":"a","limits":%s}' % limits)


def _recorded() -> bytes:
    return _piece(3, b'{"op":"record","do":"start","name":"a"}')


TARGETS = (
    Target(
        "gateway",
        "raw clients and a raw engine at a whole gateway",
        _play,
        _seeds,
        ("daemon/etd/gateway/*.py", "daemon/etd/protocol/*.py"),
        shares=2,
    ),
)
