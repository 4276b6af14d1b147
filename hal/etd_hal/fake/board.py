"""The fake board in this process: the four ports, on a clock.

Owns: the lock on calls, and waiting for the time they take. Must not know: what a call does
(`circuit.py`), how long it takes (`machines.py`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

from etd_body.interface import Sides
from etd_hal.boardfile import BoardFile
from etd_hal.errors import BusError
from etd_hal.fake.circuit import Circuit
from etd_hal.fake.clock import BoardClock
from etd_hal.fake.faults import Fault
from etd_hal.fake.layouts import lay_out
from etd_hal.fake.machines import PI4, MachineModel
from etd_hal.fake.pressure_sensors import PressureModel, SensorUnderArray, lying
from etd_hal.fake.processor import Call
from etd_hal.fake.spibus import Played
from etd_hal.fake.trace import Trace
from etd_hal.fake.world import Touchable, World
from etd_hal.ports import Changes, Edge, LineSetup, Message, SpiSetup

Said = TypeVar("Said")


class FakeBoard:
    """One board, from power-up on. `request` gives its ports to one holder at a time.

    `electrodes[i]` is the chain output of electrode i of `body`; other outputs are connected to
    nothing. A `trace` is written to, and closed with the board. `sensors` are those of the array,
    each on an ADS1115 of the board's I2C, and `pressing` is what presses on them.
    """

    def __init__(
        self,
        board: BoardFile,
        clock: BoardClock,
        body: Touchable,
        *,
        electrodes: Sequence[int],
        trace: Trace | None = None,
        faults: Iterable[Fault] = (),
        seed: int = 1,
        sensors: Sequence[SensorUnderArray] = (),
        pressing: PressureModel = lying,
        machine: MachineModel = PI4,
    ) -> None:
        if len(electrodes) != body.electrode_count:
            raise ValueError(f"{len(electrodes)} electrodes on a body of {body.electrode_count}")
        self._clock = clock
        self._machine = machine
        self._lock = threading.Lock()
        self._circuit = Circuit(
            board,
            body,
            electrodes,
            trace or Trace(),
            faults,
            start_ns=clock.now_ns(),
            seed=seed,
            sensors=sensors,
            pressing=pressing,
            machine=machine,
        )

    @property
    def world(self) -> World:
        return self._circuit.world

    @property
    def violations(self) -> list[str]:
        """The rules that were broken; a test asserts that it is empty."""
        return self._circuit.violations

    @property
    def dac_code(self) -> int:
        return self._circuit.dac_code

    @property
    def sides(self) -> Sides:
        """What each electrode is connected to."""
        return self._circuit.sides

    def request(self, lines: LineSetup, spi: SpiSetup) -> FakePorts:
        """Take the lines and the SPI device. Raises: BusError (`busy` while they are held)."""
        start_ns = self._clock.begin_call("line")
        with self._lock:
            end_ns = self._circuit.request(start_ns, lines, spi)
        self._clock.end_call(end_ns)
        has_i2c = self._circuit.board.i2c != "absent"
        calls = _Calls(self._circuit, self._clock, self._lock, self._machine)
        return FakePorts(
            FakeSpi(calls, spi.device),
            FakeGpio(calls),
            FakeI2c(calls) if has_i2c else None,
            FakeMarker(calls),
            self,
        )

    def ask_body(self, question: Callable[[], Said]) -> Said:
        """An answer of the body, between two calls."""
        with self._lock:
            return question()

    def settle(self) -> None:
        """Up to now, what goes on by itself: relays on their way, a supply that a current empties.
        Every call does it first.
        """
        with self._lock:
            self._circuit.settle(self._clock.now_ns())

    def release(self) -> None:
        """Release the lines: they keep their levels, and can be requested again."""
        with self._lock:
            self._circuit.release()

    def let_float(self) -> None:
        """The process that held the outputs is gone: the pulls set their levels."""
        with self._lock:
            self._circuit.gpio.let_float(self._clock.now_ns())

    def close(self) -> None:
        """The end: a DAC that is not at zero is a violation."""
        with self._lock:
            self._circuit.close()


@dataclass(frozen=True, slots=True)
class _Calls:
    circuit: Circuit
    clock: BoardClock
    lock: threading.Lock
    machine: MachineModel


class FakeSpi:
    def __init__(self, calls: _Calls, device: str) -> None:
        self._calls = calls
        self._device = device

    def prepare(self, message: Message) -> None:
        """See `ports.Spi`."""
        layout_ns = lay_out(message, self, self._device, self._calls.machine)
        if layout_ns:
            self._calls.clock.end_call(self._calls.clock.begin_call("prepare") + layout_ns)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        """See `ports.Spi`. The lock is free while the message waits: a stopper can get in."""
        calls = self._calls
        layout_ns = lay_out(message, self, self._device, self._calls.machine)
        steps = calls.circuit.spi.play(calls.clock.begin_message() + layout_ns, message)
        try:
            while True:
                with calls.lock:
                    until_ns = next(steps)
                calls.clock.end_call(until_ns)
        except StopIteration as done:
            played: Played = done.value
            calls.clock.end_call(played[1])
            return played[0]
        except BusError:
            calls.clock.end_call(calls.circuit.now_ns())
            raise


class FakeGpio:
    def __init__(self, calls: _Calls) -> None:
        self._calls = calls
        self._lines = calls.circuit.gpio

    def set(self, changes: Changes) -> None:
        calls = self._calls
        call: Call = "switch" if self._lines.moves_switch(changes) else "line"
        start_ns = calls.clock.begin_call(call)
        with calls.lock:
            end_ns = self._lines.set(start_ns, changes)
        calls.clock.end_call(end_ns)

    def get(self, line: int) -> int:
        return self._read(lambda start_ns: self._lines.get(start_ns, line))

    def edges(self) -> tuple[Edge, ...]:
        return self._read(self._lines.take_edges)

    def _read(self, read: Callable[[int], tuple[Said, int]]) -> Said:
        calls = self._calls
        start_ns = calls.clock.begin_call("line")
        with calls.lock:
            found, end_ns = read(start_ns)
        calls.clock.end_call(end_ns)
        return found


class FakeI2c:
    def __init__(self, calls: _Calls) -> None:
        self._calls = calls

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        calls = self._calls
        start_ns = calls.clock.begin_call("line")
        with calls.lock:
            answer, end_ns = calls.circuit.i2c.transfer(start_ns, address, write, read_length)
        calls.clock.end_side_call(end_ns)
        if isinstance(answer, BusError):
            raise answer
        return answer


class FakeMarker:
    def __init__(self, calls: _Calls) -> None:
        self._calls = calls

    def mark(self, event: Literal["frame", "mark"], seq: int, tag: int | str | None) -> None:
        calls = self._calls
        start_ns = calls.clock.begin_call("mark")
        with calls.lock:
            calls.circuit.mark(start_ns, event, seq, tag)


@dataclass(frozen=True, slots=True)
class FakePorts:
    """The ports that one holder of the board has."""

    spi: FakeSpi
    gpio: FakeGpio
    i2c: FakeI2c | None
    marker: FakeMarker
    board: FakeBoard

    def close(self) -> None:
        self.board.release()
