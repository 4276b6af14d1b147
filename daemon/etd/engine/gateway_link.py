"""The engine's end of the link: what the gateway says, and when it last did.

Owns: the two channels of the one gateway, how much is read from them at a time, and how its silence
and its end are noticed.
Must not know: what any message means, states, hardware. Time comes in.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from etd.engine.frame_queue import FrameQueue
from etd.protocol.errors import Undecodable
from etd.protocol.link import Answer, Channel, EngineHello, LeaseEnded, NewFrame, Report, ToEngine

#: Read at a time, a millisecond's work at most: so many, and none after so many bytes of them.
_FRAMES_A_READ = 64
_FRAME_BYTES_A_READ = 128 * 1024

In = TypeVar("In")


class GatewayLink:
    """With the gateway that is attached, if one is."""

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._commands: Channel[ToEngine] | None = None
        self._frames: Channel[NewFrame] | None = None
        self.queue = FrameQueue()
        self._heard_host_ns = 0
        self._undecodable: Undecodable | None = None
        #: Where that came: nothing more is read there.
        self._garbled: object = None

    @property
    def is_attached(self) -> bool:
        return self._commands is not None

    def attach(self, commands: Channel[ToEngine], frames: Channel[NewFrame], host_ns: int) -> None:
        """A gateway has connected."""
        self._commands, self._frames = commands, frames
        self._heard_host_ns = host_ns
        self._undecodable = self._garbled = None

    def hang_up(self) -> None:
        """Idempotent."""
        for channel in (self._commands, self._frames):
            if channel is not None:
                channel.close()
        self._commands = self._frames = None
        self.queue.clear()

    @property
    def undecodable(self) -> Undecodable | None:
        """What the gateway sent that is no message of the link: it is to be hung up on."""
        return self._undecodable if self.is_attached else None

    @property
    def is_gone(self) -> bool:
        """The gateway has ended the connection."""
        return self._commands is not None and not self._commands.is_open

    def is_silent(self, host_ns: int) -> bool:
        """Nothing for `silence_ns`, although it says something every ALIVE_NS."""
        return self.is_attached and host_ns - self._heard_host_ns > self._silence_ns

    def commands(self, host_ns: int) -> Iterator[ToEngine]:
        """All that lie there now; each counts as heard at `host_ns`."""
        while self._commands is not None:
            command = self._received(self._commands)
            if command is None:
                return
            self._heard_host_ns = host_ns
            yield command

    def read_frames(self, came_host_ns: int) -> bool:
        """Some of what lies there, into the queue: True if that was all. However fast the gateway
        sends, it is for the caller to look at everything else before the next ones.
        """
        channel = self._frames
        if channel is None:
            return True
        most_bytes = channel.received_bytes + _FRAME_BYTES_A_READ
        for _ in range(_FRAMES_A_READ):
            if self.queue.is_full or channel.received_bytes >= most_bytes:
                return False
            message = self._received(channel)
            if message is None:
                return True
            self.queue.put(message, came_host_ns)
        return False

    def _received(self, channel: Channel[In]) -> In | None:
        """The next message; None if there is none now, or will be none."""
        if channel is self._garbled:
            return None
        try:
            return channel.receive()
        except Undecodable as error:
            self._undecodable, self._garbled = error, channel
            return None

    def send(self, message: EngineHello | Answer | LeaseEnded | Report) -> bool:
        """False when it was dropped, or nobody is there. Never blocks."""
        return self._commands is not None and self._commands.send(message)
