"""Strangers by the thousand, and strangers without an end: the gateway keeps its bounds.

Owns: the descriptors and the memory of the gateway's process under each, and that a stop is heard.
"""

from __future__ import annotations

import json
import resource
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zmq

from command_rig import WITHIN_S, Command, CommandRig, command_rig
from etd.client import clock
from raw_client import connected, connected_by_others, hello, part, poured

pytestmark = pytest.mark.slow

CONNECTS = 2_000
MOST_DESCRIPTORS = 300
DESCRIPTORS_AT_REST = 20
MOST_MB = 100.0
#: Of what never ends, so much is sent or so long, whichever comes first.
ENDLESS_BYTES, ENDLESS_S = 300_000_000, 2.0
#: Of the process under systemd: the bound must hold far below it.
DESCRIPTOR_LIMIT = 1_024
STOP_WITHIN_S = 20.0
#: And who speaks there.
KINDS = {"control": "DEALER", "frames": "PUSH", "telemetry": "SUB"}


@pytest.fixture(scope="module")
def rig() -> Iterator[CommandRig]:
    before, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, 3 * CONNECTS), most))
    with command_rig() as made:
        yield made
    resource.setrlimit(resource.RLIMIT_NOFILE, (before, most))


@pytest.fixture(scope="module")
def daemon(rig: CommandRig) -> Iterator[Command]:
    """One for all strangers, who come one kind after another: what they leave must do no harm."""
    with rig.daemon() as command:
        yield command


class Gateway:
    """That of a running daemon, seen from outside."""

    def __init__(self, rig: CommandRig, command: Command, stack: ExitStack) -> None:
        self.pid = command.children()["gateway"]
        resource.prlimit(self.pid, resource.RLIMIT_NOFILE, (DESCRIPTOR_LIMIT, DESCRIPTOR_LIMIT))
        self.folder = rig.folder / "run" / "etd" / "main"
        self.rig = rig
        self._stack = stack
        self._context = stack.enter_context(zmq.Context())
        self.early = self.client()
        self.ask(self.early, b'{"op":"status"}')

    def path(self, name: str) -> Path:
        return self.folder / f"{name}.sock"

    def client(self) -> zmq.Socket[bytes]:
        made = self._stack.enter_context(self._context.socket(zmq.DEALER))
        made.setsockopt(zmq.LINGER, 0)
        made.connect(f"ipc://{self.path('control')}")
        return made

    def ask(self, client: zmq.Socket[bytes], request: bytes) -> dict[str, dict[str, object]]:
        client.send(request)
        assert client.poll(int(STOP_WITHIN_S * 1e3)), "no answer"
        reply = json.loads(client.recv())
        assert reply["ok"], reply
        return dict(reply)

    def counters(self, client: zmq.Socket[bytes] | None = None) -> dict[str, int]:
        reply = self.ask(client or self.early, b'{"op":"status"}')
        counters = reply["status"]["counters"]
        assert isinstance(counters, dict)
        return counters

    @property
    def descriptors(self) -> int:
        return len(list(Path(f"/proc/{self.pid}/fd").iterdir()))

    @property
    def resident_mb(self) -> float:
        lines = Path(f"/proc/{self.pid}/status").read_text().splitlines()
        (line,) = [line for line in lines if "VmRSS" in line]
        return int(line.split()[1]) / 1024


@pytest.fixture
def gateway(rig: CommandRig, daemon: Command) -> Iterator[Gateway]:
    with ExitStack() as stack:
        yield Gateway(rig, daemon, stack)


def crowd(
    gateway: Gateway, name: str, stack: ExitStack, count: int, first: bytes = b""
) -> list[socket.socket]:
    """So many connections, held at this end, each with these first bytes."""
    return [endless(gateway, name, stack, first) for _ in range(count)]


@pytest.mark.parametrize("is_silent", [True, False], ids=["silent", "greeting"])
@pytest.mark.parametrize("name", KINDS)
def test_two_thousand_connects_leave_room_for_a_stop(
    gateway: Gateway, name: str, is_silent: bool
) -> None:
    with ExitStack() as stack:
        crowd(gateway, name, stack, CONNECTS, b"" if is_silent else hello(KINDS[name]))

        assert gateway.descriptors < MOST_DESCRIPTORS
        gateway.ask(gateway.early, b'{"op":"stop"}')
        assert gateway.counters()[f"{name}_turned_away"] > 0
        # Those who greet are clients, all of this process: another process's stop has room.
        said = gateway.rig.run("stop")
        assert said.status == 0, said.err
    gateway.ask(gateway.client(), b'{"op":"hello"}')


