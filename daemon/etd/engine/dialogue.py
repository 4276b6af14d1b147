"""The engine's end of the link: what the gateway says, and when it last did.

Owns: the two channels of the one gateway, and how its silence and its end are noticed.
Must not know: what any message means, states, hardware. Time comes in.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from etd.errors import Undecodable
from etd.link import Answer, Channel, Greeting, LeaseEnded, NewFrame, Report, ToEngine

In = TypeVar("In")


class Dialogue:
    """With the gateway that is attached, if one is."""

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._commands: Channel[ToEngine] | None = None
        self._frames: Channel[NewFrame] | None = None
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

    def frames(self) -> Iterator[NewFrame]:
        """All that lie there now, oldest first."""
        while self._frames is not None:
            message = self._received(self._frames)
            if message is None:
                return
            yield message

    def _received(self, channel: Channel[In]) -> In | None:
        """The next message; None if there is none now, or will be none."""
        if channel is self._garbled:
            return None
        try:
            return channel.receive()
        except Undecodable as error:
            self._undecodable, self._garbled = error, channel
            return None

    def send(self, message: Greeting | Answer | LeaseEnded | Report) -> bool:
        """False when it was dropped, or nobody is there. Never blocks."""
        return self._commands is not None and self._commands.send(message)
