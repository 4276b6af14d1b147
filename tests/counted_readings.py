"""A message that counts how often it is read: what a driver computes of it shows, busy host or not.

Owns: the count, and a clock that goes by it. Must not know: drivers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from etd_hal.ports import Transfer


class CountedTransfers(tuple[Transfer, ...]):
    """Transfers of a message; each reading of them in order is counted."""

    readings = 0

    def __iter__(self) -> Iterator[Transfer]:
        self.readings += 1
        return super().__iter__()


@dataclass
class ReadingsClock:
    """Its time is how often the transfers have been read."""

    transfers: CountedTransfers

    def now_ns(self) -> int:
        return self.transfers.readings

    def sleep_until_ns(self, deadline_ns: int) -> None:
        pass

    def doze_until_ns(self, deadline_ns: int) -> None:
        pass
