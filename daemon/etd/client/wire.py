"""ZeroMQ as the client uses it: socket options.

Owns: sockets that queue nothing for a later daemon. Must not know: messages.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, TypeVar

import zmq

from etd.protocol.messages import MAX_MESSAGE_BYTES

#: Until it is tried again to connect: at first, and at most.
AGAIN_MS, LATER_MS = 10, 100

S = TypeVar("S", bound="zmq.Socket[Any]")


def configure(socket: S, address: str) -> S:
    """Connect so that no message waits in a queue for a daemon that starts later."""
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.IMMEDIATE, 1)
    # The daemon's line of newcomers may be full for a moment, and this one may want to stop.
    socket.setsockopt(zmq.RECONNECT_IVL, AGAIN_MS)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, LATER_MS)
    socket.setsockopt(zmq.SNDHWM, 8)
    socket.setsockopt(zmq.MAXMSGSIZE, 16 * MAX_MESSAGE_BYTES)
    socket.connect(address)
    return socket


def program_name() -> str:
    """This program's name, for the daemon's status."""
    return Path(sys.argv[0]).stem if sys.argv and sys.argv[0] else "python"
