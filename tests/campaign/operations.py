"""Every operation of an engine on its buses, counted, and what may become of one of them.

Owns: the ports that count and carry an interference out. It stands under the guard, where the
kernel's drivers do. Must not know: what an operation is for, which fault is meant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeVar

from etd_hal.backend import Backend
from etd_hal.errors import BusError, BusErrorKind
from etd_hal.ports import Changes, Edge, Gpio, I2c, Message, Spi

Port = Literal["spi", "set", "get", "edges", "i2c"]
#: Of one operation: nothing is done although it seems so, or the kernel says that it failed.
Interference = Literal["not done"] | BusErrorKind
#: Called before each operation with its number, from 0 on.
Before = Callable[[int, Port], Interference | None]

Done = TypeVar("Done")


class Killed(BaseException):
    """The process ended at this operation. No `except` catches it, but `finally` still runs, as in
    no process that is killed: real kills are those of `tests/bench/kills.py`.
    """


class Operations:
    """Of one engine, for as long as it lives."""

    def __init__(self) -> None:
        self.count = 0
        self.before: Before = lambda *_: None

    def wrap(self, backend: Backend) -> Backend:
        return replace(
            backend,
            spi=_CountedSpi(self, backend.spi),
            gpio=_CountedGpio(self, backend.gpio),
            i2c=None if backend.i2c is None else _CountedI2c(self, backend.i2c),
        )

    def done(self, port: Port, do: Callable[[], Done], nothing: Done) -> Done:
        """Raises: BusError, as the interference says or the port itself."""
        number, self.count = self.count, self.count + 1
        interference = self.before(number, port)
        if interference is None:
            return do()
        if interference == "not done":
            return nothing
        raise BusError(interference, "fault campaign", port, f"operation {number}")


class _CountedSpi:
    def __init__(self, operations: Operations, spi: Spi) -> None:
        self._operations = operations
        self._spi = spi

    def prepare(self, message: Message) -> None:
        self._spi.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        zeros = tuple(bytes(len(one.tx)) for one in message.transfers if one.tx)
        return self._operations.done("spi", lambda: self._spi.transfer(message), zeros)


class _CountedGpio:
    def __init__(self, operations: Operations, gpio: Gpio) -> None:
        self._operations = operations
        self._gpio = gpio

    def set(self, changes: Changes) -> None:
        self._operations.done("set", lambda: self._gpio.set(changes), None)

    def get(self, line: int) -> int:
        return self._operations.done("get", lambda: self._gpio.get(line), 0)

    def edges(self) -> tuple[Edge, ...]:
        return self._operations.done("edges", self._gpio.edges, ())


class _CountedI2c:
    def __init__(self, operations: Operations, i2c: I2c) -> None:
        self._operations = operations
        self._i2c = i2c

    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        return self._operations.done(
            "i2c", lambda: self._i2c.transfer(address, write, read_length), bytes(read_length)
        )
