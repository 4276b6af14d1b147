"""The three ZeroMQ sockets that clients meet, each with bounded memory.

Owns: types, options, file modes, and counting connections that end. Must not know: messages.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

import zmq

from etd.files.paths import CONTROL, FRAMES, TELEMETRY
from etd.protocol.errors import HardwareMissing
from etd.protocol.facts import Endpoints
from etd.protocol.messages import MAX_MESSAGE_BYTES

Socket: TypeAlias = zmq.Socket[bytes]

#: Earlier ones have remotely usable flaws (CVE-2019-13132, CVE-2020-15166, CVE-2021-20236).
OLDEST_LIBZMQ = (4, 3, 4)
#: What a telemetry subscriber may send: one subscription, a byte and a topic.
MAX_SUBSCRIPTION_BYTES = 64
_READABLE = int(zmq.POLLIN)
#: Of the monitor's events, at most this many are read in one turn.
_EVENTS_A_TURN = 256


def check_version(version: tuple[int, int, int] | None = None) -> None:
    """Raises: HardwareMissing for a libzmq with known flaws."""
    found = version or zmq.zmq_version_info()
    if found < OLDEST_LIBZMQ:
        names = [".".join(map(str, entry)) for entry in (found, OLDEST_LIBZMQ)]
        raise HardwareMissing(
            (f"libzmq {names[0]} has known flaws, {names[1]} is needed: pip install -U pyzmq",)
        )


class Sockets:
    """Bound when made; one process, one thread."""

    def __init__(self, folder: Path) -> None:
        check_version()
        self._folder = folder
        self._context: zmq.Context[Socket] = zmq.Context()
        try:
            # Messages of 64 KiB, and so many for each connection: a flood fills them all.
            self.control = self._bound(zmq.ROUTER, CONTROL, receive_hwm=2)
            self.frames = self._bound(zmq.PULL, FRAMES, receive_hwm=1)
            self.telemetry = self._bound(zmq.XPUB, TELEMETRY, receive_hwm=64)
        except BaseException:
            self._context.destroy(linger=0)
            raise

    @property
    def endpoints(self) -> Endpoints:
        return Endpoints(
            frames=f"ipc://{self._folder / FRAMES}", telemetry=f"ipc://{self._folder / TELEMETRY}"
        )

    def disconnects(self) -> dict[str, int]:
        """Connections that ended since the last call, by socket, for whatever reason.

        A message over the size limit ends one; ZeroMQ does not tell it from a client that left.
        """
        return {
            "control_disconnects": _count_events(self._control_events),
            "frames_disconnects": _count_events(self._frames_events),
        }

    def close(self) -> None:
        """Idempotent; takes the socket files away."""
        if not self._context.closed:
            for socket in (self.control, self.frames):
                socket.disable_monitor()
            self._context.destroy(linger=0)
            for name in (CONTROL, FRAMES, TELEMETRY):  # libzmq leaves them
                (self._folder / name).unlink(missing_ok=True)

    def _bound(self, kind: int, name: str, receive_hwm: int) -> Socket:
        socket = self._context.socket(kind)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.BACKLOG, 16),
            (zmq.HANDSHAKE_IVL, 1_000),
            (zmq.RCVHWM, receive_hwm),
            (zmq.SNDHWM, 64),
            (zmq.MAXMSGSIZE, MAX_SUBSCRIPTION_BYTES if kind == zmq.XPUB else MAX_MESSAGE_BYTES),
        ):
            socket.setsockopt(option, value)
        if kind == zmq.ROUTER:
            socket.setsockopt(zmq.ROUTER_MANDATORY, 1)  # report undeliverable replies
            self._control_events = socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        elif kind == zmq.PULL:
            self._frames_events = socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        else:
            socket.setsockopt(zmq.XPUB_VERBOSE, 1)  # every new subscriber is sent `state`
        with _group_only():
            socket.bind(f"ipc://{self._folder / name}")
        return socket


@contextmanager
def _group_only() -> Iterator[None]:
    """Socket files get mode 0660 from the start: a user who can write to one can connect."""
    before = os.umask(0o117)
    try:
        yield
    finally:
        os.umask(before)


def arrived(socket: Socket, most: int) -> Iterator[list[zmq.Frame]]:
    """The messages that are there, at most so many."""
    for _ in range(most):
        # Looked at before it is read: a read in vain costs ten times as much.
        if not int(socket.get(zmq.EVENTS)) & _READABLE:
            return
        try:
            yield socket.recv_multipart(zmq.NOBLOCK, copy=False)
        except zmq.Again:
            return


def _count_events(monitor: Socket) -> int:
    events = [struct.unpack("=hi", event[0].bytes)[0] for event in arrived(monitor, _EVENTS_A_TURN)]
    return events.count(zmq.EVENT_DISCONNECTED)
