"""The chips behind the guest's buses: the same models, and the same body, as the fake's.

Owns: answering what the kernel module tells and asks through /dev/rig, and moving its inputs.
Must not know: who uses the buses. It sees what comes out of the kernel, in the kernel's order and
with the kernel's times, and nothing else.

    --board FILE [--on-bench] [--door PATH] [--trace FILE]

Started by answerer_nursery.py. The array is on a fingertip or, `--on-bench`, on nothing. `--door`
is the fake's second door: stop lines, contacts, faults.
"""

from __future__ import annotations

import argparse
import errno
import gc
import os
import selectors
import signal
import socket
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from etd_body.electrode import OPEN_CONTACT
from etd_body.minimal import MinimalBody
from etd_hal.boardfile import BoardFile, load_board
from etd_hal.errors import BusError, BusErrorKind
from etd_hal.fake import wire
from etd_hal.fake.circuit import Circuit
from etd_hal.fake.fingertip import fingertip_body
from etd_hal.fake.process import knock_at
from etd_hal.fake.trace import Trace
from etd_hal.fake.world import Touchable
from etd_hal.linux.clock import LinuxClock
from etd_hal.ports import Message, SpiSetup, Transfer

#: What the module reads and writes (modules/door.c, rig.h).
_EVENT = struct.Struct("=QIHH")
_ANSWER = struct.Struct("=Ii")
_PAIR = struct.Struct("=II")
_LINE_DRIVEN, _LINE_READ, _SPI_MESSAGE, _I2C_TRANSFER = 1, 2, 3, 4
_ASKED_AT_READ = 2
_SPI_HEAD = struct.Struct("=III")
_SPI_TRANSFER = struct.Struct("=IIHBB")
_I2C_MESSAGE = struct.Struct("=HHHH")
_MOST_BYTES = 70_000
#: How late the world's own doings (a stop line that is pressed) reach the inputs.
_LOOKS_EVERY_NS = 5_000_000

_ERRNO: dict[BusErrorKind, int] = {
    "absent": errno.EREMOTEIO,
    "invalid": errno.EINVAL,
    "timeout": errno.ETIMEDOUT,
    "too_long": errno.EMSGSIZE,
}


def spi_message(payload: bytes) -> tuple[int, int, int, Message]:
    """Chip select, mode, speed in Hz of the transfers with data, and the message."""
    chip_select, mode, count = _SPI_HEAD.unpack_from(payload)
    at, speed_hz = _SPI_HEAD.size, 0
    transfers: list[Transfer] = []
    for _ in range(count):
        length, transfer_hz, delay_us, cs_change, _ = _SPI_TRANSFER.unpack_from(payload, at)
        at += _SPI_TRANSFER.size
        transfers.append(Transfer(payload[at : at + length], delay_us, bool(cs_change)))
        at += length
        speed_hz = transfer_hz if length else speed_hz
    return chip_select, mode, speed_hz, Message(tuple(transfers))


def i2c_transaction(payload: bytes) -> tuple[int, bytes, int]:
    """Address, bytes written, bytes to read. Raises: BusError for what the board never sees."""
    address, write, read_length, at = 0, b"", 0, 0
    while at < len(payload):
        address, is_read, length, _ = _I2C_MESSAGE.unpack_from(payload, at)
        at += _I2C_MESSAGE.size
        if read_length or (write and not is_read):
            raise BusError("invalid", "the rig's I2C bus", "transfer", "a write, then a read")
        if is_read:
            read_length = length
        else:
            write = payload[at : at + length]
            at += length
    return address, write, read_length


