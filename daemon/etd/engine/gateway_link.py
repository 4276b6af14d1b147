"""The engine's end of the link: the gateway's messages, and when the last one came.

Owns: the two channels of the one gateway, waiting for a message, how much is read at a
time, and how its silence and its end are noticed.
Must not know: what any message means, states, hardware. Time comes in.
"""

from __future__ import annotations

from typing import TypeVar

from etd.engine.frame_queue import FrameQueue
from etd.protocol.errors import Refused, Undecodable
from etd.protocol.link import (
    Channel,
    NewFrame,
    ToEngine,
    ToGateway,
    wait_for_any,
)
from etd.protocol.peer import Peer

#: Read at a time, a millisecond's work at most: so many frames, and none after so many bytes.
_FRAMES_A_READ = 64
_FRAME_BYTES_A_READ = 128 * 1024

In = TypeVar("In")


class GatewayLink:
    """The link to the attached gateway, if there is one."""

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._commands: Channel[ToEngine] | None = None
        self._frames: Channel[NewFrame] | None = None
        self.queue = FrameQueue()
        self._heard_host_ns = 0
        #: The message of the gateway that could not be decoded, if any: the connection is to be
        #: closed.
        self.undecodable: Undecodable | None = None
        #: The channel of an undecodable message: nothing more is read from it.
        self._garbled: object = None

    @property
    def peer(self) -> Peer:
        """Who the attached gateway is, by the kernel. Raises: Refused, where that is not known."""
        try:
            if self._commands is not None:
                return self._commands.peer
        except OSError as error:
            why = f"the kernel does not say who the gateway is: {error.strerror}"
            raise Refused("bad_calibration", why) from error
        raise Refused("bad_calibration", "there is no gateway")

    @property
    def is_attached(self) -> bool:
        return self._commands is not None

    def attach(self, commands: Channel[ToEngine], frames: Channel[NewFrame], host_ns: int) -> None:
        """A gateway has connected."""
        self._commands, self._frames = commands, frames
        self._heard_host_ns = host_ns
        self.undecodable = self._garbled = None

    def hang_up(self) -> None:
        """Idempotent."""
        for channel in (self._commands, self._frames):
            if channel is not None:
                channel.close()
        self._commands = self._frames = None
        self.undecodable = self._garbled = None
        self.queue.clear()

    def is_well(self, host_ns: int) -> bool:
        """Whether nothing is to be done: neither undecodable nor gone nor silent."""
        commands = self._commands
        if commands is None:
            return True
        is_heard = host_ns - self._heard_host_ns <= self._silence_ns
        return is_heard and commands.is_open and self.undecodable is None

    @property
    def is_gone(self) -> bool:
        """The gateway has ended the connection."""
        return self._commands is not None and not self._commands.is_open

    def is_silent(self, host_ns: int) -> bool:
        """The gateway has sent nothing for `silence_ns`, although it sends every ALIVE_NS."""
        return self.is_attached and host_ns - self._heard_host_ns > self._silence_ns

    def command(self, host_ns: int) -> ToEngine | None:
        """The next command that waits, received at `host_ns`; None if there is none."""
        command = None if self._commands is None else self._received(self._commands)
        if command is not None:
            self._heard_host_ns = host_ns
        return command

    def read_frames(self, came_host_ns: int) -> bool:
        """Reads some of the waiting frames into the queue; True if these were all. The caller polls
        everything else before it reads more, however fast the gateway sends.
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
        """The next message; None if none waits, or the channel has ended."""
        if channel is self._garbled:
            return None
        try:
            return channel.receive()
        except Undecodable as error:
            self.undecodable, self._garbled = error, channel
            return None

    def wait(self, timeout_s: float) -> bool:
        """Waits for so many seconds; ends as soon as there is something to be read, and is True
        then.
        """
        ends = [self._commands, None if self.queue.is_full else self._frames]
        return wait_for_any(
            [end for end in ends if end is not None and end.is_open and end is not self._garbled],
            timeout_s,
        )

    def send(self, message: ToGateway) -> bool:
        """Returns False when the message was dropped or no gateway is attached. Never blocks."""
        return self._commands is not None and self._commands.send(message)
