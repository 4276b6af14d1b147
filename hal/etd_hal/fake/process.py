"""The board process: a fake board that outlives its clients.

Owns: the socket, who holds the board, and that a call once received is executed and recorded
whole. Must not know: what a call does (`circuit.py`), clocks (time comes with each call).

    python -m etd_hal.fake.process --board FILE --socket PATH [--door PATH] [--trace FILE]
        [--sensor ADDRESS:CHANNEL:ZERO_V:KPA_PER_V]...

One client at a time holds the lines; when it goes away, however it goes, they keep their levels
and the next one may request them. `--door` is the second door, for tests: stop lines, contacts,
faults.
"""

from __future__ import annotations

import argparse
import selectors
import signal
import socket
import sys
from collections.abc import Generator
from pathlib import Path
from typing import cast

import msgspec

from etd_hal.boardfile import load_board
from etd_hal.errors import BusError, EtdError
from etd_hal.fake import wire
from etd_hal.fake.circuit import Circuit
from etd_hal.fake.clock import START_NS
from etd_hal.fake.faults import fault_of
from etd_hal.fake.fingertip import fingertip_body
from etd_hal.fake.pressure_sensors import Sensor
from etd_hal.fake.spibus import Played
from etd_hal.fake.trace import Trace
from etd_hal.ports import Message

_LISTEN_BACKLOG = 8


class BoardServer:
    """Answers one datagram with one datagram."""

    def __init__(self, circuit: Circuit) -> None:
        self._circuit = circuit
        self._holder: socket.socket | None = None
        self._playing: Generator[int, None, Played] | None = None

    def answer(self, client: socket.socket, call: wire.Call | wire.Knock) -> wire.Answer:
        """Execute a call. What is wrong with it is part of the answer."""
        if isinstance(call, wire.Knock):
            return knock_at(self._circuit, call, held=self._holder is not None)
        try:
            if isinstance(call, wire.TakeLines):
                return self._take_lines(client, call)
            if client is not self._holder:
                raise BusError("invalid", "the board process", "call", "request the lines first")
            return self._call(call)
        except BusError as error:
            end_ns = self._circuit.now_ns()
            return wire.Failed(end_ns, error.kind, error.device, error.operation, error.detail)

    def left(self, client: socket.socket) -> None:
        """A client is gone: its message runs to the end, its lines are free."""
        if client is not self._holder:
            return
        if self._playing is not None:
            try:
                for _ in self._playing:
                    pass
            except BusError:
                pass  # The one it was for is gone; the trace has what was sent.
            self._playing = None
        self._circuit.release()
        self._holder = None

    def _take_lines(self, client: socket.socket, call: wire.TakeLines) -> wire.Done:
        board = self._circuit.board
        if call.board != board.name:
            detail = f"this is {board.name}, not {call.board}"
            raise BusError("invalid", "the board process", "request", detail)
        end_ns = self._circuit.request(call.t_ns, call.lines, call.spi)
        self._holder = client
        return wire.Done(end_ns)

    def _call(self, call: wire.Call) -> wire.Answer:
        circuit = self._circuit
        match call:
            case wire.Play():
                self._playing = circuit.spi.play(call.t_ns, Message(call.transfers))
                return self._play_on()
            case wire.Resume():
                return self._play_on()
            case wire.SetLines():
                return wire.Done(circuit.gpio.set(call.t_ns, call.changes))
            case wire.GetLine():
                level, end_ns = circuit.gpio.get(call.t_ns, call.line)
                return wire.Done(end_ns, value=level)
            case wire.TakeEdges():
                edges, end_ns = circuit.gpio.take_edges(call.t_ns)
                return wire.Done(end_ns, edges=edges)
            case wire.TransferI2c():
                return self._transfer_i2c(call)
            case wire.Mark():
                circuit.mark(call.t_ns, call.event, call.seq, call.tag)
                return wire.Done(call.t_ns)
            case _:
                raise BusError("invalid", "the board process", "call", f"unexpected: {call}")

    def _play_on(self) -> wire.Answer:
        if self._playing is None:
            raise BusError("invalid", "the board process", "resume", "no message waits")
        try:
            return wire.Waits(next(self._playing))
        except StopIteration as done:
            self._playing = None
            reads, end_ns = done.value
            return wire.Done(end_ns, reads=reads)
        except BusError:
            self._playing = None
            raise

    def _transfer_i2c(self, call: wire.TransferI2c) -> wire.Answer:
        answer, end_ns = self._circuit.i2c.transfer(
            call.t_ns, call.address, call.write, call.read_length
        )
        if isinstance(answer, BusError):
            return wire.Failed(end_ns, answer.kind, answer.device, answer.operation, answer.detail)
        return wire.Done(end_ns, reads=(answer,))


