"""Who is at the other end of a Unix socket, by the kernel.

Owns: the user and the groups of the process that connected. Must not know: what they may do.
"""

from __future__ import annotations

import socket
import struct
from typing import NamedTuple

_CREDENTIALS = struct.Struct("iII")
#: Of <asm-generic/socket.h>; Python has no name for it.
_SO_PEERGROUPS = 59
#: What Python reads of an option: 256 groups. A process with more is an error.
_MOST_GROUPS_BYTES = 1_024


class Peer(NamedTuple):
    uid: int
    #: Its own first.
    gids: tuple[int, ...]


def peer_of(connection: socket.socket) -> Peer:
    """As it was when it connected. Raises: OSError."""
    packed = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, uid, gid = _CREDENTIALS.unpack(packed)
    groups = connection.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _MOST_GROUPS_BYTES)
    return Peer(uid, (gid, *struct.unpack(f"{len(groups) // 4}I", groups)))
