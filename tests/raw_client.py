"""A client that speaks ZMTP by hand, so that it can do what no ZeroMQ library does.

Owns: connecting without a word, as this process or as another, the greeting, frames of any form.
Must not know: what is tested.
"""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

_GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
#: Connects to its first argument, and gives the connection to the socket that is its second.
_CONNECT = """
import socket, sys
made = socket.socket(socket.AF_UNIX)
made.connect(sys.argv[1])
socket.send_fds(socket.socket(fileno=int(sys.argv[2])), [b"!"], [made.fileno()])
"""


def connected(path: Path) -> socket.socket:
    """Without a byte sent, and without waiting for one. Raises: BlockingIOError (no room)."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        made.connect(str(path))
    except BaseException:
        made.close()
        raise
    return made


def connected_by_another(path: Path) -> socket.socket:
    """The same, by a process of its own: it has ended, and the other end sees its pid for good."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        command = [sys.executable, "-S", "-c", _CONNECT, str(path), str(theirs.fileno())]
        subprocess.run(command, pass_fds=[theirs.fileno()], check=True, timeout=60)
        _, (fileno,), _, _ = socket.recv_fds(ours, 1, 1)
    made = socket.socket(fileno=fileno)
    made.setblocking(False)
    return made


def hello(kind: str) -> bytes:
    """Greeting and READY of a socket type, as one write."""
    name, value = b"Socket-Type", kind.encode()
    ready = b"\x05READY" + bytes([len(name)]) + name + len(value).to_bytes(4, "big") + value
    return _GREETING + bytes([4, len(ready)]) + ready


def part(data: bytes, more: bool = False) -> bytes:
    """One frame of a message."""
    if len(data) < 256:
        return bytes([int(more), len(data)]) + data
    return bytes([2 | int(more)]) + len(data).to_bytes(8, "big") + data


def poured(to: socket.socket, data: bytes) -> int:
    """Send what fits, without waiting; how many bytes of `data` that were. -1: it was closed."""
    try:
        return to.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
    except BlockingIOError:
        return 0
    except (BrokenPipeError, ConnectionResetError):
        return -1