def knock_at(circuit: Circuit, knock: wire.Knock, *, held: bool) -> wire.State:
    """Do to the world what comes through the second door; the answer is the board's state."""
    world = circuit.world
    match knock:
        case wire.Press(level=0):
            world.press(knock.stop, knock.at_ns)
        case wire.Press():
            world.release(knock.stop, knock.at_ns)
        case wire.GiveEdge():
            world.trigger(knock.at_ns, knock.lasts_ns)
        case wire.Touch():
            world.touch(knock.electrode, knock.contact)
        case wire.PutIn():
            world.put_in(fault_of(knock.fault))
        case wire.AskState():
            pass
    return wire.State(tuple(circuit.violations), circuit.dac_code, world.rail_v(), held)


def serve(server: BoardServer, paths: list[Path], ending: socket.socket) -> None:
    """Answer at `paths` until `ending` has something to read. Says "listening" when all are
    there.
    """
    selector = selectors.DefaultSelector()
    selector.register(ending, selectors.EVENT_READ, "ending")
    for path in paths:
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        early = path.with_name(path.name + ".new")
        early.unlink(missing_ok=True)
        listener.bind(str(early))
        listener.listen(_LISTEN_BACKLOG)
        early.rename(path)  # A path that is there is listened on.
        selector.register(listener, selectors.EVENT_READ, "listener")
    sys.stdout.write("listening\n")
    sys.stdout.flush()
    while True:
        for key, _ in selector.select():
            ready = cast(socket.socket, key.fileobj)
            if key.data == "ending":
                return
            if key.data == "listener":
                client, _ = ready.accept()
                selector.register(client, selectors.EVENT_READ, "client")
            elif not _answer_one(server, ready):
                selector.unregister(ready)
                server.left(ready)
                ready.close()


def _answer_one(server: BoardServer, client: socket.socket) -> bool:
    """Answer one datagram; False when the client is gone."""
    try:
        datagram = client.recv(wire.MAX_DATAGRAM_BYTES)
        if not datagram:
            return False
        client.send(wire.encode(server.answer(client, wire.decode_call(datagram))))
    except (OSError, msgspec.MsgspecError):
        return False
    return True


def _sensor(text: str) -> Sensor:
    try:
        return Sensor.of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not as 0x49:2:0.5:100 is") from error


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m etd_hal.fake.process", description=__doc__)
    parser.add_argument("--board", type=Path, required=True, help="board file")
    parser.add_argument("--socket", type=Path, required=True, help="where clients find the board")
    parser.add_argument("--door", type=Path, help="where tests find the world")
    parser.add_argument("--trace", type=Path, help="write the bus trace to this file")
    parser.add_argument(
        "--electrodes", help="chain outputs of the electrodes, with commas (default: all)"
    )
    parser.add_argument(
        "--sensor",
        action="append",
        default=[],
        type=_sensor,
        metavar="ADDRESS:CHANNEL:ZERO_V:KPA_PER_V",
        help="a pressure sensor under the array, that a finger lies on; give one for each",
    )
    chosen = parser.parse_args(arguments)
    try:
        board = load_board(chosen.board)
    except EtdError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    outputs = range(board.switch.outputs)
    electrodes = (
        [int(text) for text in chosen.electrodes.split(",")] if chosen.electrodes else outputs
    )
    trace = Trace.to(chosen.trace) if chosen.trace else Trace()
    body = fingertip_body(board, len(electrodes))
    circuit = Circuit(
        board, body, electrodes, trace, (), start_ns=START_NS, seed=1, sensors=chosen.sensor
    )
    # An exception that a handler raised would be lost, were it raised within a destructor.
    ending, wakes = socket.socketpair()
    wakes.setblocking(False)
    signal.set_wakeup_fd(wakes.fileno())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    try:
        serve(BoardServer(circuit), [path for path in (chosen.socket, chosen.door) if path], ending)
    finally:
        circuit.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