class Answerer:
    """One board behind the door `fd`."""

    def __init__(self, board: BoardFile, circuit: Circuit, fd: int, now_ns: Callable[[], int]):
        self._board = board
        self._circuit = circuit
        self._fd = fd
        self.now_ns = now_ns
        self._spi: SpiSetup | None = None
        lines = board.used_lines()
        moved = ("EMERGENCY_STOP", "WEARER_STOP", "TRIGGER")
        self._moved = [lines[name] for name in moved if name in lines]
        self._levels: dict[int, int] = {}
        if "READBACK" in lines:
            self._put_inputs({lines["READBACK"]: _ASKED_AT_READ})

    def follow_world(self) -> None:
        """The levels of the lines that the world moves, as they are now, on the module's inputs."""
        now_ns = self.now_ns()
        levels = {line: self._circuit.gpio.sense(now_ns, line) for line in self._moved}
        if levels != self._levels:
            self._levels = levels
            self._put_inputs(levels)

    def _put_inputs(self, levels: dict[int, int]) -> None:
        pairs = b"".join(_PAIR.pack(line, level) for line, level in levels.items())
        os.write(self._fd, _ANSWER.pack(0, 0) + pairs)

    def take_events(self) -> None:
        """Read the events that are there, and answer those that are questions."""
        events, at = os.read(self._fd, _MOST_BYTES), 0
        while at < len(events):
            t_ns, number, kind, length = _EVENT.unpack_from(events, at)
            at += _EVENT.size + length
            self._take(t_ns, number, kind, events[at - length : at])

    def _take(self, t_ns: int, number: int, kind: int, payload: bytes) -> None:
        if kind == _LINE_DRIVEN:
            self._circuit.gpio.drive(t_ns, *_PAIR.unpack(payload))
            return
        try:
            status, answer = 0, self._answer(t_ns, kind, payload)
        except BusError as error:
            status, answer = -_ERRNO.get(error.kind, errno.EIO), b""
        os.write(self._fd, _ANSWER.pack(number, status) + answer)

    def _answer(self, t_ns: int, kind: int, payload: bytes) -> bytes:
        if kind == _LINE_READ:
            (line,) = struct.unpack("=I", payload)
            return bytes((self._circuit.gpio.sense(t_ns, line),))
        if kind == _SPI_MESSAGE:
            return self._play(t_ns, payload)
        if kind == _I2C_TRANSFER:
            read, _ = self._circuit.i2c.transfer(t_ns, *i2c_transaction(payload))
            if isinstance(read, BusError):
                raise read
            return read
        raise ValueError(f"the module asks something of kind {kind}")

    def _play(self, t_ns: int, payload: bytes) -> bytes:
        chip_select, mode, speed_hz, message = spi_message(payload)
        if chip_select != 0:
            return bytes(sum(len(transfer.tx) for transfer in message.transfers))
        setup = SpiSetup(self._board.source.spi, mode, speed_hz)
        if setup != self._spi:
            self._circuit.spi.open(setup)
            self._spi = setup
        steps = self._circuit.spi.play(t_ns, message)
        try:
            while True:
                next(steps)
        except StopIteration as done:
            reads: tuple[bytes, ...] = done.value[0]
            return b"".join(reads)


class Door:
    """The second door: one datagram, one answer."""

    def __init__(self, circuit: Circuit, path: Path) -> None:
        self._circuit = circuit
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.listener.bind(str(path))
        self.listener.listen()

    def answer(self, client: socket.socket) -> bool:
        """Answer one knock; False when the client is gone."""
        datagram = client.recv(wire.MAX_DATAGRAM_BYTES)
        if not datagram:
            return False
        knock = wire.decode_call(datagram)
        assert isinstance(knock, wire.Knock)
        client.send(wire.encode(knock_at(self._circuit, knock, held=True)))
        return True


def serve(answerer: Answerer, fd: int, door: Door | None) -> None:
    """Answer for ever."""
    selector = selectors.DefaultSelector()
    selector.register(fd, selectors.EVENT_READ, answerer.take_events)
    if door is not None:
        selector.register(door.listener, selectors.EVENT_READ)
    looked_ns = 0
    while True:
        for key, _ in selector.select(_LOOKS_EVERY_NS / 1e9):
            if key.data is not None:
                key.data()
            elif door is not None and key.fileobj is door.listener:
                client, _ = door.listener.accept()
                selector.register(client, selectors.EVENT_READ)
            elif door is not None:
                client = key.fileobj  # type: ignore[assignment]
                if not door.answer(client):
                    selector.unregister(client)
                    client.close()
        if answerer.now_ns() - looked_ns >= _LOOKS_EVERY_NS:
            looked_ns = answerer.now_ns()
            answerer.follow_world()


def _leave(_signal: int, _frame: FrameType | None) -> None:
    sys.exit(0)


def main(arguments: list[str], ready: Callable[[], None]) -> None:
    """Answer until SIGTERM; say so once it does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--board", type=Path, required=True)
    parser.add_argument("--on-bench", action="store_true")
    parser.add_argument("--door", type=Path)
    parser.add_argument("--trace", type=Path)
    chosen = parser.parse_args(arguments)
    board = load_board(chosen.board)
    clock = LinuxClock()
    outputs = range(board.switch.outputs)
    trace = Trace.to(chosen.trace) if chosen.trace else Trace()
    body: Touchable = fingertip_body(board, len(outputs))
    if chosen.on_bench:
        open_ends = (OPEN_CONTACT,) * len(outputs)
        leak_ohm, compliance_v = board.source.leak_ohm, board.source.compliance_v
        body = MinimalBody(open_ends, leak_ohm=leak_ohm, compliance_v=compliance_v)
    circuit = Circuit(board, body, outputs, trace, (), start_ns=clock.now_ns(), seed=1)
    fd = os.open("/dev/rig", os.O_RDWR | os.O_NONBLOCK)
    answerer = Answerer(board, circuit, fd, clock.now_ns)
    answerer.follow_world()
    door = Door(circuit, chosen.door) if chosen.door else None
    signal.signal(signal.SIGTERM, _leave)
    gc.freeze()
    ready()
    try:
        serve(answerer, fd, door)
    finally:
        circuit.close()
