"""The gateway's end of the link to the engine: connecting, keeping it alive, losing it.

Owns: the two channels, the facts in the engine's hello, and the errors when there is no engine.
Must not know: clients, requests.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from etd.protocol import link
from etd.protocol.errors import Refused, Undecodable, halted
from etd.protocol.link import (
    Alive,
    Channel,
    Command,
    EngineHello,
    NewFrame,
    RecordPulses,
    Report,
    StopNow,
)
from etd.protocol.messages import StateReport

#: Of the engine's messages, at most this many are read in one turn.
MESSAGES_A_TURN = 256

_GONE = (
    "the engine, which drives the board, is not running, or is still starting, so nothing is"
    " stimulated; it starts in SAFE; see its log"
)
_STOP_UNANSWERED = (
    "the engine did not answer the stop, so its link was closed, which stops it as well if it runs;"
    " if anything is felt, press the stop button or run `etd safe`"
)
_CUT_OFF = (
    "the engine did not answer a stop, its link was closed, and it has not come back: whether it"
    " runs is not known; if anything is felt, press the stop button or run `etd safe`"
)
_STOP_UNHEARD = (
    "an engine listens and has not said a word since the gateway connected: the stop waits for it,"
    " and is not answered yet; if anything is felt, press the stop button or run `etd safe`"
)
_STOP_CUT = (
    "the engine did not accept the stop, so its link was closed: stimulation ends within 250 ms;"
    " the engine is not HALTED, but it must be armed again before anything is fired"
)


class EngineLink:
    """There once the engine has sent its hello; gone once either socket has ended."""

    def __init__(self, folder: Path, counters: Counter[str]) -> None:
        self._folder = folder
        self._counters = counters
        self._channels: tuple[Channel[link.ToGateway], Channel[link.ToGateway]] | None = None
        self._engine_hello: EngineHello | None = None
        self.state: StateReport | None = None
        #: It did not answer a stop; until an engine says hello, it is not known whether it runs.
        self.is_cut_off = False

    @property
    def is_connected(self) -> bool:
        return self._channels is not None

    @property
    def is_there(self) -> bool:
        return self._engine_hello is not None

    @property
    def has_ended(self) -> bool:
        """The other end has hung up, and `hang_up` is due here."""
        return self._channels is not None and not all(channel.is_open for channel in self._channels)

    @property
    def why_gone(self) -> str:
        return _CUT_OFF if self.is_cut_off else _GONE

    def engine_hello(self) -> EngineHello:
        """The facts of the board. Raises: Refused (`engine_gone`)."""
        if self._engine_hello is None:
            raise Refused("engine_gone", self.why_gone)
        return self._engine_hello

    def check_not_halted(self) -> None:
        """No lease outlives a halt, so this comes before the lease. Raises: Refused (`halted`)."""
        halt = None if self.state is None else self.state.halt
        if halt is not None:
            raise halted(halt.cause, halt.source, halt.detail)

    def filenos(self) -> tuple[int, ...]:
        """For the poll."""
        return tuple(channel.fileno() for channel in self._channels or () if channel.is_open)

    def try_connect(self) -> None:
        """Connect if an engine listens."""
        if self._channels is None:
            self._channels = link.connect(self._folder)

    def hang_up(self) -> None:
        """Close the link and discard the engine's facts; idempotent. Of one that was cut off the
        last state stays, since no later one is known.
        """
        for channel in self._channels or ():
            channel.close()
        self._channels = None
        self._engine_hello = None
        if not self.is_cut_off:
            self.state = None

    def break_off(self) -> None:
        """The engine has sent what cannot be decoded: it has ended as far as this gateway goes."""
        self._counters["engine_unreadable"] += 1
        for channel in self._channels or ():
            channel.close()

    def stay_alive(self) -> None:
        """Send one sign of life; one that does not fit into the socket is counted."""
        if self._channels is not None and not self._channels[0].send(Alive()):
            self._counters["alive_not_sent"] += 1

    def command(self, command: Command) -> None:
        """Raises: Refused (`engine_gone`, `busy`)."""
        self._send(0, command, "commands")

    def frame(self, frame: NewFrame) -> None:
        """Raises: Refused (`engine_gone`, `busy`)."""
        self._send(1, frame, "frames")

    def _send(self, which: int, message: Command | NewFrame, kind: str) -> None:
        self.engine_hello()
        channel = self._open_channel(which)
        if not channel.send(message):
            self._open_channel(which)  # the send may have detected that the engine is gone
            raise Refused("busy", f"the engine has not read earlier {kind} yet: send again")

    def _open_channel(self, which: int) -> Channel[link.ToGateway]:
        """Raises: Refused (`engine_gone`), also between the engine's end and `hang_up`."""
        if self._channels is None or not self._channels[which].is_open:
            raise Refused("engine_gone", self.why_gone)
        return self._channels[which]

    def record_pulses(self, is_on: bool) -> bool:
        """Have the engine tell every pulse, or none any more. False: it was not told."""
        return self._channels is not None and self._channels[0].send(RecordPulses(is_on=is_on))

    def stop(self, stop: StopNow) -> None:
        """Sends it, or closes the link, which stops as well. Raises: Refused (`engine_gone`)."""
        commands = self._open_channel(0)
        if not commands.send(stop):
            self._open_channel(0)
            commands.close()
            raise Refused("engine_gone", _STOP_CUT)

    def cut_off(self) -> str:
        """After a stop that was not answered; what that means for the skin. An engine that has not
        begun keeps the link: the stop in it is the first that it reads.
        """
        if self._engine_hello is None:
            return _STOP_UNHEARD
        self.is_cut_off = True
        for channel in self._channels or ():
            channel.close()
        return _STOP_UNANSWERED

    @property
    def timeout_factor(self) -> int:
        """Of the engine's time-outs, as far as it has told them."""
        return 1 if self.state is None else self.state.timeout_factor

    def receive(self) -> Iterator[link.ToGateway]:
        """The engine's messages; its hello and its state are also stored."""
        for _ in range(MESSAGES_A_TURN):
            message = self._next()
            if message is None:
                return
            if isinstance(message, EngineHello):
                self._engine_hello, self.state, self.is_cut_off = message, None, False
            if isinstance(message, Report) and message.state is not None:
                self.state = message.state
            yield message

    def _next(self) -> link.ToGateway | None:
        for channel in self._channels or ():
            try:
                message = channel.receive()
            except Undecodable:
                self.break_off()
                return None
            if message is not None:
                return message
        return None
