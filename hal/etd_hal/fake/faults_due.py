"""Which faults are in a board, and when each is due.

Owns: counting events until a fault is due, an ADC's noise, and which lines can be wrong beyond the
pin. Must not know: how a bus or a chip carries a fault out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from random import Random
from typing import Any, TypeVar

from etd_hal.fake.faults import (
    AdcNoise,
    DataFlipped,
    ExtraClock,
    Fault,
    I2cFailure,
    LatchIgnored,
    LineInverted,
    LinesSwapped,
    LostClock,
    LostSync,
    MisoFlipped,
    MosiFlipped,
    SpiError,
    SpiJitter,
    SpiShort,
    SpiStall,
    StuckBehind,
)

_F = TypeVar("_F")
_WrongEdge = LostClock | ExtraClock | DataFlipped | LatchIgnored | LostSync
_WrongWord = MosiFlipped | MisoFlipped
#: What the board sees of these lines may differ from the pin.
SEEN_BEHIND = ("POL", "DATA", "LE", "BL", "CLK", "HV", "HEARTBEAT")


class Faults:
    """The active faults, each with its count of events.

    `lines`: the board's, by name.
    """

    def __init__(self, faults: Iterable[Fault] = (), lines: Collection[str] = SEEN_BEHIND) -> None:
        self._counts: dict[Fault, int] = {}
        self._lines = lines
        self._noise: dict[AdcNoise, Random] = {}
        #: By kind, cached: it is read at every edge of a line.
        self._of: dict[type, tuple[Any, ...]] = {}
        #: Whether there is any: read at every edge of a line.
        self.are_there = False
        #: How often a fault was added or removed.
        self.changes = 0
        for fault in faults:
            self.add(fault)

    def add(self, fault: Fault) -> None:
        """Raises: ValueError for a line that has nothing behind its pin on this board."""
        there = [name for name in SEEN_BEHIND if name in self._lines]
        for name in _lines_behind(fault):
            if name not in there:
                what = f"{name!r} cannot be wrong beyond its pin: name {', '.join(there)}"
                raise ValueError(what)
        self._counts[fault] = 0
        self._of.clear()
        self.are_there = True
        self.changes += 1
        if isinstance(fault, AdcNoise):
            self._noise[fault] = Random(fault.seed)

    def remove(self, fault: Fault) -> None:
        """Raises: KeyError if it is not active."""
        del self._counts[fault]
        self._of.clear()
        self.are_there = bool(self._counts)
        self.changes += 1

    def clear(self) -> None:
        self._counts.clear()
        self.are_there = False
        self.changes += 1

    def of(self, kind: type[_F]) -> tuple[_F, ...]:
        """The active faults of a kind."""
        if not self._counts:
            return ()
        found = self._of.get(kind)
        if found is None:
            found = tuple(fault for fault in self._counts if isinstance(fault, kind))
            self._of[kind] = found
        return found

    def spi_message(self) -> tuple[SpiError | SpiStall | SpiShort, ...]:
        """Count a message; return the faults that are due."""
        return tuple(
            fault
            for fault in self.of(SpiError) + self.of(SpiStall) + self.of(SpiShort)
            if self._count(fault) == fault.at_message
        )

    def spi_late_us(self) -> int:
        """Count a message; return the delay of the periodic faults that are due."""
        return sum(
            fault.late_us for fault in self.of(SpiJitter) if self._count(fault) % fault.every == 0
        )

    def edge_is_wrong(self, kind: type[_WrongEdge]) -> bool:
        """Count a rising edge; return whether a fault is due."""
        if not self._counts:
            return False
        due = [fault for fault in self.of(kind) if _is_due(fault, self._count(fault))]
        return bool(due)

    def word(self, kind: type[_WrongWord], word: bytes) -> bytes:
        """Count a word of 16 bits; return it as the faults that are due make it."""
        flips = 0
        for fault in self.of(kind):
            count = self._count(fault)
            if count == fault.at_word if fault.every is None else count % fault.every == 0:
                flips ^= 1 << fault.bit
        return (int.from_bytes(word) ^ flips).to_bytes(len(word)) if flips else word

    def adc_noise(self) -> float:
        """The error of the next conversion, in codes."""
        return sum(self._noise[noise].gauss(0.0, noise.sigma) for noise in self.of(AdcNoise))

    def i2c(self, address: int) -> I2cFailure | None:
        """Count a transaction; return the fault that is due."""
        for fault in self.of(I2cFailure):
            if fault.address == address:
                times = self._count(fault)
                if fault.times is None or times <= fault.times:
                    return fault
        return None

    def _count(self, fault: Fault) -> int:
        self._counts[fault] += 1
        return self._counts[fault]


def _lines_behind(fault: Fault) -> tuple[str, ...]:
    if isinstance(fault, LinesSwapped):
        return fault.first, fault.second
    return (fault.name,) if isinstance(fault, StuckBehind | LineInverted) else ()


def _is_due(fault: _WrongEdge, count: int) -> bool:
    if fault.every is None:
        return count == fault.at_edge
    return count % fault.every == 0
