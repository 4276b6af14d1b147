"""Strangers who send as much as they can: memory stays bounded, and a stop gets through.

Owns: a flood of junk on either socket, and what the gateway's process takes meanwhile.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zmq

from command_rig import WITHIN_S, CommandRig, command_rig
from etd.client import clock

pytestmark = pytest.mark.slow

CONNECTIONS = 60
JUNK = b"x" * 60_000
#: Two control messages and the one being read, of each connection, are 11 MB; a turn reads 4 MB.
MOST_MB = 64
#: A busy machine may hold it back; it does not wait for the flood to end, which is without one.
STOP_WITHIN_S = 20.0


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@pytest.fixture
def context() -> Iterator[zmq.Context[zmq.Socket[bytes]]]:
    made: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    yield made
    made.destroy(linger=0)


class Flood:
    """Many connections, each of which is kept full."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], kind: int, address: str) -> None:
        self._sockets = [context.socket(kind) for _ in range(CONNECTIONS)]
        for socket in self._sockets:
            socket.setsockopt(zmq.LINGER, 0)
            socket.setsockopt(zmq.SNDHWM, 8)
            socket.connect(address)
        self.taken = 0

    def close(self) -> None:
        for socket in self._sockets:
            socket.close()

    def pour(self) -> None:
        """Send until no connection takes any more."""
        for socket in self._sockets:
            try:
                while True:
                    socket.send(JUNK, zmq.NOBLOCK)
                    self.taken += 1
            except zmq.Again:
                continue


def resident_mb(pid: int) -> float:
    (line,) = [
        line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if "VmRSS" in line
    ]
    return int(line.split()[1]) / 1024


@pytest.mark.parametrize(
    ("kind", "name"), [(zmq.DEALER, "control"), (zmq.PUSH, "frames")], ids=["control", "frames"]
)
def test_a_flood_fills_no_memory_and_does_not_hold_back_a_stop(
    rig: CommandRig, context: zmq.Context[zmq.Socket[bytes]], kind: int, name: str
) -> None:
    with rig.daemon() as command:
        gateway = command.children()["gateway"]
        sockets = rig.folder / "run" / "etd" / "main"
        before_mb = resident_mb(gateway)
        with ExitStack() as stack:
            flood = Flood(context, kind, f"ipc://{sockets / name}.sock")
            stack.callback(flood.close)
            deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
            most_mb = 0.0
            while flood.taken < 300 * CONNECTIONS:
                assert clock.now_ns() < deadline_ns, "the flood is not read"
                flood.pour()
                most_mb = max(most_mb, resident_mb(gateway))

            stopping = stack.enter_context(context.socket(zmq.DEALER))
            stopping.connect(f"ipc://{sockets}/control.sock")
            asked_ns = clock.now_ns()
            stopping.send(b'{"op":"stop"}')
            while not stopping.poll(0):
                assert clock.now_ns() - asked_ns < STOP_WITHIN_S * 1e9, "the stop waits"
                flood.pour()
            assert json.loads(stopping.recv())["ok"]
        assert most_mb - before_mb < MOST_MB
