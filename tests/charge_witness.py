"""The body's own account of charge, held against the ledger at the wire.

Owns: the comparison, for every electrode, at each message and whenever a test asks. Must not know:
how the ledger counts, what a pulse should have been.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace

from etd.safety.bookings import WINDOW_NS
from etd.safety.ledger import Ledger
from etd_body.electrode import Contact
from etd_body.minimal import MinimalBody
from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile
from etd_hal.ports import Message, Spi

_RESISTANCE_OHM = 10_000.0
#: Of the body's own sums, which are floating point.
_ROUNDING_PC = 1.0


def even_skin(board: BoardFile, electrodes: int) -> MinimalBody:
    """The same contact at each electrode, so that all returns carry the same share. It stores no
    charge: what an electrode got is what flowed in the pulse.
    """
    return MinimalBody(
        (Contact("skin", _RESISTANCE_OHM),) * electrodes,
        leak_ohm=board.source.leak_ohm,
        compliance_v=board.source.compliance_v,
    )


@dataclass(frozen=True, slots=True)
class Shortfall:
    """One electrode whose body got more in the last second than the ledger has."""

    when: str
    electrode: int
    got_pc: float
    booked_pc: int


class Witness:
    """Stands at the SPI port; compares from `begin` on."""

    def __init__(self, body: MinimalBody) -> None:
        self._body = body
        self._ledger: Ledger | None = None
        self._now_ns: Callable[[], int] = lambda: 0
        self._longest_ns = 0
        self._times_ns = [0]
        self._accounts_pc = [self._account_pc()]
        self.shortfalls: list[Shortfall] = []

    def wrap(self, backend: Backend) -> Backend:
        """Sees every message from now on."""
        self._now_ns = backend.clock.now_ns
        return replace(backend, spi=_WatchedSpi(self, backend.spi))

    def begin(self, ledger: Ledger, longest_ns: int) -> None:
        """A message that takes longer than `longest_ns` is not compared before it is settled."""
        self._ledger, self._longest_ns = ledger, longest_ns

    def look(self, when: str) -> None:
        """Compare all electrodes now."""
        now_ns = self._now_ns()
        self._note(now_ns)
        if self._ledger is None:
            return
        for electrode, got_pc in enumerate(self.got_pc()):
            booked_pc = self._ledger.charge_pc(electrode, now_ns)
            if got_pc > booked_pc + _ROUNDING_PC:
                self.shortfalls.append(Shortfall(when, electrode, got_pc, booked_pc))

    def got_pc(self) -> list[float]:
        """Of each electrode in the last second, but for a message that was under way at its
        beginning.
        """
        first = bisect_left(self._times_ns, self._now_ns() - WINDOW_NS)
        before_pc = self._accounts_pc[min(first, len(self._accounts_pc) - 1)]
        return [now - before for now, before in zip(self._account_pc(), before_pc, strict=True)]

    def play(self, spi: Spi, message: Message) -> tuple[bytes, ...]:
        """A message, with a look before it and one directly after it, if it carries current: while
        the board is made safe after an error the ledger is not asked for anything.
        """
        if not _carries_current(message):
            return spi.transfer(message)
        begun_ns = self._now_ns()
        self.look("before a message")
        try:
            return spi.transfer(message)
        finally:
            if self._now_ns() - begun_ns <= self._longest_ns:
                self.look("directly after a message")

    def _note(self, now_ns: int) -> None:
        self._times_ns.append(now_ns)
        self._accounts_pc.append(self._account_pc())

    def _account_pc(self) -> list[float]:
        return self._body.absolute_charges_pc()


def _carries_current(message: Message) -> bool:
    """Whether any word has one of the DAC's twelve bits."""
    return any(int.from_bytes(transfer.tx, "big") & 0x3FFC for transfer in message.transfers)


class _WatchedSpi:
    def __init__(self, witness: Witness, spi: Spi) -> None:
        self._witness = witness
        self._spi = spi

    def prepare(self, message: Message) -> None:
        self._spi.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        return self._witness.play(self._spi, message)
