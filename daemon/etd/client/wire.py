"""ZeroMQ as the client uses it: addresses and socket options.

Owns: refusing addresses that cannot be used, and sockets that queue nothing for a later daemon.
Must not know: messages.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, TypeVar

import zmq

from etd.files.paths import control_address, why_unreachable
from etd.protocol.errors import DaemonGone, Refused
from etd.protocol.messages import MAX_MESSAGE_BYTES

S = TypeVar("S", bound="zmq.Socket[Any]")


def resolve(name: str, address: str | None) -> str:
    """The control address. Raises: Refused for an unsupported transport."""
    if address is None:
        return control_address(name)
    if address.startswith("tcp://"):
        raise Refused(
            "not_permitted",
            f"{address}: connections over a network are not supported, because they would not be"
            " authenticated: use the daemon's Unix socket (ipc://), or name the computer, which is"
            " reached by your own ssh: Display(host='user@computer'), --host or ETD_HOST",
        )
    if not address.startswith("ipc://") or not Path(address.removeprefix("ipc://")).name:
        raise Refused(
            "bad_message",
            f"{address!r} is not an address: use one like ipc:///run/etd/NAME/control.sock",
        )
    return address


def check_there(address: str) -> None:
    """Raises: DaemonGone if no daemon listens at this ipc address, at once and with the reason."""
    why = why_unreachable(Path(address.removeprefix("ipc://")))
    if why is not None:
        raise DaemonGone(address, why)


def configure(socket: S, address: str) -> S:
    """Connect so that no message waits in a queue for a daemon that starts later."""
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.IMMEDIATE, 1)
    socket.setsockopt(zmq.SNDHWM, 8)
    socket.setsockopt(zmq.MAXMSGSIZE, 16 * MAX_MESSAGE_BYTES)
    socket.connect(address)
    return socket


def program_name() -> str:
    """This program's name, for the daemon's status."""
    return Path(sys.argv[0]).stem if sys.argv and sys.argv[0] else "python"
