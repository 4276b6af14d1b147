"""The boundary to hardware: four small ports, and the plain objects that cross it.

Owns: the contracts that every backend keeps (the kernel's drivers in `linux/`, the fake board in
`fake/`) and that every chip driver may rely on. `tests/contract` holds both to them.
Must not know: chips, boards, limits, frames, people.

For all ports: a failing call raises `BusError`, with the kind of the failure as a field. No port
retries. Calls are made by one thread at a time, except `Gpio.set`, which the stopper may call
while an SPI message is under way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

#: Of each sleep, at most this much at its end is spun (how much: `wakeups.py`); the rest is slept.
#: A real-time thread that never sleeps is throttled by the kernel with the DAC on.
SPIN_NS = 50_000

#: Lines that change together, in one call: (line, value) pairs.
Changes = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Transfer:
    """One transfer of an SPI message: bytes out, then `delay_us` with chip select still active.

    With `cs_change` chip select then goes inactive for about 10 us and active again (never set on
    the last transfer of a message: there it would mean the contrary). Empty `tx` is a pure delay.
    """

    tx: bytes = b""
    delay_us: int = 0
    cs_change: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """A list of transfers that is executed as one unit, and cannot be stopped half-way.

    Compared by identity: two of the same transfers are two messages. `made` is what ports and the
    guard have made of the message, each under itself as the key; it is dropped with the message.
    """

    transfers: tuple[Transfer, ...]
    made: dict[object, Any] = field(default_factory=dict, init=False, repr=False)


class Spi(Protocol):
    def prepare(self, message: Message) -> None:
        """Do now what `message` needs computed before it can be sent; nothing is sent.

        `transfer` prepares a message that is not prepared, and then takes tens of microseconds
        longer, without current. So a message that will be timed is prepared before. Preparing again
        costs next to nothing: the message keeps what the port has made of it (`made`) as long as
        the message exists.

        Raises: BusError (`invalid`, `too_long`, as `transfer`).
        """
        ...

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        """Execute `message` and return the bytes read, one entry for each transfer with data.

        Atomic: once begun it runs to its end, whatever becomes of the calling process. Blocks for
        as long as the message lasts. On an error of the bus the remaining transfers are *not* sent:
        the caller must make the outputs safe through GPIO at once.

        Raises: BusError (`invalid`: 512 transfers or more; `too_long`: more than the kernel's
        buffer takes, 32 transfers with data on arm64; nothing was sent in both cases. `io`,
        `timeout`, `short`: some of it was sent).
        """
        ...


@dataclass(frozen=True, slots=True)
class Edge:
    """A change of an input line, with the time the kernel saw it (CLOCK_MONOTONIC)."""

    line: int
    value: int
    t_ns: int


class Gpio(Protocol):
    def set(self, changes: Changes) -> None:
        """Set several output lines in one call.

        Not atomic: as on the Pi, the lines change one after another in *ascending line number*,
        whatever the order given, some 50 ns apart. Does not block.

        Raises: BusError (`invalid` for a line that was not requested as an output).
        """
        ...

    def get(self, line: int) -> int:
        """The level, 0 or 1, of any requested line. Raises: BusError."""
        ...

    def edges(self) -> tuple[Edge, ...]:
        """All edges since the last call, oldest first. Never blocks. Raises: BusError."""
        ...


class I2c(Protocol):
    def transfer(self, address: int, write: bytes, read_length: int) -> bytes:
        """Write, then (with a repeated start) read `read_length` bytes, as one transaction.

        May block for a second when the bus is stuck: never called from the scan thread.

        Raises: BusError (`absent`: no chip answers at `address`; `timeout`: the bus is stuck;
        `io`: the transaction was cut).
        """
        ...


class Clock(Protocol):
    def now_ns(self) -> int:
        """CLOCK_MONOTONIC in nanoseconds (the fake's may lag behind it, never lead)."""
        ...

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Return at `deadline_ns` or later; at once if that has passed.

        Sleeps, and spins no more than the last `SPIN_NS`.
        """
        ...

    def doze_until_ns(self, deadline_ns: int) -> None:
        """The same where being late does not matter: sleeps all of it, and costs no processor."""
        ...


#: Waits for so many seconds at most; True once that is there for which it waits.
Wait = Callable[[float], bool]


class WakingClock(Clock, Protocol):
    """The clock of a loop that something else may wake."""

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        """As `doze_until_ns`, and ends as soon as `wait` does; at once where that would not wait.
        Late by what the system likes either way.
        """
        ...


class Marker(Protocol):
    def mark(self, event: Literal["frame", "mark"], seq: int, tag: int | str | None) -> None:
        """Write a mark of the engine into the record of the buses, if there is one."""
        ...


Pull = Literal["up", "down", "none"]


@dataclass(frozen=True, slots=True)
class InputLine:
    line: int
    pull: Pull = "none"
    edges: bool = False


@dataclass(frozen=True, slots=True)
class LineSetup:
    """What to request. Outputs get their initial levels with the request, in the order given."""

    outputs: tuple[tuple[int, int], ...]
    inputs: tuple[InputLine, ...] = ()
    consumer: str = "etd"


@dataclass(frozen=True, slots=True)
class SpiSetup:
    device: str
    mode: int
    speed_hz: int