def test_a_user_whose_processes_hold_all_connections_can_stop(gateway: Gateway) -> None:
    """Also where they have taken the room of those that are heard only to stop."""
    # While this process has left connections of another test behind, it is the one that has most.
    while gateway.descriptors > DESCRIPTORS_AT_REST:
        gateway.ask(gateway.early, b'{"op":"status"}')
    with ExitStack() as stack:
        for made in connected_by_others(gateway.path("control"), 120):
            poured(stack.enter_context(made), hello("DEALER"))
            gateway.ask(gateway.early, b'{"op":"status"}')
        assert gateway.descriptors < MOST_DESCRIPTORS
        said = gateway.rig.run("stop")
        assert said.status == 0, said.err


ENDLESS = {
    "parts without bytes": ("control", hello("DEALER"), part(b"", more=True) * 8_000),
    "parts of bytes": ("control", hello("DEALER"), part(b"x" * 60_000, more=True)),
    "parts of a frame": ("frames", hello("PUSH"), part(b"", more=True) * 8_000),
    "parts of a subscription": ("telemetry", hello("SUB"), part(b"\1", more=True) * 5_000),
    "replies not read": ("control", hello("DEALER"), part(b'{"op":"' + b"y" * 60_000 + b'"}')),
    "long keys": ("control", hello("DEALER"), part(b'{"op":"hello","' + b"y" * 60_000 + b'":1}')),
}


@pytest.mark.parametrize(("name", "greeting", "more"), ENDLESS.values(), ids=ENDLESS)
def test_what_never_ends_fills_no_memory(
    gateway: Gateway, name: str, greeting: bytes, more: bytes
) -> None:
    with ExitStack() as stack:
        clients = [endless(gateway, name, stack, greeting) for _ in range(70)]
        most_mb = flooded(gateway, clients, [more] * len(clients))

        assert most_mb < MOST_MB
        gateway.ask(gateway.early, b'{"op":"stop"}')


def test_with_few_descriptors_the_gateway_lives_and_serves_who_was_there(gateway: Gateway) -> None:
    resource.prlimit(gateway.pid, resource.RLIMIT_NOFILE, (40, DESCRIPTOR_LIMIT))
    with ExitStack() as stack:
        crowd(gateway, "control", stack, 200)
        gateway.ask(gateway.early, b'{"op":"stop"}')
        gateway.ask(gateway.client(), b'{"op":"stop"}')


def test_a_stop_is_heard_among_all_of_them_at_once(gateway: Gateway) -> None:
    with ExitStack() as stack:
        for name in KINDS:
            crowd(gateway, name, stack, CONNECTS // 3)
        clients, mores = [], []
        for name, greeting, more in ENDLESS.values():
            for _ in range(10):
                clients.append(endless(gateway, name, stack, greeting))
                mores.append(more)
        most_mb = flooded(gateway, clients, mores)

        assert gateway.descriptors < MOST_DESCRIPTORS
        assert most_mb < MOST_MB
        gateway.ask(gateway.early, b'{"op":"stop"}')
        said = gateway.rig.run("stop")
        assert said.status == 0, said.err


def test_subscriptions_without_end_fill_no_memory(gateway: Gateway) -> None:
    with ExitStack() as stack:
        clients = [endless(gateway, "telemetry", stack, hello("SUB")) for _ in range(2)]
        topics = [
            b"".join(part(b"\x01%056d" % (million + n)) for n in range(20_000))
            for million in (1_000_000, 2_000_000)
        ]
        most_mb = flooded(gateway, clients, topics)

        assert most_mb < MOST_MB
        gateway.ask(gateway.early, b'{"op":"stop"}')


def endless(gateway: Gateway, name: str, stack: ExitStack, greeting: bytes) -> socket.socket:
    deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
    while True:
        try:
            made = stack.enter_context(connected(gateway.path(name)))
        except BlockingIOError:
            assert clock.now_ns() < deadline_ns, "it is not accepted"
            clock.sleep_s(0.001)
        else:
            poured(made, greeting)
            return made


def flooded(gateway: Gateway, clients: list[socket.socket], mores: list[bytes]) -> float:
    """The most that the gateway took, in MB, while each was sent its own over and over."""
    deadline_ns = clock.now_ns() + int(ENDLESS_S * 1e9)
    sent, most_mb, left = 0, 0.0, dict(enumerate(mores))
    while sent < ENDLESS_BYTES and clock.now_ns() < deadline_ns:
        for which, client in enumerate(clients):
            taken = poured(client, left[which])
            left[which] = left[which][max(0, taken) :] or mores[which]
            sent += max(0, taken)
        most_mb = max(most_mb, gateway.resident_mb)
    return most_mb
