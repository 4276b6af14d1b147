"""The engine's end of the link: what the gateway says, and when it last did.

Owns: the two channels of the one gateway, and how its silence and its end are noticed.
Must not know: what any message means, states, hardware. Time comes in.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from etd.link import Answer, Channel, Greeting, LeaseEnded, NewFrame, Report, ToEngine


class Dialogue:
    """With the gateway that is attached, if one is."""

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._commands: Channel[ToEngine] | None = None
        self._frames: Channel[NewFrame] | None = None
        self._heard_host_ns = 0
        self._nonsense = ""

    @property
    def is_attached(self) -> bool:
        return self._commands is not None

    def attach(self, commands: Channel[ToEngine], frames: Channel[NewFrame], host_ns: int) -> None:
        """A gateway has connected."""
        self._commands, self._frames = commands, frames
        self._heard_host_ns = host_ns
        self._nonsense = ""

    def hang_up(self) -> None:
        """Idempotent."""
        for channel in (self._commands, self._frames):
            if channel is not None:
                channel.close()
        self._commands = self._frames = None

    def why_lost(self) -> str | None:
        """A clause, when there was a gateway and is none to be talked to any more."""
        if self._commands is None:
            return None
        if self._nonsense:
            return f"the gateway spoke nonsense ({self._nonsense})"
        return None if self._commands.is_open else "the gateway is gone"

    def is_silent(self, host_ns: int) -> bool:
        """Nothing for `silence_ns`, although it says something every ALIVE_NS."""
        return self.is_attached and host_ns - self._heard_host_ns > self._silence_ns

    def commands(self, host_ns: int) -> Iterator[ToEngine]:
        """All that lie there now; each counts as heard at `host_ns`."""
        while self._commands is not None:
            try:
                command = self._commands.receive()
            except msgspec.DecodeError as error:
                self._nonsense = str(error)
                return
            if command is None:
                return
            self._heard_host_ns = host_ns
            yield command

    def frames(self) -> Iterator[NewFrame]:
        """All that lie there now, oldest first."""
        while self._frames is not None:
            try:
                message = self._frames.receive()
            except msgspec.DecodeError as error:
                self._nonsense = str(error)
                return
            if message is None:
                return
            yield message

    def send(self, message: Greeting | Answer | LeaseEnded | Report) -> bool:
        """False when it was dropped, or nobody is there. Never blocks."""
        return self._commands is not None and self._commands.send(message)
