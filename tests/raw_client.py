"""A client that speaks ZMTP by hand, so that it can do what no ZeroMQ library does.

Owns: connecting without a word, as this process or as another, the greeting, frames of any form.
Must not know: what is tested.
"""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

_GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
#: Has as many children as its third argument says: each connects to its first argument, and gives
#: the connection to the socket that is its second. Each but the first waits for a byte from there.
_CONNECT = """
import os, socket, sys
to = socket.socket(fileno=int(sys.argv[2]))
for number in range(int(sys.argv[3])):
    if number and not to.recv(1):
        break
    child = os.fork()
    if not child:
        made = socket.socket(socket.AF_UNIX)
        made.connect(sys.argv[1])
        socket.send_fds(to, [b"!"], [made.fileno()])
        os._exit(0)
    os.waitpid(child, 0)
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


def connected_by_others(path: Path, count: int) -> Iterator[socket.socket]:
    """So many, each by a process of its own: it has ended, and the other end sees its pid for good.
    One connects when it is asked for, and not before.
    """
    ours, theirs = socket.socketpair()
    with theirs:
        to = theirs.fileno()
        command = [sys.executable, "-S", "-c", _CONNECT, str(path), str(to), str(count)]
        connecting = subprocess.Popen(command, pass_fds=[to])
    with connecting, ours:
        for number in range(count):
            if number:
                ours.sendall(b"!")
            _, (fileno,), _, _ = socket.recv_fds(ours, 1, 1)
            made = socket.socket(fileno=fileno)
            made.setblocking(False)
            yield made


def connected_by_another(path: Path) -> socket.socket:
    """The same of one."""
    (made,) = connected_by_others(path, 1)
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


def is_closed(made: socket.socket) -> bool:
    """By the other end; what that had sent is read first."""
    try:
        while made.recv(65_536):
            pass
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True
    return True
