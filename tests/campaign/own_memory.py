"""What a copied process must not share with the process that it was copied from.

Owns: a link in memory in place of sockets, and shared memory made a copy's own. Must not know:
cases, faults.
"""

from __future__ import annotations

import ctypes
import gc
import mmap
import os
from collections import deque
from typing import TypeVar

import msgspec

from engine_rig import EngineRig
from etd.protocol.link import Channel, NewFrame, ToEngine, ToGateway, decoded
from etd.protocol.peer import Peer
from etd_hal.shared_memory import SharedMemory

In = TypeVar("In")
#: Of Linux: at this address, whatever is mapped there.
_MAP_FIXED = 0x10
_libc = ctypes.CDLL(None, use_errno=True)
_libc.mmap.restype = ctypes.c_void_p
_libc.mmap.argtypes = (ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long)


class OwnChannel(Channel[In]):
    """One end of a link whose messages lie in this process."""

    def __init__(self, incoming: type[In] | object, sent: deque[bytes], come: deque[bytes]) -> None:
        # No socket: the base has only them.
        self._sent, self._come = sent, come
        self._decoder = msgspec.msgpack.Decoder(incoming)
        self._encoder = msgspec.msgpack.Encoder()
        self.is_open = True
        self.dropped = self.received_bytes = 0

    @property
    def has_come(self) -> bool:
        return bool(self._come)

    @property
    def peer(self) -> Peer:
        """This process itself."""
        return Peer(os.getuid(), (os.getgid(),))

    def send(self, message: object) -> bool:
        if self.is_open:
            self._sent.append(self._encoder.encode(message))
        return self.is_open

    def send_bytes(self, data: bytes) -> None:
        """Whatever it is; nothing at all is the end, as of a socket."""
        self._sent.append(data)

    def receive(self) -> In | None:
        if not self.is_open or not self._come:
            return None
        data = self._come.popleft()
        if not data:
            self.close()
            return None
        self.received_bytes += len(data)
        return decoded(self._decoder, data)

    def close(self) -> None:
        if self.is_open:
            self._sent.append(b"")
        self.is_open = False


def link_in_memory(rig: EngineRig) -> None:
    """In place of the sockets with which it was made."""
    parts = rig.engine.components
    parts.gateway_link.hang_up()
    rig.commands.close()
    rig.frames.close()
    to_engine, to_gateway = deque[bytes](), deque[bytes]()
    frames, back = deque[bytes](), deque[bytes]()
    rig.commands = OwnChannel(ToGateway, to_engine, to_gateway)
    rig.frames = OwnChannel(ToGateway, frames, back)
    rig.engine.attach(
        OwnChannel(ToEngine, to_gateway, to_engine), OwnChannel(NewFrame, back, frames)
    )


def all_shared() -> list[SharedMemory]:
    """What this process shares with processes beside it, or would."""
    return [found for found in gc.get_objects() if isinstance(found, SharedMemory)]


def content(memory: SharedMemory) -> bytes:
    """To be taken before the process is copied."""
    return bytes(memory.bytes)


def make_own(memory: SharedMemory, before: bytes) -> None:
    """In a copy: the same address, the same content, and of this process alone from now on."""
    mapped = ctypes.c_char.from_buffer(memory.bytes)
    found = _libc.mmap(
        ctypes.addressof(mapped),
        mmap.PAGESIZE,
        mmap.PROT_READ | mmap.PROT_WRITE,
        mmap.MAP_PRIVATE | _MAP_FIXED,
        memory.fd,
        0,
    )
    if found != ctypes.addressof(mapped):
        raise OSError(ctypes.get_errno(), "mmap")
    memory.bytes[:] = before
