"""The ports of a board that lives in a board process.

Owns: the client's end of the socket. Must not know: what the board does with a call.

A call is one datagram: the board executes and records it whole, whatever becomes of this process
the instant after.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from etd_hal.boardfile import BoardFile
from etd_hal.errors import BusError
from etd_hal.fake import wire
from etd_hal.fake.clock import BoardClock
from etd_hal.fake.layouts import lay_out
from etd_hal.fake.machines import PI4
from etd_hal.ports import Changes, Edge, LineSetup, Message, SpiSetup


class _Line:
    """One connection: calls from several threads, one at a time."""

    def __init__(self, path: Path, clock: BoardClock) -> None:
        self.clock = clock
        self._path = path
        self._lock = threading.Lock()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            detail = f"no board process answers ({error.strerror}): start one on this socket"
            raise BusError("absent", str(path), "connect", detail) from error

    def ask(self, call: wire.Call) -> wire.Answer:
        """Raises: BusError (`gone` when the board process is)."""
        try:
            with self._lock:
                self._socket.send(wire.encode(call))
                datagram = self._socket.recv(wire.MAX_DATAGRAM_BYTES)
        except OSError as error:
            raise self._gone() from error
        if not datagram:
            raise self._gone()
        return wire.decode_answer(datagram)

    def call(self, call: wire.Call) -> wire.Done:
        """One call with its time. Raises: BusError."""
        answer = self.ask(call)
        while isinstance(answer, wire.Waits):
            self.clock.end_call(answer.until_ns)
            answer = self.ask(wire.Resume())
        return self.over(answer, self.clock.end_call)

    def side_call(self, call: wire.Call) -> wire.Done:
        """The same beside the other calls' time."""
        return self.over(self.ask(call), self.clock.end_side_call)

    def over(self, answer: wire.Answer, wait_until: Callable[[int], None]) -> wire.Done:
        if isinstance(answer, wire.Failed):
            wait_until(answer.end_ns)
            raise BusError(answer.kind, answer.device, answer.operation, answer.detail)
        if not isinstance(answer, wire.Done):
            raise BusError("io", str(self._path), "answer", f"not an answer: {answer}")
        wait_until(answer.end_ns)
        return answer

    def close(self) -> None:
        self._socket.close()

    def _gone(self) -> BusError:
        return BusError("gone", str(self._path), "call", "the board process is gone")


class RemoteSpi:
    def __init__(self, line: _Line, device: str) -> None:
        self._line = line
        self._device = device

    def prepare(self, message: Message) -> None:
        """See `ports.Spi`. It is the client that computes, and not the board process."""
        layout_ns = lay_out(message, self, self._device, PI4)
        if layout_ns:
            self._line.clock.end_call(self._line.clock.begin_call("prepare") + layout_ns)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        layout_ns = lay_out(message, self, self._device, PI4)
        start_ns = self._line.clock.begin_message() + layout_ns
        return self._line.call(wire.Play(start_ns, message.transfers)).reads


class RemoteGpio:
    def __init__(self, line: _Line) -> None:
        self._line = line

    def set(self, changes: Changes) -> None:
        self._line.call(wire.SetLines(self._line.clock.begin_call("line"), changes))

    def get(self, line: int) -> int:
        return self._line.call(wire.GetLine(self._line.clock.begin_call("line"), line)).value

    def edges(self) -> tuple[Edge, ...]:
        return self._line.call(wire.TakeEdges(self._line.clock.begin_call("line"))).edges


class RemoteI2c:
    def __init__(self, line: _Line) -> None:
        self._line = line

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        start_ns = self._line.clock.begin_call("line")
        call = wire.TransferI2c(start_ns, address, write, read_length)
        return self._line.side_call(call).reads[0]


class RemoteMarker:
    def __init__(self, line: _Line) -> None:
        self._line = line

    def mark(self, event: Literal["frame", "mark"], seq: int, tag: int | str | None) -> None:
        self._line.side_call(wire.Mark(self._line.clock.now_ns(), event, seq, tag))


@dataclass(frozen=True, slots=True)
class RemotePorts:
    spi: RemoteSpi
    gpio: RemoteGpio
    i2c: RemoteI2c | None
    marker: RemoteMarker
    line: _Line

    def close(self) -> None:
        self.line.close()


def open_remote(
    path: Path, clock: BoardClock, board: BoardFile, lines: LineSetup, spi: SpiSetup
) -> RemotePorts:
    """Request the lines of the board process at `path`.

    Raises: BusError (`absent` without such a process, `busy` while another client has the lines,
    `invalid` when it plays another board file).
    """
    line = _Line(path, clock)
    try:
        line.call(wire.TakeLines(clock.begin_call("line"), board.name, lines, spi))
    except BusError:
        line.close()
        raise
    return RemotePorts(
        RemoteSpi(line, spi.device),
        RemoteGpio(line),
        RemoteI2c(line) if board.i2c != "absent" else None,
        RemoteMarker(line),
        line,
    )
